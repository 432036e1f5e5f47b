"""Own state from coarse telemetry and from odometry; finer telemetry passes as it is."""

import math

import numpy as np
import pytest

from companion.estimation.coarse_telemetry import CoarseTelemetry
from companion.estimation.own_state import OwnState
from mavlink_bridge.shared.frames import euler_from_quaternion, quaternion_from_euler
from mavlink_bridge.wire.messages import (
    Attitude,
    EulerAttitude,
    GlobalPosition,
    LocalPosition,
    Odometry,
)

STEP = math.radians(0.1)
METRE = math.degrees(1 / 6371008.8)


def stepped(*angles):
    return quaternion_from_euler(*(round(a / STEP) * STEP for a in angles))


def truth(t):
    """Place, velocity, roll and its rate of a gentle weave."""
    p = np.array([1.2 * t, 0.8 * math.sin(t), 2.0])
    v = np.array([1.2, 0.8 * math.cos(t), 0.0])
    return p, v, 0.15 * math.sin(1.5 * t), 0.225 * math.cos(1.5 * t)


def telemetry(t, velocity):
    """ATTITUDE at 50 Hz and GLOBAL_POSITION_INT at 10 Hz, as Betaflight sends them."""
    p, v, roll, _ = truth(t)
    yield EulerAttitude(t, stepped(roll, 0.0, 0.5), np.zeros(3))
    if round(t * 50) % 5 == 0:
        lat, lon = p[1] * METRE, p[0] * METRE  # at the equator
        speed = np.append(np.round(v[:2], 2), 0.0) if velocity else np.zeros(3)
        yield GlobalPosition(t * 1e3, lat, lon, 100.0 + p[2], 0.0, speed)


@pytest.mark.parametrize(
    ("velocity", "position_rms", "speed_rms"), [(True, 0.1, 0.15), (False, 0.15, 0.3)]
)
def test_coarse_telemetry_follows_a_weave(velocity, position_rms, speed_rms):
    own, squares, begin = OwnState(), [], truth(0.0)[0]
    for k in range(1000):
        t = k / 50
        own.add(telemetry(t, velocity))
        if t > 5.0:
            p, v, roll, rate = truth(t)
            now = own.at(t)
            estimated = euler_from_quaternion(now.q_wb)[0]
            p_square = np.sum((now.p - p + begin)[:2] ** 2)
            v_square = np.sum((now.v - v)[:2] ** 2)
            squares.append(
                [p_square, v_square, (estimated - roll) ** 2, (now.omega[0] - rate) ** 2]
            )
    p_error, v_error, roll_error, rate_error = np.sqrt(np.mean(squares, axis=0))
    assert p_error < position_rms
    assert v_error < speed_rms
    assert math.degrees(roll_error) < 0.3
    assert rate_error < 0.06


def test_a_climb_during_a_gap_of_positions_is_a_climb():
    """The drone climbs 1.3 m in a gap of 1.3 s: the zero of its height has not moved."""
    own = OwnState()
    for k in range(1250):
        t = k / 50
        height = min(max(t - 10.0, 0.0), 3.0)
        own.add([EulerAttitude(t, np.array([1.0, 0, 0, 0]), np.zeros(3))])
        if k % 5 == 0 and not 10.0 <= t < 11.3:
            own.add([GlobalPosition(t, 47.0, 8.0, 500.0 + height, 0.0, np.zeros(3))])
    assert own.at(t).p[2] == pytest.approx(3.0, abs=0.1)


def test_fine_telemetry_passes_as_it_is():
    own = OwnState()
    q = quaternion_from_euler(0.1, 0.2, 0.3)
    own.add(telemetry(0.0, True))
    own.add([Attitude(1.0, q, np.zeros(3)), LocalPosition(1.0, np.ones(3), np.zeros(3))])
    own.add(telemetry(1.02, True))  # PX4 sends these besides
    assert own.at(1.0).p == pytest.approx(np.ones(3))
    assert own.at(1.0).q_wb == pytest.approx(q)


def odometry(t):
    p, v, roll, rate = truth(t)
    return Odometry(t, p, v, quaternion_from_euler(roll, 0.0, 0.5), np.array([rate, 0.0, 0.0]))


def test_odometry_alone_gives_the_own_state():
    own = OwnState()
    for k in range(60):
        own.add([odometry(k / 30)])
    p, v, roll, _ = truth(2.0)
    state = own.at(2.0)
    np.testing.assert_allclose(state.p, p, atol=0.01)
    np.testing.assert_allclose(state.v, v, atol=0.06)
    assert euler_from_quaternion(state.q_wb)[0] == pytest.approx(roll, abs=0.01)
    assert own.age(2.0) == pytest.approx(1 / 30)


def test_odometry_replaces_a_stream_that_falls_silent():
    own, off = OwnState(), np.array([5.0, 0.0, 0.0])
    for k in range(30):
        t = k / 30
        p, v, *_ = truth(t)
        own.add([LocalPosition(t, p + off, v), odometry(t)])
    assert own.at(29 / 30).p[0] == pytest.approx(truth(29 / 30)[0][0] + 5.0, abs=0.01)
    for k in range(30, 60):
        own.add([odometry(k / 30)])
    assert own.at(59 / 30).p[0] == pytest.approx(truth(59 / 30)[0][0], abs=0.01)


def test_a_body_rate_beyond_any_gyro_is_refused():
    own, level = OwnState(), np.array([1.0, 0.0, 0.0, 0.0])
    for k in range(10):
        own.add([LocalPosition(k / 50, np.zeros(3), np.zeros(3))])
        own.add([Attitude(k / 50, level, np.array([34.0, 0.0, 0.0]))])
    wild = [Attitude(0.2 + k / 50, level, np.array([0.0, -150.0, 0.0])) for k in range(5)]
    own.add(wild[:1])
    assert own.at(0.2).omega.tolist() == [34.0, 0.0, 0.0]
    assert own.plausible(0.2)  # once is an outlier
    own.add(wild[1:])
    assert own.counters.too_fast == 5
    assert not own.plausible(0.3)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e-45, -1e-40])
def test_samples_that_are_not_finite_or_normal_are_refused_and_counted(bad):
    """A denormal float32 is garbage: as a velocity it would be believed as a halt."""
    own, level, v = OwnState(), np.array([1.0, 0.0, 0.0, 0.0]), np.array([1.5, 0.0, 0.0])
    own.add([Attitude(0.0, level, np.zeros(3)), LocalPosition(0.0, np.zeros(3), v)])
    spoilt = np.array([bad, 0.0, 0.0])
    own.add([Attitude(0.02, level, spoilt), LocalPosition(0.02, 0.02 * v, spoilt)])
    assert own.counters.not_finite == 2
    assert (own.at(0.1).p, own.at(0.1).v) == (pytest.approx(0.1 * v), pytest.approx(v))


def test_rates_of_coarse_telemetry_are_not_by_gyro():
    own = OwnState()
    own.add(telemetry(0.0, True))
    assert not own.rates_by_gyro
    own.add([Attitude(0.1, quaternion_from_euler(0.0, 0.0, 0.5), np.zeros(3))])
    assert own.rates_by_gyro


def angles(time, roll=0.0, pitch=0.0, yaw=0.0):
    return EulerAttitude(time, quaternion_from_euler(roll, pitch, yaw), np.zeros(3))


def fix(north=0.0, east=0.0, altitude=100.0, v=(0.0, 0.0, 0.0)):
    return GlobalPosition(0.0, north * METRE, east * METRE, altitude, 0.0, np.array(v))


def that_stands(v=(0.0, 0.0, 0.0)):
    """Coarse telemetry after angles and a first fix at 0 s."""
    coarse = CoarseTelemetry()
    assert coarse.add(angles(0.0)) == []  # the place is to come
    assert coarse.add(fix(v=v)) == []
    return coarse


def test_angles_after_a_fix_give_an_attitude_and_a_position_of_their_time():
    attitude, position = that_stands().add(angles(0.1))
    assert type(attitude) is Attitude
    assert type(position) is LocalPosition
    assert attitude.time == position.time == 0.1
    assert position.p.tolist() == position.v.tolist() == [0.0, 0.0, 0.0]
    assert attitude.omega.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("time", [0.0, -0.1])
def test_angles_that_are_no_newer_give_nothing(time):
    assert that_stands().add(angles(time)) == []


def test_angles_that_are_no_numbers_give_nothing_and_leave_the_next_ones_as_they_are():
    coarse = that_stands()
    bad = EulerAttitude(0.1, np.array([1.0, 0.0, np.nan, 0.0]), np.zeros(3))
    assert coarse.add(bad) == []
    attitude, _ = coarse.add(angles(0.1))
    assert np.isfinite(attitude.q_wb).all()


def test_messages_of_other_kinds_give_nothing():
    coarse = that_stands()
    assert coarse.add(Attitude(0.1, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))) == []


def test_a_fix_before_all_angles_says_nothing():
    coarse = CoarseTelemetry()
    coarse.add(fix(altitude=500.0))
    assert coarse.add(angles(0.0)) == []
    coarse.add(fix(altitude=100.0))
    _, position = coarse.add(angles(0.1))
    assert position.p[2] == 0.0


@pytest.mark.parametrize("up", [2.0, -0.5])
def test_a_height_over_that_of_the_first_fix_is_followed_by_two_fifths_and_as_a_climb_by_half(up):
    coarse = that_stands()
    coarse.add(angles(0.1))
    coarse.add(fix(altitude=100.0 + up))
    _, position = coarse.add(angles(0.2))
    assert position.v == pytest.approx([0.0, 0.0, 0.5 * up])
    assert position.p == pytest.approx([0.0, 0.0, 0.4 * up + 0.1 * 0.5 * up])


def test_a_fix_without_velocity_gives_one_by_how_far_off_it_is():
    """1 m/s for each metre, and 0.35 of it at once."""
    coarse = that_stands()
    coarse.add(angles(0.1))
    coarse.add(fix(east=2.0, north=-1.0))
    _, position = coarse.add(angles(0.2))
    assert position.v == pytest.approx([2.0, -1.0, 0.0], rel=1e-6)
    assert position.p == pytest.approx([0.7 + 0.2, -0.35 - 0.1, 0.0], rel=1e-6)


def test_a_velocity_along_the_ground_is_followed_by_two_fifths():
    """The vertical one is the barometer's."""
    coarse = that_stands(v=(1.0, 0.0, 0.0))
    coarse.add(angles(0.1))
    coarse.add(fix(east=0.1, v=(2.0, -1.0, 3.0)))
    _, position = coarse.add(angles(0.2))
    assert position.v == pytest.approx([1.4, -0.4, 0.0])
    assert position.p == pytest.approx([0.1 + 0.14, -0.04, 0.0], abs=1e-6)


@pytest.mark.parametrize("axis", range(3))
def test_angles_beyond_half_of_their_step_of_a_tenth_of_a_degree_turn_the_attitude(axis):
    """By half of what is beyond; and 0.35 of its slope is the body rate. The heading likewise."""
    coarse, turned = that_stands(), 0.02 * np.eye(3)[axis]
    attitude, _ = coarse.add(angles(0.1, *turned))
    over = 0.02 - math.radians(0.05)
    assert attitude.omega[axis] == pytest.approx(0.35 * over / 0.1)
    assert euler_from_quaternion(attitude.q_wb)[axis] == pytest.approx(0.5 * over)
    within, _ = that_stands().add(angles(0.1, *(0.0008 * np.eye(3)[axis])))
    assert within.omega.tolist() == [0.0, 0.0, 0.0]


def test_fixes_are_of_the_moment_at_which_they_come():
    """East at 1 m/s, and up at 1 m/s from 0.8 m on: the fix of 0.3 s is where the drone is."""
    coarse = that_stands(v=(1.0, 0.0, 0.0))
    coarse.add(angles(0.1))
    coarse.add(fix(east=0.1, altitude=102.0, v=(1.0, 0.0, 0.0)))
    for time in (0.2, 0.3):
        coarse.add(angles(time))
    coarse.add(fix(east=0.3, altitude=101.0, v=(1.0, 0.0, 0.0)))
    _, position = coarse.add(angles(0.4))
    assert position.v == pytest.approx([1.0, 0.0, 1.0], abs=1e-6)
    assert position.p == pytest.approx([0.4, 0.0, 1.1], abs=1e-6)
