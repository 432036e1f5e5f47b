"""Vectors along the axes of the message classes (ENU, FLU) and of MAVLink (NED, FRD)."""

from __future__ import annotations

from typing import Any

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import enu_ned, flu_frd


def ned(v: Vector) -> tuple[float, float, float]:
    """Return a world vector (3,) in NED."""
    x, y, z = np.asarray(v, float).tolist()
    return enu_ned(x, y, z)


def frd(v: Vector) -> tuple[float, float, float]:
    """Return a body vector (3,) in FRD."""
    x, y, z = np.asarray(v, float).tolist()
    return flu_frd(x, y, z)


def vector(x: float, y: float, z: float) -> Vector:
    """Return the vector (3,) of three numbers."""
    return np.array((x, y, z), dtype=float)


def body_rates(w: Any) -> Vector:
    """Return the body rates (3,) rad/s FLU of a message with `rollspeed` and so on."""
    return vector(*flu_frd(w.rollspeed, w.pitchspeed, w.yawspeed))
