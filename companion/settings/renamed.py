"""Renamed and removed keys of a drone's file, and the upgrade of old configurations."""

from __future__ import annotations

import copy
from typing import Any

# From fileversion 1 to 2.
RENAMED = {
    "eye": "camera_health",
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
_ONE_START = "a solve has one start since each neighbour and obstacle has its own slack"
_ODDS = "tracker.detected and ghosts tell how sure looks make of a neighbour"
_TRUNKS = "obstacles.detected and ghosts tell how sure looks make of a trunk"
REMOVED = {
    # Its value scaled every threat alike and changed no flight; moved to nmpc.d_ref it would.
    "threat.d_ref": "nmpc.d_ref serves both; leave this key out",
    "reciprocity": "neighbours are expected to fly on, eq. (14); leave this section out",
    "certificate.neighbour_trusted": "neighbour_hastens is above what headway leaves a drone",
    "mission.wait": "no drone sets out later than others; leave this key out",
    "nmpc.w_mig_end": "the last step of the plan counts as the others do; leave this key out",
    "nmpc.rescue_slack": _ONE_START,
    "nmpc.sqp_iterations_rescue": _ONE_START,
    "obstacles.associate": "how densely trunks stand tells which look is of which; leave it out",
    "obstacles.hits_to_confirm": _TRUNKS,
    "obstacles.hits_to_keep": _TRUNKS,
    "obstacles.misses_to_forget": _TRUNKS,
    "tracker.confirmed": _ODDS,
    "tracker.hits_to_confirm": _ODDS,
    "tracker.life_per_look": _ODDS,
    "tracker.misses_to_drop": _ODDS,
    "tracker.surest": _ODDS,
}


def upgraded(config: dict[str, Any], fileversion: int) -> dict[str, Any]:
    """Return a copy of an old configuration with the present keys and `fileversion`."""
    new = copy.deepcopy(config)
    for before, after in RENAMED.items():
        found, value = _take(new, before.split("."))
        if found:
            _put(new, after.split("."), value)
    for before in REMOVED:
        _take(new, before.split("."))
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
