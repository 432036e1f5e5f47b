"""Own state where only ATTITUDE and GLOBAL_POSITION_INT come: plain Betaflight telemetry.

Betaflight's angles come in steps of 0.1° and its body rates are zero. Its GLOBAL_POSITION_INT is
stamped in microseconds where milliseconds belong; before 2025.12 its velocity is zero. So the
angles give the body rates, ATTITUDE gives the time, and the positions give what velocity they can.
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

# Positions come a few times a second, and only the velocity carries them in between.
_GAINS = CoarseGains(
    tilt=0.5,
    heading=0.5,
    heading_step=CoarseGains().tilt_step,
    height=0.4,
    climb=0.5,
    baro_age=0.0,
    gps_age=0.0,
)


class CoarseTelemetry:
    """Turns coarse messages into the fine ones from which the own state is made."""

    def __init__(self) -> None:
        self._state = CoarseState(_GAINS, jumps=False)
        self._time: float | None = None
        self._has_position = False

    def add(self, message: Message) -> list[Attitude | LocalPosition]:
        """Return the attitude and position that follow from a message; empty where none do."""
        if isinstance(message, GlobalPosition):
            self._add_position(message)
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

    def _add_position(self, g: GlobalPosition) -> None:
        """Correct the filter by a position; its first height is the ground's."""
        if self._time is None:
            return
        v = g.v[:2] if g.v.any() else None
        self._state.gps(g.latitude_deg, g.longitude_deg, v)
        self._state.height(g.altitude, resting=not self._has_position)
        self._has_position = True
