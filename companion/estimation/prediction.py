"""Prediction: where the drone will be when the next input takes effect.

An input acts only `delay` after its tick. The inputs that were sent are remembered, so that the
state is carried over the delay under the inputs really in flight. The error of the same prediction
over the last tick is the disturbance: drag, wind, thrust scale.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.estimation.input_history import InputHistory
from companion.model import HOVER, observed_disturbance, predict
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import VehicleState

# A hovering vehicle tilts less than this [cosine]; more is a manoeuvre, or an upset.
_UPRIGHT = 0.8
# Two observations farther apart than this [s] say nothing of the disturbance.
_LONGEST_GAP = 0.25


@dataclass(frozen=True)
class Prediction:
    """What the controller plans from.

    x0: (10,) p, v, q at which this tick's input takes effect. u_last: (4,) the last input sent.
    disturbance: (3,) m/s², world ENU, which the model knows nothing of. delay: s from the tick to
    x0.
    """

    x0: Vector
    u_last: Vector
    disturbance: Vector
    delay: float


class StatePredictor:
    """Carries the own state over the delay, and observes the disturbance (3,) m/s²."""

    def __init__(self, history: InputHistory, drag: float = 0.0) -> None:
        """drag: 1/s, along the ground; the disturbance is then what it does not explain."""
        self.disturbance: Vector = np.zeros(3)
        self._drag = np.array([drag, drag, 0.0])
        self._history = history
        self._before: tuple[float, Vector, int] | None = None  # time, state, epoch of the inputs

    def update(self, own: VehicleState) -> Prediction:
        """Observe the disturbance from the motion since the last tick, then predict; once a tick.

        Return the prediction for this tick's input.
        """
        self.observe(own)
        delay = self._history.delay
        outside = self._outside(own.v)
        return Prediction(self.ahead(own), self._history.u_last, outside, delay)

    def observe(self, own: VehicleState) -> None:
        """Correct the disturbance by the error of the last tick's prediction."""
        x, epoch = state_vector(own), self._history.epoch
        if self._before is not None and self._before[2] == epoch and len(self._history):
            then, x_then, _ = self._before
            if 0.0 < own.time - then < _LONGEST_GAP:
                expected = self._flow(x_then, then, own.time)
                self.disturbance = observed_disturbance(
                    self.disturbance, expected[3:6], own.v, own.time - then
                )
        self._before = own.time, x, epoch

    def watch(self, own: VehicleState) -> None:
        """Observe the disturbance while the autopilot flies, whose thrust is not known.

        It carries the weight along an axis that is known: what else that axis pushes and does not
        move the vehicle, the wind holds against. So the first command knows the wind already.
        """
        x, axis = state_vector(own), rotation_matrix(own.q_wb)[:, 2]
        if self._before is not None and axis[2] > _UPRIGHT:
            then, x_then, _ = self._before
            dt = own.time - then
            if 0.0 < dt < _LONGEST_GAP:
                climb = float(own.v[2] - x_then[5]) / dt
                thrust = np.array([max(HOVER[0] + climb, 0.0) / axis[2], 0.0, 0.0, 0.0])
                expected = predict(x_then, thrust, dt, self._outside(x_then[3:6]))
                level = np.array([expected[3], expected[4], own.v[2]])
                self.disturbance = observed_disturbance(self.disturbance, level, own.v, dt)
        self._before = own.time, x, self._history.epoch

    def ahead(self, own: VehicleState) -> Vector:
        """Return the (10,) state p, v, q at which the input of this tick takes effect."""
        return self._flow(state_vector(own), own.time, own.time + self._history.delay)

    def carried(self, own: VehicleState, time: float) -> VehicleState:
        """Return a past state carried to `time` [s] by the model and the inputs sent since."""
        x = self._flow(state_vector(own), own.time, time)
        return VehicleState(time, x[:3], x[3:6], x[6:10], self._history.u_last[1:4])

    def _flow(self, x: Vector, start: float, end: float) -> Vector:
        """Return x (10,) carried from `start` to `end` [s] under each input while it acts."""
        u, later = self._history.acting(start, end)
        for acts, following in later:
            x = predict(x, u, acts - start, self._outside(x[3:6]))
            start, u = acts, following
        return predict(x, u, end - start, self._outside(x[3:6]))

    def _outside(self, v: Vector) -> Vector:
        """Return the acceleration (3,) m/s², drag and disturbance, at a velocity (3,) m/s."""
        return self.disturbance - self._drag * v if self._drag.any() else self.disturbance


def state_vector(own: VehicleState) -> Vector:
    """Return the (10,) state p, v, q of the NMPC for a vehicle's state."""
    return np.concatenate([own.p, own.v, own.q_wb])
