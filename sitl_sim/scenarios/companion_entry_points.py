"""Companion classes that run in the simulator's process, found by their entry points."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

GROUP = "sitl_sim.companion"


def companion_class(name: str) -> Any:
    """Return the class that the installed companion registers as `name` (pyproject.toml).

    Raises:
        LookupError: no companion is installed.
    """
    found = entry_points(group=GROUP, name=name)
    if not found:
        raise LookupError(f"no companion is installed: entry point {GROUP}:{name} is missing")
    return next(iter(found)).load()
