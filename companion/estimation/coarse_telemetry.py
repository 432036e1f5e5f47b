"""Own state where ATTITUDE and GLOBAL_POSITION_INT are all there is: plain Betaflight telemetry.

Its angles come in steps of 0.1°, its body rates are zero, and its GLOBAL_POSITION_INT is stamped
in microseconds where milliseconds belong (and before 2025.12 its velocity is zero): so angles
give the rates, ATTITUDE gives the time, and positions give what velocity they can.
"""

from __future__ import annotations

import numpy as np

from mavlink_bridge.betaflight.coarse_state import CoarseGains, CoarseState
from mavlink_bridge.shared.frames import euler_from_quaternion
from mavlink_bridge.wire.messages import (
    Attitude,
    EulerAttitude,
    GlobalPosition,
    LocalPosition,
    Message,
)

# Few positions a second, and nothing to carry them by but the velocity.
_GAINS = CoarseGains(
    tilt=0.5, heading=0.5, heading_step=CoarseGains().tilt_step, height=0.4, climb=0.5,
    baro_age=0.0, gps_age=0.0,
)  # fmt: skip


class CoarseTelemetry:
    """Turns coarse messages into the fine ones that the own state is made of."""

    def __init__(self) -> None:
        self._state = CoarseState(_GAINS, jumps=False)
        self._time: float | None = None
        self._seen = False

    def add(self, message: Message) -> list[Attitude | LocalPosition]:
        """What follows from a message; empty for what is of no use here."""
        if isinstance(message, GlobalPosition):
            self._place(message)
            return []
        if not isinstance(message, EulerAttitude) or not np.isfinite(message.q_wb).all():
            return []
        dt = 0.0 if self._time is None else message.time - self._time
        if self._time is not None and dt <= 0.0:
            return []
        self._time = message.time
        self._state.advance(message.time)
        self._state.angles(*euler_from_quaternion(message.q_wb), dt)
        now = self._state.at(message.time)
        if now is None:
            return []
        return [
            Attitude(now.time, now.q_wb, now.omega),
            LocalPosition(now.time, now.p, now.v),
        ]

    def _place(self, g: GlobalPosition) -> None:
        if self._time is None:
            return
        v = g.v[:2] if g.v.any() else None
        self._state.gps(g.latitude_deg, g.longitude_deg, v)
        self._state.height(g.altitude, resting=not self._seen)
        self._seen = True
