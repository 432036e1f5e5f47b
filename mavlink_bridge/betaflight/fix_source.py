"""Which of two GPS receivers is believed: the board's own, or one whose fixes come as GPS_INPUT."""

from __future__ import annotations

import math

from mavlink_bridge.betaflight.msp import RawGps

BOARD, INPUT = "the board's receiver", "GPS_INPUT"


class FixSource:
    """One source at a time: two receivers disagree by metres, and the vehicle would jump."""

    def __init__(self, silent: float) -> None:
        """silent: s after the last fix of the one in use from which another may take over."""
        self._silent = silent
        self._name, self._at = "", -math.inf

    def uses(self, time: float, name: str) -> bool:
        """Return whether a fix that this source gives at `time` [s] is to be used."""
        if name != self._name and time - self._at <= self._silent:
            return False
        self._name, self._at = name, time
        return True

    def uses_board(self, time: float, gps: RawGps | None) -> bool:
        """Return the same of the board's; without a receiver it may report a fix at 0, 0."""
        if gps is None or not gps.fix or not (gps.latitude_deg or gps.longitude_deg):
            return False
        return self.uses(time, BOARD)
