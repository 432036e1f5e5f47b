"""Keys of a drone's file that were renamed, and old configurations in the new words."""

from __future__ import annotations

import copy
from typing import Any

# From fileversion 1 to 2.
RENAMED = {
    "eye": "camera_health",
    "threat.d_ref": "nmpc.d_ref",
    "threat.headway": "speed_limits.headway",
    "threat.room": "speed_limits.clearance",
    "threat.creep": "speed_limits.headway_least",
    "threat.calm": "speed_limits.relative_speed",
    "threat.keep_right": "right_of_way.keep_right",
    "threat.oncoming": "right_of_way.oncoming",
    "threat.level": "right_of_way.level",
    "gaze.seen_full": "speed_limits.full_view",
    "gaze.seen_none": "speed_limits.no_view",
    "gaze.creep": "speed_limits.no_view_share",
}
_MERGED = {"threat.d_ref"}  # its value was one more of the same symbol, and is dropped


def upgraded(config: dict[str, Any], fileversion: int) -> dict[str, Any]:
    """Return the configuration of an old log with today's keys; fileversion: today's."""
    new = copy.deepcopy(config)
    for old, name in RENAMED.items():
        found, value = _take(new, old.split("."))
        if found and old not in _MERGED:
            _put(new, name.split("."), value)
    new["fileversion"] = fileversion
    return new


def _take(config: dict[str, Any], path: list[str]) -> tuple[bool, Any]:
    """Remove the value at `path`; return whether it was there, and the value."""
    *sections, key = path
    for section in sections:
        config = config.get(section, {})
    return (True, config.pop(key)) if key in config else (False, None)


def _put(config: dict[str, Any], path: list[str], value: Any) -> None:
    *sections, key = path
    for section in sections:
        config = config.setdefault(section, {})
    config[key] = value
