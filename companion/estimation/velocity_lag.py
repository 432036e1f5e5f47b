"""Lag of the reported position and velocity behind the motion, measured against the attitude.

An estimator with a GPS whose delay it does not know reports a velocity that follows slowly:

    v_told = v − L a_slow,    p_told = p − L v_slow,

with the lag L and the low-passed acceleration and velocity: over shorter times it believes its
inertial sensors. The attitude is not late, and the tilt tells the acceleration along the ground.
From one tick to the next, on each axis,

    Δv_told − a dt = −L Δa_slow − d v dt + b dt,

with the drag d, and b for wind and for an error of the tilt. Recursive least squares find all four.
What is left is noise, unless the told velocity steps: its estimator has followed a GPS signal that
took another path, or has found out an error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import VehicleState

_SLOW = 0.5  # s of the low-pass: an estimator believes its accelerometer about so long
_MEMORY = 20.0  # s
_NOISE = 0.04  # m/s, least 1 σ of a change of velocity from tick to tick
_PRIOR = np.array([0.1, 0.3, 0.5, 0.5])  # 1 σ of L [s], d [1/s] and b [m/s²]
_DRIFT = np.array([0.002, 0.0, 0.1, 0.1])  # of the same, a root second
_DRIFTED = np.diag(_DRIFT**2)  # covariance, a second
_LARGEST = float((_PRIOR**2).max())  # variance
_LONGEST_GAP = 0.25  # s between two states that still belong together
_LIFT = (0.3, 2.0)  # shares of g; with another lift the tilt does not tell the acceleration
_SURE = 2.5  # standard deviations from none, from which a lag is believed
_HARMLESS, _MOST = 0.03, 0.3  # s
_STEP, _STEP_SIGMAS = 0.25, 4.5  # m/s, and standard deviations: more is a step; gusts make 0.15


@dataclass(frozen=True)
class Lag:
    """Lag of position and velocity [s], 1 σ [s]; what they miss: m and m/s, each (3,)."""

    value: float
    sigma: float
    position: Vector
    velocity: Vector

    def made_up(self, state: VehicleState) -> VehicleState:
        """Return a state of about now without the lag."""
        if self.value == 0.0:
            return state
        return replace(state, p=state.p + self.position, v=state.v + self.velocity)


@dataclass(frozen=True)
class Step:
    """A step of the told velocity along the ground, (2,) m/s, between two times [s]."""

    change: Vector
    since: float
    until: float


class VelocityLag:
    """Estimates the lag; one `update` a tick.

    lag: the present estimate; a lag that may be none, or does no harm, is none. step: by which the
    told velocity has just stepped; None: it has not.
    """

    def __init__(self) -> None:
        self._x: Vector = np.zeros(4)  # L, d, b east and north
        self._p: Vector = np.diag(_PRIOR**2)
        self._noise = _NOISE**2
        self.step: Step | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the motion; what was learnt stays."""
        self._before: VehicleState | None = None
        self._acceleration: Vector = np.zeros(3)  # low-passed
        self._velocity: Vector = np.zeros(3)
        self.lag = self._estimate()

    def _estimate(self) -> Lag:
        """Return the lag and what position and velocity miss by it."""
        value, sigma = float(self._x[0]), math.sqrt(self._p[0, 0])
        if value < max(_SURE * sigma, _HARMLESS):
            value = 0.0
        value = min(value, _MOST)
        # A tilt that holds against wind and drag accelerates nothing.
        gained = self._acceleration.copy()
        gained[:2] += self._x[2:4] - self._x[1] * self._velocity[:2]
        return Lag(value, sigma, value * self._velocity, value * gained)

    def update(self, own: VehicleState | None, flying: bool) -> Lag:
        """Take in the state as the autopilot tells it; flying: it is carried by its rotors."""
        before, self._before, self.step = self._before, own, None
        if own is None or before is None or not 0.0 < own.time - before.time < _LONGEST_GAP:
            self.reset()
            self._before = own
            return self.lag
        dt = own.time - before.time
        told = (own.v - before.v) / dt
        axis = rotation_matrix(before.q_wb)[:, 2] + rotation_matrix(own.q_wb)[:, 2]
        axis = axis / norm(axis)
        lift = (GRAVITY + float(told[2])) / max(float(axis[2]), 0.3)
        if not flying or not _LIFT[0] < lift / GRAVITY < _LIFT[1]:
            self.reset()
            self._before = own
            return self.lag
        a = np.array([lift * axis[0], lift * axis[1], told[2]])
        share = 1.0 - math.exp(-dt / _SLOW)
        slower = share * (a - self._acceleration)
        self._acceleration = self._acceleration + slower
        self._velocity = self._velocity + share * (own.v - self._velocity)
        change = self._learn((told - a)[:2] * dt, slower[:2], own.v[:2], dt)
        if change is not None:
            self.step = Step(change, before.time, own.time)
        self.lag = self._estimate()
        return self.lag

    def corrected(self, own: VehicleState) -> None:
        """Go on from this state: the step is taken out of it, and will be from the next ones."""
        self._before = own

    def _learn(self, missing: Vector, slower: Vector, v: Vector, dt: float) -> Vector | None:
        """Take in what the tilt does not explain of a change of velocity (2,) m/s.

        Return what is left of it where that is a step, of which nothing is learnt.
        """
        p = self._p * math.exp(dt / _MEMORY) + _DRIFTED * dt
        # Rows and columns alike: with its elements bounded each, it is no covariance any more.
        shrunk = np.sqrt(np.minimum(1.0, _LARGEST / np.diagonal(p)))
        self._p = p * (shrunk[:, None] * shrunk)
        rows = np.zeros((2, 4))
        rows[:, 0], rows[:, 1], rows[0, 2], rows[1, 3] = -slower, -v * dt, dt, dt
        errors = missing - rows @ self._x
        variance = float(np.trace(rows @ self._p @ rows.T)) + 2.0 * max(self._noise, _NOISE**2)
        if norm(errors) > max(_STEP, _STEP_SIGMAS * math.sqrt(variance)):
            return errors
        for k in range(2):
            row = rows[k]
            error = float(missing[k] - row @ self._x)
            self._noise += dt / _MEMORY * (error**2 - self._noise)
            noise = max(self._noise, _NOISE**2)
            gain = self._p @ row / (float(row @ self._p @ row) + noise)
            bound = 3.0 * math.sqrt(float(row @ self._p @ row) + noise)
            self._x = self._x + gain * min(max(error, -bound), bound)
            p = self._p - gain[:, None] * (row @ self._p)
            self._p = 0.5 * (p + p.T)
        return None
