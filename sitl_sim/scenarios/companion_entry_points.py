"""Companion classes that run in the simulator's process, found by their entry points."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

from mavlink_bridge.shared.settings import SettingsError

GROUP = "sitl_sim.companion"


def companion_class(name: str) -> Any:
    """Return the class that the installed companion registers as `name` (pyproject.toml).

    Raises:
        SettingsError: no companion is installed.
    """
    found = entry_points(group=GROUP, name=name)
    if not found:
        why = f"no companion is installed: entry point {GROUP}:{name} is missing"
        raise SettingsError([why])
    return next(iter(found)).load()
