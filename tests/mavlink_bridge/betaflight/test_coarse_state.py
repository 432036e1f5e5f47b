"""State from stepped angles, a slow GPS and a barometer, against a known motion."""

import math

import numpy as np
import pytest

from mavlink_bridge.betaflight.coarse_state import CoarseState
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import euler_from_quaternion

RATE = 60.0
EARTH = 6371008.8


def motion(t):
    """Return position, velocity, acceleration, roll and roll rate of a weave at 1.5 m/s."""
    p = np.array([1.5 * t, 0.8 * math.sin(1.5 * t), 0.3 * math.sin(t)])
    v = np.array([1.5, 1.2 * math.cos(1.5 * t), 0.3 * math.cos(t)])
    a = np.array([0.0, -1.8 * math.sin(1.5 * t), -0.3 * math.sin(t)])
    roll, rate = 0.3 * math.sin(2 * t), 0.6 * math.cos(2 * t)
    return p, v, a, roll, rate


def step(value, size):
    return round(value / size) * size


def errors(gyro, seed=1):
    """Return RMS errors of position, velocity, roll [deg], roll rate over the last 8 s."""
    state, rng = CoarseState(), np.random.default_rng(seed)
    state.advance(0.0)
    state.angles(0.0, 0.0, 0.0)
    state.force(np.array([0.0, 0.0, 256.0]), resting=True)
    state.height(100.0, resting=True)
    state.gps(47.0, 8.0, np.zeros(2))
    squares = []
    for k in range(1, round(10 * RATE)):
        t = k / RATE
        p, v, a, roll, rate = motion(t)
        state.advance(t)
        if gyro:
            state.gyro(np.array([rate, 0.0, 0.0]))
        dt = 0.0 if gyro else 1 / RATE
        state.angles(step(roll, math.radians(0.1)), 0.0, step(0.003, math.radians(1)), dt)
        world = a + np.array([0.0, 0.0, GRAVITY])
        c, s = math.cos(roll), math.sin(roll)
        body = np.array([world[0], c * world[1] + s * world[2], c * world[2] - s * world[1]])
        state.force(256.0 / GRAVITY * body, resting=False)
        state.height(100.0 + step(motion(t - 0.12)[0][2], 0.01), resting=False)
        if k % 6 == 0:
            q, w = motion(t - 0.06)[:2]
            q = q + 0.02 * rng.standard_normal(3)
            lat = 47.0 + math.degrees(q[1] / EARTH)
            lon = 8.0 + math.degrees(q[0] / EARTH / math.cos(math.radians(47.0)))
            state.gps(lat, lon, w[:2] + 0.03 * rng.standard_normal(2))
        now = state.at(t)
        estimated = euler_from_quaternion(now.q_wb)[0]
        if t > 2.0:
            tilt = math.degrees(estimated - roll) ** 2
            squares.append(
                [
                    np.sum((now.p - p) ** 2),
                    np.sum((now.v - v) ** 2),
                    tilt,
                    (now.omega[0] - rate) ** 2,
                ]
            )
    return np.sqrt(np.mean(squares, axis=0))


def test_with_a_gyro_the_state_follows_a_weave():
    position, velocity, roll, _ = errors(gyro=True)
    assert position < 0.12
    assert velocity < 0.15
    assert roll < 0.15


def test_without_a_gyro_the_rates_follow_from_the_angles():
    position, velocity, roll, rate = errors(gyro=False)
    assert position < 0.2
    assert velocity < 0.3
    assert roll < 1.0
    assert rate < 0.15


def test_no_state_before_attitude_fix_and_height():
    state = CoarseState()
    state.advance(0.0)
    state.angles(0.0, 0.0, 0.0)
    assert state.at(0.1) is None
    state.gps(47.0, 8.0, np.zeros(2))
    assert state.at(0.1) is None
    state.height(3.0, resting=True)
    assert state.at(0.1).p == pytest.approx(np.zeros(3), abs=1e-6)


def test_a_heading_on_a_step_does_not_drift():
    state = CoarseState()
    state.height(0.0, resting=True)
    for k in range(300):
        state.advance(k / RATE)
        state.gps(47.0, 8.0, np.zeros(2))
        state.gyro(np.array([0.0, 0.0, 0.002]))  # a bias
        state.angles(0.0, 0.0, math.radians(90))
    yaw = euler_from_quaternion(state.at(5.0).q_wb)[2]
    assert math.degrees(yaw) == pytest.approx(90.0, abs=0.7)


def test_a_barometer_zeroed_in_flight_does_not_move_the_state():
    state = CoarseState()
    state.advance(0.0)
    state.angles(0.0, 0.0, 0.0)
    state.gps(47.0, 8.0, np.zeros(2))
    state.height(4.9, resting=True)
    for k in range(1, 200):
        state.advance(k / RATE)
        state.confirm_fix()
        state.height(max(4.9 - 0.3 * k, 0.0), resting=False)  # through the controller's filter
    now = state.at(200 / RATE)
    assert abs(now.v[2]) < 0.3
    assert abs(now.p[2]) < 1.0


def test_no_state_without_fix_or_telemetry_and_a_new_fix_sets_it_at_once():
    state = CoarseState(silent=0.5, unfixed=1.0)
    for k in range(240):  # s of 60, moving east; the fix ends after one
        state.advance(k / RATE)
        state.angles(0.0, 0.0, 0.0)
        state.height(0.0, resting=True)
        if k <= 60:
            state.gps(47.0, 8.0, np.array([1.0, 0.0]))
        assert (state.at(k / RATE) is None) == (k > 120)
        assert state.at(k / RATE, need_fix=False) is not None
    state.gps(47.0 + math.degrees(5.0 / EARTH), 8.0, np.array([0.0, 2.0]))
    now = state.at(4.0)
    assert now.p == pytest.approx([0.0, 5.0, 0.0], abs=0.1)
    assert now.v == pytest.approx([0.0, 2.0, 0.0], abs=0.01)
    assert state.at(4.4) is not None
    assert state.at(4.6, need_fix=False) is None
