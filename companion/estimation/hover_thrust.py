"""Hover thrust: the normalised thrust that carries the drone, with its doubt.

A Kalman filter of its logarithm, and of the exponent of force over thrust near it. Before the
takeover it learns from the thrust that the autopilot itself flies with (ATTITUDE_TARGET),
afterwards from ours: the thrust in effect is compared with the acceleration that it really gave
along the body's z axis. The prior is the configuration, joined with the autopilot's own parameters.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from companion.estimation.autopilot_thrust import AutopilotThrust
from companion.estimation.input_history import InputHistory
from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.shared.thrust import HOVER_MAX, HOVER_MIN, ThrustMap, exponent_of_curve
from mavlink_bridge.wire.messages import VehicleState

KNOWN = 0.05  # share of the hover thrust, one sigma, from which on it is good enough to take over
_PARAMETER = 0.2  # one sigma of the autopilot's parameter, as a share: nobody keeps it up to date
_CURVE_CONFIGURED, _CURVE_TOLD, _CURVE_ASSUMED = 0.1, 0.4, 0.3  # one sigma of the exponent
_DRIFT = (0.01, 0.005)  # a root second, of both: battery, temperature
_DRIFTED = np.diag(_DRIFT) ** 2  # covariance, a second
_EXPONENTS = (1.0, 2.0)  # of motors in proportion and in the square
_NOISE, _FIRST_NOISE = 0.05, 0.15  # of an observation, as a share: least, and before any is known
_NOISE_TIME, _MEAN_TIME = 2.0, 0.4  # s over which noise and mean of the errors are taken
_LAG = 0.5  # share of a change of thrust that the motors may not yet have followed
_SURPRISE = 2.0  # sigmas of an error that surprise
_PERSISTS = 4  # surprises on end, one way, that mean another hover thrust and not a knock
_LONGEST_GAP = 0.25  # s between two observations that still belong together
_TARGET_DELAY = 0.03  # s from an autopilot's target to its effect
_TARGETS_KEPT = 64
_SHARES = (0.3, 3.0)  # acceleration over g; outside it says nothing
_THRUSTS = (0.04, 0.9)  # above, the motors saturate
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class HoverEstimate:
    """The thrust map, and how far it can be trusted.

    doubt: one sigma of the hover thrust, as a share of it. source: configured, parameter, autopilot
    (seen flying by itself) or flight (with our inputs). mismatch: the acceleration measured over
    that expected, less 1, in the mean of the last half second.
    """

    map: ThrustMap
    doubt: float
    source: str = "configured"
    mismatch: float = 0.0

    @property
    def known(self) -> bool:
        """Whether the hover thrust is known well enough to take over."""
        return self.doubt <= KNOWN

    @property
    def unknown_reason(self) -> str:
        """Why the companion must not take over, one line; empty where it may."""
        if self.known:
            return ""
        return (
            f"hover thrust is known to ±{self.doubt:.0%} only ({self.map.hover_thrust:.2f}, "
            f"{self.source}), ±{KNOWN:.0%} wanted: ATTITUDE_TARGET of a vehicle that hovers tells "
            "it, or set airframe.hover_thrust and hover_doubt"
        )


class HoverThrust:
    """Estimates the hover thrust; one `update` a tick."""

    def __init__(
        self, prior: ThrustMap, doubt: float, history: InputHistory, curve_known: bool = False
    ) -> None:
        """prior, doubt: as configured; doubt: one sigma, as a share.

        curve_known: whether the exponent is configured; else the autopilot's parameter gives it.
        """
        self._history = history
        self._curve_known = curve_known
        curve = _CURVE_CONFIGURED if curve_known else _CURVE_ASSUMED
        self._x: Vector = np.array([math.log(prior.hover_thrust), prior.exponent])
        self._P: Vector = np.diag([doubt, curve]) ** 2
        least, most = min(_EXPONENTS[0], prior.exponent), max(_EXPONENTS[1], prior.exponent)
        self._least: Vector = np.array([math.log(HOVER_MIN), least])
        self._most: Vector = np.array([math.log(HOVER_MAX), most])
        self._source = "configured"
        self._parameter: float | None = None
        self._before: VehicleState | None = None
        self._targets: deque[tuple[float, float]] = deque(maxlen=_TARGETS_KEPT)
        self._thrust_before: float | None = None
        self._noise, self._observed = _FIRST_NOISE**2, 0
        self._surprises = 0  # on end; its sign is theirs
        self._mean = self._error = 0.0  # of the observations over what is expected

    @property
    def estimate(self) -> HoverEstimate:
        """The present estimate."""
        hover = min(max(math.exp(self._x[0]), HOVER_MIN), HOVER_MAX)
        thrust_map, doubt = ThrustMap(hover, float(self._x[1])), math.sqrt(self._P[0, 0])
        return HoverEstimate(thrust_map, doubt, self._source, math.expm1(self._mean))

    def reset(self) -> None:
        """Forget what is tied to the vehicle's clock; what was learnt stays."""
        self._before = self._thrust_before = None
        self._targets.clear()

    def update(self, own: VehicleState | None, told: AutopilotThrust, ours: bool) -> HoverEstimate:
        """Learn from the motion since the last tick; ours: our inputs fly the vehicle."""
        self._read_parameters(told)
        self._targets.extend(told.targets)
        before, self._before = self._before, own
        if own is None or before is None or not 0.0 < own.time - before.time < _LONGEST_GAP:
            self._thrust_before = None
            return self.estimate
        dt = own.time - before.time
        self._P = self._P + _DRIFTED * dt
        start, end = before.time, own.time
        thrust = self._of_ours(start, end) if ours else self._of_autopilot(start, end)
        last, self._thrust_before = self._thrust_before, thrust
        if thrust is None or last is None or not told.airborne:
            return self.estimate
        if _THRUSTS[0] < min(thrust, last) and max(thrust, last) < _THRUSTS[1]:
            open_ = self._open(start, end, thrust) if ours else 0.0
            self._observe(thrust, last, _acceleration(before, own) / GRAVITY, dt, open_)
            self._source = "flight" if ours else "autopilot"
        return self.estimate

    def _read_parameters(self, told: AutopilotThrust) -> None:
        """Join the prior with the autopilot's own hover thrust, once; take its thrust curve."""
        if told.curve is not None and not self._curve_known and 0.0 <= told.curve <= 1.0:
            self._curve_known = True
            self._x[1] = exponent_of_curve(told.curve, math.exp(self._x[0]))
            self._P[1, 1] = _CURVE_TOLD**2
        hover = told.hover
        if hover is None or self._parameter is not None or not HOVER_MIN <= hover <= HOVER_MAX:
            return
        self._parameter = hover
        if self._source == "configured":
            self._correct(math.log(hover) - self._x[0], _PARAMETER**2, np.array([1.0, 0.0]))
            self._source = "parameter"

    def _observe(self, thrust: float, last: float, share: float, dt: float, open_: float) -> None:
        """Correct by one observation; share: acceleration over g that `thrust` gave.

        open_: 1 σ of the logarithm of the thrust.
        """
        if not _SHARES[0] < share < _SHARES[1]:
            return
        more, exponent = math.log(thrust) - self._x[0], self._x[1]
        error, slope = math.log(share) - exponent * more, np.array([-exponent, more])
        self._mean += dt / _MEAN_TIME * (error - self._mean)
        change, self._error = error - self._error, error  # a wrong hover thrust is no noise
        self._observed += 1
        if self._observed > 1:
            weight = max(dt / _NOISE_TIME, 1.0 / (self._observed + 1))
            self._noise += weight * (0.5 * change**2 - self._noise)
        noise = max(self._noise, _NOISE**2)
        noise += exponent**2 * ((_LAG * math.log(thrust / last)) ** 2 + open_**2)
        self._correct(self._believed(error, noise, slope), noise, slope)

    def _believed(self, error: float, noise: float, slope: Vector) -> float:
        """Return an error, bounded where it surprises; four alike mean another hover thrust."""
        most = _SURPRISE * math.sqrt(slope @ self._P @ slope + noise)
        surprises = abs(error) > most
        alike = surprises and error * self._surprises >= 0.0
        self._surprises = (self._surprises if alike else 0) + int(math.copysign(surprises, error))
        if abs(self._surprises) >= _PERSISTS:
            self._P[0, 0] = max(self._P[0, 0], (error / self._x[1]) ** 2)
            return error
        return min(max(error, -most), most)

    def _correct(self, error: float, noise: float, slope: Vector) -> None:
        """Correct by an error of variance `noise`; slope (2,): of what is observed over x."""
        gain = self._P @ slope / (slope @ self._P @ slope + noise)
        self._x = np.minimum(np.maximum(self._x + gain * error, self._least), self._most)
        P = self._P - gain[:, None] * (slope @ self._P)
        self._P = (P + P.T) / 2.0

    def _of_autopilot(self, start: float, end: float) -> float | None:
        """Return the mean thrust of the autopilot from `start` to `end` [s]; None: not told."""
        seen = [x for at, x in self._targets if start < at + _TARGET_DELAY <= end]
        return sum(seen) / len(seen) if seen else None

    def _open(self, start: float, end: float, thrust: float) -> float:
        """Return how far the delay's doubt leaves open which thrust acted: 1 σ of its logarithm.

        While the thrust changes, an acceleration is otherwise taken for the work of the wrong one.
        """
        sigma, open_ = self._history.delay_sigma, 0.0
        for shift in (-sigma, sigma):
            other = self._of_ours(start + shift, end + shift)
            if other:
                open_ = max(open_, abs(math.log(other / thrust)))
        return open_

    def _of_ours(self, start: float, end: float) -> float | None:
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


def _acceleration(before: VehicleState, own: VehicleState) -> float:
    """Return the mean specific force [m/s²] along the body's z axis between two states."""
    force: Vector = (own.v - before.v) / (own.time - before.time) + GRAVITY * _UP
    axis = rotation_matrix(before.q_wb)[:, 2] + rotation_matrix(own.q_wb)[:, 2]
    return float(force @ axis / norm(axis))
