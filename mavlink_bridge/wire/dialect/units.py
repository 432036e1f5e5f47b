"""Formats of numbers and texts in MAVLink fields."""

from __future__ import annotations

import math

UNSET_COORDINATE = 2**31 - 1  # x and y of a mission item without a place
UNKNOWN_HEADING = 0xFFFF


def milliseconds(time: float) -> int:
    """Return a time [s] as uint32 milliseconds, which wrap after 49 days."""
    return round(time * 1e3) & 0xFFFFFFFF


def clipped(value: float, low: int, high: int) -> int:
    """Return the nearest integer in [low, high]; `low` for a value that is not finite."""
    return min(max(round(value), low), high) if math.isfinite(value) else low


def int16(value: float) -> int:
    """Return the nearest integer that fits an int16."""
    return clipped(value, -32768, 32767)


def course(degrees: float) -> int:
    """Return centidegrees in 0 … 35999; a course that rounds to a full turn is north."""
    return round(degrees * 100) % 36000


def coordinate(degrees: float) -> int:
    """Return 1e-7 deg in an int32; MAVLink marks an unset coordinate with the largest value."""
    if not math.isfinite(degrees):
        return UNSET_COORDINATE
    return clipped(degrees * 1e7, -(2**31), UNSET_COORDINATE)


def text(raw: str | bytes) -> str:
    """Return the text of a field; what is no UTF-8 becomes replacement characters."""
    return raw.decode("utf-8", "replace") if isinstance(raw, bytes) else raw
