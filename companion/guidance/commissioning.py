"""Commissioning: half a minute of small moves on the spot, by which a drone gets to know itself.

Roll, pitch and yaw must all be turned about, and thrust and speed must change, or a mounting angle,
a delay or the drag stays unknown. The moves stay within 0.9 m of where the flight began.
"""

from __future__ import annotations

import math

import numpy as np

from companion.guidance.mission import MissionProgress
from companion.model import yaw_of
from mavlink_bridge.wire.messages import VehicleState

_HOVER = 2.0  # s before and after the moves
_MOVE = 1.3  # s from one target to the next
_ALONG, _UP = 0.8, 0.35  # m off the start
_MOVES = (
    [(1, 0, 0), (-1, 0, 0)] * 2
    + [(0, 1, 0), (0, -1, 0)] * 2
    + [(0, 0, 1), (0, 0, -1)] * 2
    + [(1, 1, 1), (-1, -1, -1), (1, -1, 1), (-1, 1, -1)] * 2
)  # forward, left, up, as the drone looked at the start
_SWING, _RATE = 0.8, 2.0 * math.pi * 0.3  # rad, and rad/s, of the yaw to and fro
DURATION = 2.0 * _HOVER + _MOVE * len(_MOVES)


class Commissioning:
    """Leads through the moves; takes the place of a mission and of the gaze."""

    def __init__(self) -> None:
        self._start: VehicleState | None = None

    def update(self, own: VehicleState, surveyed: bool = True) -> MissionProgress:
        """Return where to fly at the time of the own state; the first call begins the moves."""
        self._start = self._start or own
        n = math.floor((self._since(own.time) - _HOVER) / _MOVE)
        offset = np.zeros(3)
        if 0 <= n < len(_MOVES):
            forward, left, up = _MOVES[n]
            yaw = yaw_of(self._start.q_wb)
            c, s = _ALONG * math.cos(yaw), _ALONG * math.sin(yaw)
            offset = np.array([c * forward - s * left, s * forward + c * left, _UP * up])
        done = self._since(own.time) > DURATION
        return MissionProgress(self._start.p + offset, min(max(n + 1, 0), len(_MOVES)), done)

    def yaw(self, time: float) -> float:
        """Return the line of sight ψ [rad] at `time` [s]."""
        if self._start is None:
            return 0.0
        moving = min(max(self._since(time) - _HOVER, 0.0), _MOVE * len(_MOVES))
        return yaw_of(self._start.q_wb) + _SWING * math.sin(_RATE * moving)

    def _since(self, time: float) -> float:
        """Return the time [s] since the moves began; none where the clock began anew."""
        assert self._start is not None
        return max(time - self._start.time, 0.0)
