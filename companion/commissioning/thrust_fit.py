"""Hover thrust and drag from a whole flight, by least squares.

From tick to tick the velocity changes by

    Δv/Δt = R z g (u/h)ⁿ − g z − D (v − w),

with the attitude R that telemetry tells, turned by how wrong it may be, the thrust u that was sent
τ before, the hover thrust h, the exponent n of the thrust curve, drag D along the ground and up,
and the wind's part D w. Position and velocity may be told late. All of these are found together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.commissioning.attitude_curve import AttitudeCurve, rotations_of
from companion.commissioning.least_squares import solve
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.thrust import ThrustMap

PARAMETERS = ("hover", "drag")  # 1 σ of the first is a share
# ln h, n, D along the ground and up [1/s], D w [m/s²], tilt [°], τ [s], lag of the velocity [s]
_FIRST = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.06, 0.03])
_PRIOR = np.array([0.5, 0.3, 0.5, 0.5, 0.7, 0.7, 1.5, 1.5, 0.06, 0.08])
_STEPS = np.array([0.003, 0.01, 0.01, 0.01, 0.01, 0.01, 0.05, 0.05, 0.003, 0.003])
_NOISE = 0.3  # m/s², of an acceleration from tick to tick
_LONGEST = 0.25  # s from tick to tick
_BLOCK = 2.0  # s for which errors may be alike
_LEAST = 60  # ticks
_LAGS = 0.4  # s, longest sum of delay and lag


@dataclass(frozen=True)
class ThrustFit:
    """Hover thrust and drag [1/s], 1 σ of each, and the hover thrusts of the flight's halves."""

    values: Vector
    sigmas: Vector
    halves: Vector


def fit_thrust(
    ticks: Sequence[dict[str, Any]],
    curve: AttitudeCurve,
    velocity: tuple[Vector, Vector],
    exponent: float | None,
) -> ThrustFit | None:
    """Return hover thrust and drag; None where the flight is too short.

    ticks: records of the ticks at which the companion flew. velocity: times (n,) s and velocities
    (n,3) m/s, world. exponent: of the thrust curve, as configured; None: it is not.
    """
    steps = _Steps(ticks, curve, velocity)
    if steps.count < _LEAST:
        return None
    first, prior = _FIRST.copy(), _PRIOR.copy()
    first[0] = np.log(ticks[-1]["hover_thrust"])
    if exponent is not None:
        first[1], prior[1] = exponent, 0.1
    fit = solve(steps, first, first, prior, _STEPS)
    middle = float(np.median(steps.times))
    halves = [
        solve(steps.chosen(chosen), fit.values, first, prior, _STEPS).values
        for chosen in (steps.times <= middle, steps.times > middle)
    ]
    sigmas = np.sqrt(np.diag(fit.covariance))
    values = np.array([np.exp(fit.values[0]), fit.values[2]])
    made = np.array([[np.exp(h[0]), h[2]] for h in halves])
    return ThrustFit(values, sigmas[[0, 2]], made)


class _Steps:
    """The steps from tick to tick as a problem of least squares; see `least_squares.Problem`."""

    def __init__(
        self,
        ticks: Sequence[dict[str, Any]],
        curve: AttitudeCurve,
        velocity: tuple[Vector, Vector],
    ) -> None:
        self._curve = curve
        sent = np.array([t["time"] for t in ticks])
        thrust = [
            ThrustMap(t["hover_thrust"], t["hover"]["exponent"]).to_thrust(t["command"]["c"])
            for t in ticks
        ]
        # What was sent until a time: its slope is the thrust that is held until the next tick.
        self._sent = sent
        held = np.minimum(np.diff(sent, append=sent[-1] + 0.1), _LONGEST)
        self._until = np.concatenate([[0.0], np.cumsum(np.array(thrust) * held)])
        self._grid = np.append(sent, sent[-1] + held[-1])
        near = np.diff(sent) < _LONGEST
        start, end = sent[:-1], sent[1:]
        times, v = velocity
        known = near & (start > sent[0] + _LAGS) & (start > times[0]) & (end < times[-1])
        known &= curve.known(start - _LAGS) & curve.known(end)
        self._start: Vector = start[known]
        self._end: Vector = end[known]
        then, now = (
            np.stack([np.interp(t, times, c) for c in v.T], axis=1)
            for t in (self._start, self._end)
        )
        self._told = (now - then) / (self._end - self._start)[:, None]
        self._velocity = 0.5 * (now + then)

    @property
    def count(self) -> int:
        """Number of steps."""
        return len(self._start)

    @property
    def times(self) -> Vector:
        """(n,) s, at which each step begins."""
        return self._start

    @property
    def blocks(self) -> NDArray[np.int64]:
        """(n,) number of the block of time of each step."""
        return np.floor(self._start / _BLOCK).astype(np.int64)

    def chosen(self, kept: NDArray[np.bool_]) -> _Steps:
        """Return the problem with some of the steps alone."""
        other = _Steps.__new__(_Steps)
        other.__dict__.update(self.__dict__)
        for name in ("_start", "_end", "_told", "_velocity"):
            setattr(other, name, getattr(self, name)[kept])
        return other

    def residuals(self, values: Vector) -> tuple[Vector, Vector]:
        """Return the misses (3,n) m/s² of the acceleration, world, and their variances."""
        log_hover, exponent, drag, drag_up, east, north, roll, pitch, delay, lag = values
        late = max(delay, 0.0)
        sent = [np.interp(t - late, self._grid, self._until) for t in (self._start, self._end)]
        mean = np.maximum((sent[1] - sent[0]) / (self._end - self._start), 1e-3)
        lift = GRAVITY * np.exp(exponent * (np.log(mean) - log_hover))
        tilt = rotations_of(np.radians([[roll, pitch, 0.0]]))[0]
        axes = [
            (self._curve.at(self._start + share * (self._end - self._start) - lag) @ tilt)[:, :, 2]
            for share in (0.0, 0.5, 1.0)
        ]
        axis = (axes[0] + 4.0 * axes[1] + axes[2]) / 6.0
        drags = np.array([drag, drag, drag_up]) * self._velocity
        expected = lift[:, None] * axis - drags + np.array([east, north, -GRAVITY])
        misses: Vector = (self._told - expected).T
        return misses, np.full(misses.shape, _NOISE**2)
