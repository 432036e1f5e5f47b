"""Where the drone will be when the next input takes effect, and what the model leaves out.

An input acts only `delay` after its tick (compute, transport, rate loop). What was sent is
remembered, so that the state is carried over the delay under the inputs really in flight.
How wrong the same forecast was over the last tick is the disturbance: drag, wind, thrust scale.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from companion.model import HOVER, observed_disturbance, predict
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.wire.messages import VehicleState

# Between two looks farther apart than this [s] the forecast says nothing of the disturbance.
_LONGEST_GAP = 0.25
_KEPT = 64  # inputs: the longest delay and age at the shortest period


class Forecast:
    """Inputs in flight [(time s, u (4,))] and the disturbance (3,) m/s², world ENU."""

    def __init__(self, delay: float) -> None:
        self.disturbance: Vector = np.zeros(3)
        self._delay = delay
        self._sent: deque[tuple[float, Vector]] = deque(maxlen=_KEPT)
        self._before: tuple[float, Vector] | None = None

    @property
    def u_last(self) -> Vector:
        """(4,) the last input sent; hover where none was."""
        return self._sent[-1][1] if self._sent else HOVER

    def sent(self, time: float, u: Vector) -> None:
        """Input u (4,) was sent at the tick of `time` [s]."""
        self._sent.append((time, u))

    def forget(self) -> None:
        """Somebody else flies: nothing of ours is in flight, and no error is ours to learn."""
        self._sent.clear()
        self._before = None

    def observe(self, own: VehicleState) -> None:
        """Correct the disturbance by what came of the last tick's forecast; once a tick."""
        x = state(own)
        if self._before is not None and self._sent:
            then, x_then = self._before
            if 0.0 < own.time - then < _LONGEST_GAP:
                expected = self._flow(x_then, then, own.time)
                self.disturbance = observed_disturbance(
                    self.disturbance, expected[3:6], own.v, own.time - then
                )
        self._before = own.time, x

    def ahead(self, own: VehicleState) -> Vector:
        """(10,) state p, v, q at which the input of this tick takes effect."""
        return self._flow(state(own), own.time, own.time + self._delay)

    def carried(self, own: VehicleState, time: float) -> VehicleState:
        """A state known then, carried to `time` [s] by the model and what was sent since."""
        x = self._flow(state(own), own.time, time)
        return VehicleState(time, x[:3], x[3:6], x[6:10], self.u_last[1:4])

    def _flow(self, x: Vector, start: float, end: float) -> Vector:
        """X (10,) carried from `start` to `end` [s] under each input while it acts."""
        u = HOVER if not self._sent else self._sent[0][1]
        for sent, following in self._sent:
            acts = sent + self._delay
            if acts >= end:
                break
            if acts > start:
                x = predict(x, u, acts - start, self.disturbance)
                start = acts
            u = following
        return predict(x, u, end - start, self.disturbance)


def state(own: VehicleState) -> Vector:
    """(10,) the NMPC's state of a vehicle's."""
    return np.concatenate([own.p, own.v, own.q_wb])
