"""The thrust that carries the drone, learnt from what the thrust in effect really gave."""

from __future__ import annotations

from collections import deque

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.shared.thrust import G, HoverThrustEstimator, ThrustMap
from mavlink_bridge.wire.messages import VehicleState

_LONGEST_GAP = 0.25  # s between two looks that still belong together
_KEPT = 64  # inputs: the longest delay and gap at the shortest period
_UP = np.array([0.0, 0.0, 1.0])


class Lift:
    """Hover thrust in flight; `map` turns collective acceleration into thrust by it."""

    def __init__(self, start: ThrustMap, delay: float) -> None:
        """start: as configured. delay: s from a tick to its effect."""
        self._estimator = HoverThrustEstimator(start)
        self._delay = delay
        self._sent: deque[tuple[float, float]] = deque(maxlen=_KEPT)
        self._before: VehicleState | None = None

    @property
    def map(self) -> ThrustMap:
        """Thrust for an acceleration, by the present estimate."""
        return self._estimator.map

    def sent(self, time: float, thrust: float) -> None:
        """`thrust` 0…1 was sent at the tick of `time` [s]."""
        self._sent.append((time, thrust))

    def forget(self) -> None:
        """Somebody else flies: what happens is not by our thrust."""
        self._sent.clear()
        self._before = None

    def observe(self, own: VehicleState) -> None:
        """Learn from the motion since the last tick; once a tick."""
        before, self._before = self._before, own
        if before is None or not 0.0 < own.time - before.time < _LONGEST_GAP:
            return
        thrust = self._in_effect(before.time, own.time)
        if thrust is not None:
            dt = own.time - before.time
            force: Vector = (own.v - before.v) / dt + G * _UP
            axis = rotation_matrix(before.q_wb)[:, 2] + rotation_matrix(own.q_wb)[:, 2]
            c = float(force @ axis / np.linalg.norm(axis))
            self._estimator = self._estimator.update(thrust, c, dt)

    def _in_effect(self, start: float, end: float) -> float | None:
        """Mean thrust that acted from `start` to `end` [s]; None where it was not all ours."""
        total, until = 0.0, end
        for time, thrust in reversed(self._sent):
            acts = max(time + self._delay, start)
            if acts < until:
                total += thrust * (until - acts)
                until = acts
            if until <= start:
                return total / (end - start)
        return None
