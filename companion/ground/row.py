"""What `companion fleet` tells of one vehicle."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Row:
    """The result of an action for one vehicle, and the vehicle's state after it.

    height: m above the place of take-off. None and empty: the vehicle did not tell.
    """

    drone: str
    system: int
    result: str = "not found"
    ok: bool = False
    armed: bool | None = None
    mode: str = ""
    height: float | None = None
    battery_percent: float | None = None
