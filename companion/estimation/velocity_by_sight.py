"""Errors of the own velocity, as the ground in the pictures shows them.

An autopilot that is sure of a wrong velocity sums it up into a wrong position: the two agree, and
nothing that it tells shows the error. The ground does (`ground_flow.py`): its flow, averaged over a
few pictures, less the told velocity. The velocity is corrected by no more than what is beyond
doubt: by the share of an estimate that is larger than its noise (the positive part of James and
Stein's), so that a right velocity is left alone.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from companion.estimation.height import Height
from companion.perception.ground_flow import GroundFlow
from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.wire.messages import VehicleState

_AVERAGED = 0.25  # s over which flows are averaged: two or three pictures
_NOISE = 0.1  # m/s, 1 σ of that mean: attitude and timing while the drone turns
# An estimator whose tilt or accelerometer is wrong by 0.15 to 0.3 m/s² (1 to 2° of tilt) is wrong
# by half a metre a second within seconds: 2 σ of an error that comes and goes in as long.
_WRONG, _LASTS = 0.3, 5.0  # m/s, 1 σ, and s
_SCALE = 0.05  # of the flow, 1 σ: feet of trunks pass faster than the ground
_OUTLIER = 0.5  # m/s that an error can change from picture to picture; more is no ground
_SURE = 2.0  # standard deviations up to which an estimate may be noise
_HARMLESS = 0.15  # m/s that fly well
_REMEMBERED = 32  # corrections: three seconds
_LONGEST_GAP = 0.25  # s between two pictures


@dataclass(frozen=True)
class VelocityBySight:
    """The error of the velocity that telemetry tells, as the pictures show it.

    value: (3,) m/s; sigma: m/s, its largest 1 σ. correction: (3,) m/s, the part that is
    beyond doubt, to be added to the told velocity.
    """

    value: Vector = field(default_factory=lambda: np.zeros(3))
    sigma: float = _WRONG
    correction: Vector = field(default_factory=lambda: np.zeros(3))


class VelocityFromGround:
    """Follows what the told velocity lacks; `decide` once a tick, `see` for each flow."""

    def __init__(self) -> None:
        self._value: Vector = np.zeros(2)
        self._scale: Vector = np.zeros(2)  # m/s, 1 σ along the way, by its scale
        self._turned = 0.0  # m/s, 1 σ, by a wrong heading
        self._time = -math.inf
        self._made: deque[tuple[float, Vector]] = deque([(-math.inf, np.zeros(2))], _REMEMBERED)

    def see(
        self,
        flow: GroundFlow,
        before: VehicleState,
        after: VehicleState,
        height: Height,
        yaw: float = 0.0,
    ) -> None:
        """Take in a way over the ground.

        before, after: the states, as corrected, at its ends. yaw: rad, 1 σ, which turns it.
        """
        dt = flow.after - flow.before
        if not 0.0 < dt < _LONGEST_GAP or flow.after <= self._time:
            return
        seen = flow.way / dt
        told = 0.5 * (before.v + after.v)[:2] - self._corrected(flow.before, flow.after)
        self._value = self._value * self._kept(flow.after)
        off = seen - told - self._value
        off = off * min(1.0, _OUTLIER / max(norm(off), 1e-9))
        self._value = self._value + (1.0 - math.exp(-dt / _AVERAGED)) * off
        self._scale = math.hypot(height.sigma / flow.height, _SCALE) * seen
        self._turned = yaw * norm(seen)
        self._time = flow.after

    def decide(self, time: float) -> VelocityBySight:
        """Return what is made of it at the tick of `time` [s]; the correction holds from then."""
        kept = self._kept(time)
        value = kept * self._value
        noise = math.hypot(_NOISE, self._turned, _WRONG * math.sqrt(1.0 - kept**2))
        correction = beyond_doubt(value, noise, self._scale) * value
        if (correction != self._made[-1][1]).any():
            self._made.append((time, correction))
        sigma = math.hypot(noise, norm(self._scale))
        return VelocityBySight(np.append(value, 0.0), sigma, np.append(correction, 0.0))

    def _kept(self, time: float) -> float:
        """Return the share of an error that is left at `time` [s], unseen since the last flow."""
        return math.exp(-max(time - self._time, 0.0) / _LASTS)

    def _corrected(self, start: float, end: float) -> Vector:
        """Return the mean correction (2,) m/s from `start` to `end` [s]."""
        way, until = np.zeros(2), end
        for time, correction in reversed(self._made):
            if time < until:
                way = way + (until - max(start, time)) * correction
                until = max(start, time)
            if until <= start:
                break
        return way / (end - start)


def beyond_doubt(value: Vector, noise: float, along: Vector) -> float:
    """Return the share 0…1 of an estimate (2,) m/s that is no noise.

    noise: m/s, 1 σ in any direction. along: (2,) m/s, a further 1 σ in its own direction.
    """
    size = norm(value)
    # Its square in standard deviations, by the inverse of noise² 1 + along alongᵀ.
    part = float(value @ along) ** 2 / (noise**2 + float(along @ along))
    sigmas = (size**2 - part) / noise**2
    doubt = max(_SURE**2 / max(sigmas, 1e-9), (_HARMLESS / max(size, 1e-9)) ** 2)
    return max(0.0, 1.0 - doubt)
