"""Hover thrust: the normalised thrust that carries the drone, learnt in flight.

The thrust in effect is compared with the acceleration that it really gave along the body's z axis.
"""

from __future__ import annotations

import numpy as np

from companion.estimation.input_history import InputHistory
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.shared.thrust import HoverThrustEstimator, ThrustMap
from mavlink_bridge.wire.messages import VehicleState

_LONGEST_GAP = 0.25  # s between two observations that still belong together
_UP = np.array([0.0, 0.0, 1.0])


class HoverThrust:
    """Estimates the hover thrust; `map` turns collective acceleration into thrust by it."""

    def __init__(self, prior: ThrustMap, history: InputHistory) -> None:
        """prior: as configured."""
        self._estimator = HoverThrustEstimator(prior)
        self._history = history
        self._before: tuple[VehicleState, int] | None = None  # state, epoch of the inputs

    @property
    def map(self) -> ThrustMap:
        """Thrust for an acceleration, by the present estimate."""
        return self._estimator.map

    def update(self, own: VehicleState) -> ThrustMap:
        """Learn from the motion since the last tick; once a tick. Return the new map."""
        known, self._before = self._before, (own, self._history.epoch)
        if known is None or known[1] != self._history.epoch:
            return self.map
        before = known[0]
        if not 0.0 < own.time - before.time < _LONGEST_GAP:
            return self.map
        thrust = self._in_effect(before.time, own.time)
        if thrust is not None:
            dt = own.time - before.time
            force: Vector = (own.v - before.v) / dt + GRAVITY * _UP
            axis = rotation_matrix(before.q_wb)[:, 2] + rotation_matrix(own.q_wb)[:, 2]
            c = float(force @ axis / np.linalg.norm(axis))
            self._estimator = self._estimator.update(thrust, c, dt)
        return self.map

    def _in_effect(self, start: float, end: float) -> float | None:
        """Return the mean thrust that acted from `start` to `end` [s]; None: not all was ours."""
        total, until = 0.0, end
        for sent in reversed(self._history):
            acts = max(sent.time + self._history.delay, start)
            if acts < until:
                total += sent.thrust * (until - acts)
                until = acts
            if until <= start:
                return total / (end - start)
        return None
