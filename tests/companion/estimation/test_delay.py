"""Delay from command to gyro, measured on made-up flights of known delay."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.estimation.delay import Delay, DelayEstimator, within_doubt
from companion.estimation.input_history import SentInput
from companion.model import HOVER
from mavlink_bridge.wire.messages import Attitude

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
PHASE = 0.037  # s: ticks fall on no step of the estimator's grid


class Flight:
    """A rate loop of first order behind a pure delay, read through lagging telemetry."""

    def __init__(self, estimator, seed, transport, lag, moves=1.0):
        self.estimator, self.transport, self.lag, self.moves = estimator, transport, lag, moves
        self.rng = np.random.default_rng(seed)
        self.tick, self.sent = 0, [(-9.0, np.zeros(3))]
        self.omega, self.samples = np.zeros(3), []

    def fly(self, seconds):
        """Fly on and return the estimate; the gyro has noise and a bias."""
        for _ in range(round(seconds / 0.1)):
            now = PHASE + 0.1 * self.tick
            self._follow(now)
            attitudes = [Attitude(t, LEVEL, w) for t, w in self.samples]
            self.samples = []
            estimate = self.estimator.measured(now, attitudes)
            u = 0.6 * self.sent[-1][1] + self.moves * self.rng.normal(0.0, 0.3, 3)
            self.sent.append((now, u))
            self.estimator.sent(SentInput(now, np.array([HOVER[0], *u]), 0.3))
            self.tick += 1
        return estimate

    def _follow(self, until):
        """Integrate the rate loop by milliseconds up to `until` [s], sampled at 50 Hz."""
        for k in range(round((until - 0.1) * 1000), round(until * 1000)):
            t = k / 1000
            wanted = next(u for sent, u in reversed(self.sent) if sent + self.transport <= t + 1e-9)
            self.omega = self.omega + (wanted - self.omega) * (0.001 / self.lag)
            if k % 20 == 0:
                self.samples.append((t, self.omega + self.rng.normal(0.005, 0.02, 3)))


@pytest.mark.parametrize("seed", range(6))
def test_a_delay_that_nobody_told_is_known_within_10_ms_after_five_seconds(seed):
    rng = np.random.default_rng([7, seed])
    transport, lag = rng.uniform(0.01, 0.28), rng.uniform(0.015, 0.04)
    estimate = Flight(DelayEstimator(0.06), seed, transport, lag).fly(5.0)
    assert estimate.value == pytest.approx(transport + lag, abs=0.01)
    assert estimate.sigma < 0.01


def test_without_motion_the_prior_and_its_doubt_stay():
    estimate = Flight(DelayEstimator(0.06, sigma=0.04), 1, 0.2, 0.03, moves=0.0).fly(5.0)
    assert estimate.value == pytest.approx(0.06, abs=0.01)
    assert estimate.sigma > 0.03


def test_a_delay_that_changes_is_followed():
    flight = Flight(DelayEstimator(0.06), 3, 0.03, 0.02)
    assert flight.fly(10.0).value == pytest.approx(0.05, abs=0.01)
    flight.transport = 0.13
    assert flight.fly(20.0).value == pytest.approx(0.15, abs=0.015)


def test_signals_of_before_a_reset_are_not_compared_with_those_after_it():
    flight = Flight(DelayEstimator(0.06), 4, 0.1, 0.02)
    before = flight.fly(6.0)
    flight.estimator.reset()  # as after each tick at which the autopilot flew by itself
    assert flight.fly(0.1) == before
    assert flight.fly(5.0).value == pytest.approx(0.12, abs=0.01)


def _of_cost(cost, weight, prior=0.1, sigma=0.1):
    estimator = DelayEstimator(prior, sigma)
    estimator._cost, estimator._weight = cost, weight
    return estimator._best()


GRID = 0.01 * np.arange(41)


@given(at=st.floats(0.015, 0.385), sharp=st.floats(20.0, 350.0), weight=st.floats(0.5, 8.0))
def test_the_best_delay_is_where_data_and_prior_agree_best(at, sharp, weight):
    """Both are parabolas, so that their minimum and its doubt are known in closed form.

    The errors of 0.03 rad/s count for 0.16 s each: a cost of as many is one σ² of doubt.
    """
    unit = 0.16 * 0.03**2
    data, prior = sharp**2, 1.0 / 0.1**2  # 1/s², the inverse of their variances
    found = _of_cost(unit * data * (GRID - at) ** 2, weight)
    mean, most = (data * at + prior * 0.1) / (data + prior), 0.39
    assert found.value == pytest.approx(min(max(mean, 0.0), most + 0.01), abs=1e-6)
    assert found.sigma == pytest.approx(min(np.hypot((data + prior) ** -0.5, 0.003), 0.1), rel=1e-4)


@given(floor=st.floats(0.002, 0.1), weight=st.floats(0.5, 8.0))
def test_the_doubt_of_a_delay_grows_with_the_errors_that_are_left(floor, weight):
    """Where even the best delay leaves errors, these are the noise, per second of signal."""
    bent = 0.16 * 400.0**2 * 0.03**2 * (GRID - 0.2) ** 2
    found = _of_cost(bent + floor * weight, weight, prior=0.2)
    data = 400.0**2 * 0.03**2 / max(floor, 0.03**2)
    expected = np.hypot((data + 100.0) ** -0.5, 0.003)
    assert found.value == pytest.approx(0.2, abs=1e-6)
    assert found.sigma == pytest.approx(min(expected, 0.1), rel=1e-3)


@pytest.mark.parametrize(("edge", "value"), [(0, 0.0), (40, 0.4)])
def test_a_delay_at_the_end_of_the_grid_stays_on_it(edge, value):
    cost = 10.0 * (GRID - GRID[edge]) ** 2
    assert _of_cost(cost, 1.0, prior=GRID[edge]).value == pytest.approx(value, abs=0.0051)


def test_before_anything_is_measured_the_delay_is_as_configured():
    assert DelayEstimator(0.06).estimate == Delay(0.06, 0.1)
    assert DelayEstimator(0.06).measured(1.0, []) == Delay(0.06, 0.1)


@pytest.mark.parametrize(
    ("delay", "fastest"),
    [
        (Delay(0.1, 0.0), 3.0),  # a tenth of it costs 0.03 rad
        (Delay(0.0, 0.02), 1.0 / 0.6),  # 3 σ cost 0.1 rad
        (Delay(0.24, 0.02), 1.0),  # both: 0.8 and 0.6
        (Delay(0.0, 0.0), 100.0),
    ],
)
def test_body_rates_are_as_fast_as_the_doubt_of_the_delay_allows(delay, fastest):
    roll_pitch = 2.0 * fastest * np.array([0.6, -0.8])
    slower = within_doubt(np.array([*roll_pitch, 1.5 * fastest]), delay)
    assert slower == pytest.approx(fastest * np.array([0.6, -0.8, 1.5]))
    slow = 0.9 * fastest * np.array([-0.6, 0.8, 0.0])
    assert within_doubt(slow, delay) == pytest.approx(slow)
    for yaw in (2.9, -2.9, 3.1, -3.1):
        bounded = np.clip(yaw, -3.0, 3.0) * fastest
        turned = within_doubt(np.array([0.0, 0.0, yaw * fastest]), delay)
        assert turned == pytest.approx([0.0, 0.0, bounded])


def flown(gap=0.02, delay=0.1, axis=0, seconds=4.0, bias=0.0):
    """The estimate for rates that follow a square wave of commands after a delay; times in s."""
    estimator, t = DelayEstimator(0.06), 0.0
    for k in range(round(seconds / 0.1)):
        now = PHASE + 0.1 * k
        attitudes = []
        while t < now:
            since = np.floor((t - delay - PHASE) / 0.1)
            omega = np.zeros(3)
            omega[axis] = 0.5 * (-1.0) ** (since // 3) if since >= 0 else 0.0
            attitudes.append(Attitude(t, LEVEL, omega + bias))
            t += gap
        estimate = estimator.measured(now, attitudes)
        u = np.zeros(4)
        u[1 + axis] = 0.5 * (-1.0) ** (k // 3)
        estimator.sent(SentInput(now, u, 0.3))
    return estimate


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("delay", [0.04, 0.1, 0.3])
def test_rates_about_any_axis_that_follow_exactly_tell_the_delay(axis, delay):
    """Samples are joined by straight lines: steps 7 ms after a sample seem to be at 5 ms."""
    estimate = flown(gap=0.01, delay=delay, axis=axis)
    assert estimate.value == pytest.approx(delay - 0.002, abs=0.001)
    assert 0.003 <= estimate.sigma < 0.01


@pytest.mark.parametrize(("gap", "measured"), [(0.14, True), (0.16, False)])
def test_rates_more_than_15_hundredths_of_a_second_apart_say_nothing(gap, measured):
    estimate = flown(gap=gap, delay=0.2)
    assert (estimate != Delay(0.06, 0.1)) is measured


@pytest.mark.parametrize(("seconds", "measured"), [(0.7, False), (1.2, True)])
def test_a_delay_takes_two_thirds_of_a_second_of_known_commands(seconds, measured):
    """0.4 s of the longest delay, and 0.24 s in which the filters settle."""
    assert (flown(seconds=seconds) != Delay(0.06, 0.1)) is measured


def test_a_bias_of_the_gyro_is_no_error_after_some_seconds():
    """The first seconds are forgotten with a time constant of 8 s, the bias itself within 1 s."""
    exact, biased = (flown(seconds=16.0, bias=bias) for bias in (0.0, 0.2))
    assert biased.value == pytest.approx(exact.value, abs=0.002)
    assert exact.sigma < 0.0045
    assert biased.sigma < 0.0045
