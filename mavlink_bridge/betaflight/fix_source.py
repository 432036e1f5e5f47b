"""Which of two GPS receivers is believed: the board's own, or one whose fixes come as GPS_INPUT."""

from __future__ import annotations

import math

import numpy as np

from mavlink_bridge.betaflight.msp import RawGps
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.wire.ids import GpsFix
from mavlink_bridge.wire.messages import GpsInput

_BOARD, _INPUT = "the board's receiver", "GPS_INPUT"
_SPEED_MAX = 100.0  # m/s; a faster GPS velocity is an error


class FixSource:
    """One source at a time: two receivers disagree by metres, and the vehicle would jump."""

    def __init__(self, silent: float) -> None:
        """silent: s after the last fix of the one in use from which another may take over."""
        self._silent = silent
        self._name, self._at = "", -math.inf

    def _uses(self, time: float, name: str) -> bool:
        """Return whether a fix that this source gives at `time` [s] is to be used."""
        if name != self._name and time - self._at <= self._silent:
            return False
        self._name, self._at = name, time
        return True

    def uses_input(self, time: float, fix: GpsInput) -> bool:
        """Return the same of GPS_INPUT."""
        return fix.fix_type >= GpsFix.FIX_3D and _credible(fix.v) and self._uses(time, _INPUT)

    def uses_board(self, time: float, gps: RawGps | None) -> bool:
        """Return the same of the board's; without a receiver it may report a fix at 0, 0."""
        if gps is None or not gps.fix or not (gps.latitude_deg or gps.longitude_deg):
            return False
        return self._uses(time, _BOARD)


def _credible(v: Vector | None) -> bool:
    """Return whether a vehicle can have this velocity [m/s]; True for None."""
    return v is None or bool((np.abs(v) <= _SPEED_MAX).all())  # False for NaN
