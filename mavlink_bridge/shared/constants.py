"""Physical constants."""

from __future__ import annotations

GRAVITY = 9.80665  # m/s², standard gravity (ISO 80000-3); hover is this collective acceleration
