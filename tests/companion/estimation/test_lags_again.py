"""The delay of commands and the lag of the told velocity, estimated a second time, plainly."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from companion.estimation.delay import Delay, DelayEstimator, within_doubt
from companion.estimation.input_history import SentInput
from companion.estimation.velocity_lag import VelocityLag
from mavlink_bridge.wire.messages import Attitude, VehicleState

G = 9.80665


class Lags:
    """Recursive least squares of lag, drag and wind, one axis after the other."""

    def __init__(self):
        self.x = [0.0] * 4
        self.P = np.diag([0.1**2, 0.3**2, 0.5**2, 0.5**2])
        self.noise = 0.04**2
        self.before, self.step = None, None
        self.a = self.v = np.zeros(3)

    def forget(self):
        self.before, self.a, self.v = None, np.zeros(3), np.zeros(3)

    def update(self, s, flying):
        before, self.before, self.step = self.before, s, None
        if s is None or before is None or not 0.0 < s.time - before.time < 0.25:
            self.forget()
            self.before = s
            return
        dt = s.time - before.time
        told = (s.v - before.v) / dt
        tops = [Rotation.from_quat(np.roll(q, -1)).as_matrix()[:, 2] for q in (before.q_wb, s.q_wb)]
        axis = sum(tops) / np.linalg.norm(sum(tops))
        lift = (G + told[2]) / max(axis[2], 0.3)
        if not flying or not 0.3 * G < lift < 2.0 * G:
            self.forget()
            self.before = s
            return
        a = np.array([lift * axis[0], lift * axis[1], told[2]])
        keep = math.exp(-dt / 0.5)
        slow = keep * self.a + (1.0 - keep) * a
        self.v = keep * self.v + (1.0 - keep) * s.v
        self.learn((told - a) * dt, slow - self.a, s.v, dt, before.time, s.time)
        self.a = slow

    def learn(self, missing, slower, v, dt, since, until):
        P = self.P * math.exp(dt / 20.0)
        P += dt * np.diag([0.002**2, 0.0, 0.1**2, 0.1**2])
        for k in range(4):
            if P[k, k] > 0.25:
                share = math.sqrt(0.25 / P[k, k])
                P[k] *= share
                P[:, k] *= share
        self.P = P
        rows = [
            np.array([-slower[0], -v[0] * dt, dt, 0.0]),
            np.array([-slower[1], -v[1] * dt, 0.0, dt]),
        ]
        off = [missing[k] - rows[k] @ self.x for k in (0, 1)]
        variance = sum(row @ P @ row for row in rows) + 2.0 * max(self.noise, 0.04**2)
        if math.hypot(*off) > max(0.25, 4.5 * math.sqrt(variance)):
            self.step = (off, since, until)
            return
        for k in (0, 1):
            row, error = rows[k], missing[k] - rows[k] @ self.x
            self.noise += dt / 20.0 * (error**2 - self.noise)
            s = row @ self.P @ row + max(self.noise, 0.04**2)
            gain = self.P @ row / s
            most = 3.0 * math.sqrt(s)
            self.x = self.x + gain * min(max(error, -most), most)
            self.P = self.P - np.outer(gain, gain) * s

    def lag(self):
        value, sigma = self.x[0], math.sqrt(self.P[0, 0])
        value = 0.0 if value < max(2.5 * sigma, 0.03) else min(value, 0.3)
        gained = self.a.copy()
        for k in (0, 1):
            gained[k] += self.x[2 + k] - self.x[1] * self.v[k]
        return value, sigma, value * self.v, value * gained


@pytest.mark.parametrize("seed", range(6))
def test_the_lag_is_that_of_a_second_estimator(seed):
    """It weaves in wind; the told velocity lags, is noisy, steps, and has gaps."""
    rng = np.random.default_rng(seed)
    one, other, time = VelocityLag(), Lags(), 5.0
    p, v, slow, believed, steps = np.zeros(3), np.zeros(3), np.zeros(3), 0, 0
    true = (0.0, 0.2, 0.45)[seed % 3]
    for k in range(500):
        dt = float(rng.choice([0.1, 0.09, 0.12, 0.3], p=[0.8, 0.1, 0.09, 0.01]))
        time += dt
        tilt = [0.3 * math.sin(0.9 * time), 0.25 * math.sin(1.3 * time + 1.0), 0.2 * time]
        turn = Rotation.from_euler("xyz", tilt)
        climb = 0.5 * math.sin(0.7 * time)
        up = turn.as_matrix()[:, 2]
        a = (G + climb) / up[2] * up - [0.0, 0.0, G]
        a += np.array([0.4, -0.2, 0.0]) - 0.1 * v
        slow = slow + (1.0 - math.exp(-dt / 0.5)) * (a - slow)
        p, v = p + dt * v, v + dt * a
        told = v - true * slow + 0.03 * rng.normal(size=3)
        if k == 300:
            v = v + np.array([0.9, -0.5, 0.0])
        s = VehicleState(time, p, told, np.roll(turn.as_quat(), 1), np.zeros(3))
        s = None if rng.random() < 0.003 else s
        flying = k > 20
        found = one.update(s, flying)
        other.update(s, flying)
        value, sigma, place, speed = other.lag()
        assert (found.value, found.sigma) == pytest.approx((value, sigma), abs=1e-8)
        assert found.position == pytest.approx(place, abs=1e-7)
        assert found.velocity == pytest.approx(speed, abs=1e-7)
        assert (one.step is None) == (other.step is None)
        if other.step is not None:
            steps += 1
            off, since, until = other.step
            assert one.step.change == pytest.approx(np.array(off), abs=1e-8)
            assert (one.step.since, one.step.until) == (since, until)
            if s is not None and seed % 2:
                one.corrected(s)
        believed += value > 0.0
    assert steps >= 1
    assert (believed > 100) == (true > 0.0)


def test_what_a_lag_misses_is_made_up_for():
    one, other = VelocityLag(), Lags()
    s = VehicleState(0.0, np.ones(3), np.ones(3), np.array([1.0, 0, 0, 0]), np.zeros(3))
    assert one.lag.made_up(s) is s
    other.x, other.P = np.array([0.2, 0.0, 0.0, 0.0]), np.diag([1e-4, 1.0, 1.0, 1.0])
    one._x, one._p = other.x, other.P
    one._velocity, one._acceleration = np.array([1.0, 2.0, 3.0]), np.array([-1.0, 0.5, 0.1])
    made = one._estimate().made_up(s)
    assert made.p == pytest.approx([1.2, 1.4, 1.6])
    assert made.v == pytest.approx([0.8, 1.1, 1.02])
    assert made.time == s.time


def lagged(times, values, tau):
    """Samples of a first-order lag, from zero, of a signal of straight lines between samples."""

    def slope(t, x):
        return [(np.interp(t, times, values) - x[0]) / tau]

    spans = (times[0], times[-1])
    return solve_ivp(slope, spans, [0.0], t_eval=times, max_step=0.01, rtol=1e-9, atol=1e-9).y[0]


def chain(delay, seconds=12.0, seed=1, noise=0.02, dt=0.1):
    """Inputs sent each tick, and the rates that a gyro tells `delay` s later."""
    rng = np.random.default_rng(seed)
    estimator = DelayEstimator(0.2)
    sent, told, estimates = [], 0.0, []
    for k in range(round(seconds / dt)):
        time = 3.0 + dt * k
        estimator.sent(sent_input := SentInput(time, np.array([9.8, *rng.normal(size=3)]), 0.3))
        sent.append((time, sent_input.u[1:4]))
        attitudes = []
        while told < time:
            told += 0.02
            last = [u for t, u in sent if t <= told - delay]
            omega = (last[-1] if last else np.zeros(3)) + noise * rng.normal(size=3)
            attitudes.append(Attitude(told, np.array([1.0, 0, 0, 0]), omega))
        estimates.append(estimator.measured(time, attitudes))
    return estimates


@pytest.mark.parametrize("delay", [0.035, 0.085, 0.155, 0.27])
def test_the_delay_is_found_between_the_steps_of_the_grid(delay):
    last = chain(delay)[-1]
    assert last.value == pytest.approx(delay, abs=0.006)
    assert 0.003 <= last.sigma < 0.01


def test_a_delay_of_which_nothing_is_known_is_the_prior():
    estimator = DelayEstimator(0.12, 0.07)
    assert estimator.measured(1.0, []) == Delay(0.12, 0.07)
    assert chain(0.1, seconds=0.4)[-1] == Delay(0.2, 0.1)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_filters_are_those_of_the_equations(axis):
    """The cost of one delay, by filters that are solved as differential equations."""
    rng = np.random.default_rng(axis)
    estimator, delay, dt = DelayEstimator(0.2), 0.1, 0.1
    values = rng.normal(size=24)
    times = 3.0 + dt * np.arange(24)
    rates = [np.interp(t - delay, times, values) for t in times]
    filtered = []
    original = estimator._errors
    estimator._errors = lambda r, t: (filtered.append((t[0], r[0, axis])), original(r, t))[1]
    for time, value, rate in zip(times, values, rates, strict=True):
        estimator.sent(SentInput(time, np.array([9.8, *(value * np.eye(3)[axis])]), 0.3))
        gyro = Attitude(time, np.array([1.0, 0, 0, 0]), rate * np.eye(3)[axis])
        estimator.measured(time + 0.05, [gyro])
    low = lagged(times, np.array([0.0, *rates[1:]]), 0.08)  # it begins at the first sample
    wanted = dict(zip(times.tolist(), low - lagged(times, low, 1.0), strict=True))
    assert len(filtered) > 12
    for t, r in filtered:
        assert r == pytest.approx(wanted[t], abs=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_a_delay_in_doubt_slows_the_rates(seed):
    rng = np.random.default_rng(seed)
    omega, delay = 3.0 * rng.normal(size=3), Delay(rng.uniform(0.02, 0.4), rng.uniform(0.003, 0.1))
    fastest = 1.0 / math.hypot(3.0 * delay.sigma / 0.1, 0.1 * delay.value / 0.03)
    share = min(1.0, fastest / math.hypot(omega[0], omega[1]))
    yaw = min(max(omega[2], -3.0 * fastest), 3.0 * fastest)
    assert within_doubt(omega, delay) == pytest.approx([share * omega[0], share * omega[1], yaw])
    assert within_doubt(np.zeros(3), delay).tolist() == [0.0, 0.0, 0.0]
    sure = within_doubt(np.array([90.0, 0.0, 400.0]), Delay(0.0, 0.0))
    assert sure == pytest.approx([90.0, 0.0, 300.0])
