"""Delay from a command to the gyro, measured in flight.

The body rates that telemetry reports follow the commanded ones, later by all that lies between:
compute, transport, rate loop, and the lag of the telemetry itself. Only this sum matters to a
prediction from telemetry. It is the shift at which both signals agree best.

Both signals pass the same band-pass first. It leaves the frequencies at which a rate loop is a
delay, and takes out the gyro's bias. The squared difference is kept for each delay of a grid, and
forgotten exponentially; its curvature at the minimum gives the doubt.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from companion.estimation.input_history import SentInput
from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.wire.messages import Attitude

_STEP = 0.01  # s, of the grid of delays and of the commands' memory
_LONGEST = 0.4  # s; sum of the longest delay and the longest telemetry lag, and some room
_STEPS_AROUND = np.arange(round(_LONGEST / _STEP) + 2)
_DELAYS = _STEPS_AROUND[:-1] * _STEP
_AXES = np.array([1.0, 1.0, 0.2])  # weights; yaw has less authority and follows less well
_KEPT = 256  # steps of commands: 2.5 s, more than the oldest sample in use
_LOW, _HIGH = 0.08, 1.0  # s, time constants of the band-pass
_MEMORY = 8.0  # s; a delay that changes is followed within it
_CORRELATED = 2.0 * _LOW  # s for which errors after the band-pass are alike
_SIGMA_RATE = 0.03  # rad/s, least error of filtered rates: rate loop, gyro, vibration
_SIGMA_MIN = 0.003  # s: the delay of a real chain jitters
_SETTLED = 3.0 * _LOW  # s until the filters have forgotten their start
_LONGEST_GAP = 0.15  # s without telemetry, over which the rates are not known
# rad of tilt that a wrong prediction may cost: by the delay's doubt, and by a rate loop, which is
# not a mere delay. With a third of the first a drone that was taken over in a gust could not level
# for a second and a half, and drifted into its neighbour.
_BY_DOUBT, _BY_LOOP = 0.1, 0.03
_SIGMAS = 3.0  # of the delay's doubt
_RATE_LOOP = 0.1  # of the delay
_YAW = 3.0  # times faster: the yaw tilts no thrust


_Sample = tuple[float, float, list[float]]  # time [s], s since the one before, filtered rates


@dataclass(frozen=True)
class Delay:
    """A delay [s] from a tick to its effect in telemetry, with its standard deviation [s]."""

    value: float
    sigma: float


class _BandPass:
    """Passes rates (3,) between two time constants, on samples joined by straight lines.

    It works on plain numbers: numpy takes three times as long for so few.
    """

    def __init__(self) -> None:
        self._low = self._slow = self._last = [0.0, 0.0, 0.0]

    def step(self, value: list[float], dt: float) -> list[float]:
        """Return the filtered rates `dt` [s] after the last sample, where they are `value`."""
        before = self._low
        self._low = _low_pass(self._low, self._last, value, dt, _LOW)
        self._slow = _low_pass(self._slow, before, self._low, dt, _HIGH)
        self._last = value
        return [low - slow for low, slow in zip(self._low, self._slow, strict=True)]

    def hold(self, value: list[float], dt: float) -> list[float]:
        """Return the filtered rates after `dt` [s] at which they were `value`."""
        self._last = value
        return self.step(value, dt)


def _low_pass(
    state: list[float], start: list[float], end: list[float], dt: float, tau: float
) -> list[float]:
    """Return a first-order lag's output after an input that goes straight from start to end."""
    keep, per_step = math.exp(-dt / tau), tau / dt
    out = []
    for s, a, b in zip(state, start, end, strict=True):
        slope = (b - a) * per_step
        out.append(b - slope + keep * (s - a + slope))
    return out


class DelayEstimator:
    """Estimates the delay from the inputs sent and the body rates that telemetry reports."""

    def __init__(self, prior: float, sigma: float = 0.1) -> None:
        """prior: s, as configured. sigma: s, how far it may be wrong."""
        self._prior = Delay(prior, sigma)
        self.estimate = self._prior
        self._cost = np.zeros(len(_DELAYS))  # (rad/s)² s, of each delay
        self._weight = 0.0  # s of signal in the cost
        self.reset()

    def reset(self) -> None:
        """Forget the signals, which are tied to the vehicle's clock; keep what was learnt."""
        self._commands, self._rates = _BandPass(), _BandPass()
        self._filtered = np.zeros((_KEPT, 3))  # commands, by number of the step
        self._first = self._next = 0  # numbers of the steps that are known: first…next-1
        self._held: SentInput | None = None
        self._before = [0.0, 0.0, 0.0]  # rates before that input
        self._gyro: Attitude | None = None
        self._since = math.inf  # s, when the filter of the rates began

    def sent(self, sent: SentInput) -> None:
        """Take in an input; it is held until the next."""
        if self._held is None:
            self._first = self._next = math.ceil(sent.time / _STEP)
            self._commands, self._before = _BandPass(), [0.0, 0.0, 0.0]
        else:
            self._before = self._held.u[1:4].tolist()
        self._held = sent

    def measured(self, time: float, attitudes: Iterable[Attitude]) -> Delay:
        """Compare the rates of new attitudes, in order of time, with the commands until `time` [s].

        Return the new estimate.
        """
        self._extend(time)
        comparable: list[_Sample] = []
        for a in attitudes:
            before, self._gyro = self._gyro, a
            if before is None or not 0.0 < a.time - before.time < _LONGEST_GAP:
                self._rates, self._since = _BandPass(), a.time
                continue
            dt = a.time - before.time
            rates = self._rates.step(a.omega.tolist(), dt)
            if self._comparable(a.time):
                comparable.append((a.time, dt, rates))
        if comparable:
            self._compare(comparable)
        if self._weight > 0.0:
            self.estimate = self._best()
        return self.estimate

    def _extend(self, until: float) -> None:
        """Filter the commands held until `until` [s], step by step."""
        if self._held is None:
            return
        sent, rates = self._held, self._held.u[1:4].tolist()
        for n in range(self._next, math.floor(until / _STEP) + 1):
            earlier = min(max(sent.time / _STEP - (n - 1), 0.0), 1.0)
            later = 1.0 - earlier
            omega = [earlier * a + later * b for a, b in zip(self._before, rates, strict=True)]
            self._filtered[n % _KEPT] = self._commands.hold(omega, _STEP)
            self._next = n + 1
        self._first = max(self._first, self._next - _KEPT)

    def _comparable(self, time: float) -> bool:
        """Return whether all commands that rates of `time` [s] may follow are known."""
        oldest = time - _LONGEST - _SETTLED
        settled = self._first * _STEP <= oldest and time - self._since > _SETTLED
        return settled and time < (self._next - 1) * _STEP

    def _compare(self, samples: list[_Sample]) -> None:
        """Take in filtered rates, in order of time."""
        times, gaps, rates = zip(*samples, strict=True)
        errors = self._errors(np.array(rates), np.array(times))
        for dt, squares in zip(gaps, errors, strict=True):
            keep = math.exp(-dt / _MEMORY)
            self._weight = keep * self._weight + dt
            self._cost = keep * self._cost + dt * squares

    def _errors(self, rates: Vector, times: Vector) -> Vector:
        """Return the squared errors (m,n) [(rad/s)²] of rates (m,3) at times (m,) s, by delay."""
        steps = times / _STEP
        lower = np.floor(steps).astype(int)
        part = (steps - lower)[:, None, None]
        # The steps around each delayed time, newest first: each is the one after its follower.
        known = self._filtered[(lower[:, None] + 1 - _STEPS_AROUND) % _KEPT]  # (m,n+1,3)
        off = rates[:, None] - ((1.0 - part) * known[:, 1:] + part * known[:, :-1])
        errors: Vector = (off * off) @ _AXES
        return errors

    def _best(self) -> Delay:
        """Return the delay of least cost, the prior included, and its doubt."""
        noise = max(float(self._cost.min()) / self._weight, _SIGMA_RATE**2)
        alike = _CORRELATED * noise
        total = self._cost / alike + ((_DELAYS - self._prior.value) / self._prior.sigma) ** 2
        n = min(max(int(total.argmin()), 1), len(total) - 2)
        left, mid, right = (float(t) for t in total[n - 1 : n + 2])
        bend = max(left - 2.0 * mid + right, 1e-9)  # second difference: 2 step² / σ²
        off = min(max(0.5 * (left - right) / bend, -1.0), 1.0)
        sigma = math.hypot(_STEP * math.sqrt(2.0 / bend), _SIGMA_MIN)
        return Delay(float(_DELAYS[n] + off * _STEP), min(sigma, self._prior.sigma))


def within_doubt(omega: Vector, delay: Delay) -> Vector:
    """Return body rates (3,) [rad/s], made slower where the delay is too little known for them."""
    cost = math.hypot(_SIGMAS * delay.sigma / _BY_DOUBT, _RATE_LOOP * delay.value / _BY_LOOP)
    fastest = 1.0 / max(cost, 1e-2)
    share = min(1.0, fastest / max(norm(omega[:2]), 1e-9))
    roll, pitch, yaw = omega.tolist()
    yaw = min(max(yaw, -_YAW * fastest), _YAW * fastest)
    return np.array([share * roll, share * pitch, yaw])
