"""The own state: which samples it refuses, and when it is no longer plausible."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.estimation.own_state import OwnState
from companion.model import yaw_of
from mavlink_bridge.wire.messages import Attitude, EulerAttitude, LocalPosition, Odometry

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def fed(*samples):
    state = OwnState()
    for n in range(10):
        state.add([Attitude(0.02 * n, LEVEL, np.zeros(3))])
        state.add([LocalPosition(0.02 * n, np.zeros(3), np.zeros(3))])
    for sample in samples:
        state.add([sample])
    return state


def position(time, x):
    return LocalPosition(time, np.array([x, 0.0, 0.0]), np.zeros(3))


def without_position(seconds, *corrupt):
    """Whether attitudes alone are plausible, with positions that are NaN at the times `corrupt`."""
    samples = [Attitude(0.2 + t, LEVEL, np.zeros(3)) for t in np.arange(0.0, seconds, 0.02)]
    samples += [position(t, np.nan) for t in corrupt]
    return fed(*sorted(samples, key=lambda s: s.time)).plausible(0.2 + seconds)


def test_a_silent_position_is_lost_sooner_than_one_that_is_not_finite():
    assert without_position(0.15)
    assert not without_position(0.25)
    assert without_position(0.25, *np.arange(0.2, 0.45, 0.04))
    assert not without_position(0.6, *np.arange(0.2, 0.8, 0.04))


def test_a_position_elsewhere_is_an_outlier_and_five_are_a_jump():
    once = fed(position(0.2, 5.0), position(0.22, 0.0))
    assert once.plausible(0.22)
    assert once.counters.jumps == 1
    assert not fed(*[position(0.2 + 0.02 * n, 5.0) for n in range(5)]).plausible(0.3)
    assert fed(*[position(0.2 + 0.1 * n, 0.9 * (n + 1)) for n in range(5)]).plausible(0.6)


def test_quaternions_that_are_not_of_unit_length_are_refused():
    bad = [Attitude(0.2 + 0.02 * n, 0.5 * LEVEL, np.zeros(3)) for n in range(5)]
    assert fed(*bad[:3]).plausible(0.26)
    assert not fed(*bad).plausible(0.3)


def test_a_clock_that_goes_back_is_a_reboot():
    late = fed()
    late.add([position(50.0, 0.0)])
    late.add([position(0.1, 0.0)])
    assert late.counters.reboots == 0
    late.add([position(0.12, 0.0), position(0.14, 0.0)])
    assert late.counters.reboots == 1
    assert late.at(0.14) is None  # attitude is to come


def test_samples_of_the_future_are_refused_and_counted():
    state = fed()
    for by in (0.04, 0.12, 3600.0):
        state.add([Attitude(0.2 + by, LEVEL, np.ones(3)), position(0.2 + by, 0.1)], horizon=0.2)
    assert state.counters.ahead == 6
    assert state.age(0.2) == 0.2 - 0.18
    assert (state.at(0.2).omega == 0.0).all()
    assert state.age(0.6) > 0.4  # where all are refused, those before them grow old
    state.add([Attitude(0.22, LEVEL, np.ones(3)), position(0.22, 0.0)], horizon=0.2)
    assert state.counters.ahead == 6  # clocks are not known to the last millisecond
    assert state.age(0.2) == 0.0


def test_one_stream_of_the_future_leaves_the_other():
    state = fed()
    state.add([Attitude(0.4, LEVEL, np.zeros(3)), position(0.52, 0.1)], horizon=0.4)
    assert state.counters.ahead == 1
    assert state.age(0.4) == pytest.approx(0.0) or not state.plausible(0.4)


def test_a_clock_that_goes_back_leaves_telemetry_of_the_future():
    state = fed()
    state.add([], horizon=-0.32)
    assert state.age(-0.32) < -0.4


TRIPLE = st.tuples(*[st.integers(-1000, 1000)] * 3).map(lambda a: np.array(a) / 1000.0)


@given(dt=st.floats(0.01, 0.5), before=TRIPLE, a=TRIPLE, way=TRIPLE)
def test_a_jump_is_what_no_motion_of_bounded_acceleration_explains(dt, before, a, way):
    """From any speed; 1 m beyond what 10 m/s² can do is a jump, and less is none."""
    start, v = 100.0 * before, 15.0 * before
    a = 9.9 * a / max(np.linalg.norm(a), 1.0)
    reached = start + v * dt + 0.5 * a * dt**2
    then = v + a * dt
    unit = way / max(np.linalg.norm(way), 1e-6)
    if np.linalg.norm(unit) < 0.9:
        unit = np.array([1.0, 0.0, 0.0])
    mean = start + 0.5 * dt * (v + then)
    room = 1.0 + 0.5 * 10.0 * dt**2
    for there, jumps in (
        (reached, 0),
        (mean + 0.98 * room * unit, 0),
        (mean + 1.02 * room * unit, 1),
    ):
        state = OwnState()
        state.add([LocalPosition(2.0, start, v)])
        state.add([LocalPosition(2.0 + dt, there, then)])
        assert state.counters.jumps == jumps, (there, jumps)


def attitude(time, q=LEVEL, omega=(0.0, 0.0, 0.0)):
    return Attitude(time, np.array(q), np.array(omega))


def euler(time, omega=(0.0, 0.0, 0.0)):
    return EulerAttitude(time, LEVEL, np.array(omega))


def odometry(time, x):
    return Odometry(time, np.array([x, 0.0, 0.0]), np.zeros(3), LEVEL, np.array([0.0, 0.0, x]))


def test_a_state_is_that_of_the_nearest_samples_carried_on_by_their_rates():
    state = OwnState()
    state.add([LocalPosition(0.0, np.array([1.0, 2.0, 3.0]), np.array([0.5, -1.0, 2.0]))])
    assert state.at(0.0) is None
    state.add([attitude(0.05, omega=(0.0, 0.0, 2.0))])
    now = state.at(0.1)
    assert now.time == 0.1
    assert now.p == pytest.approx([1.05, 1.9, 3.2])
    assert now.v == pytest.approx([0.5, -1.0, 2.0])
    assert now.omega == pytest.approx([0.0, 0.0, 2.0])
    assert yaw_of(now.q_wb) == pytest.approx(0.1)
    assert yaw_of(state.at(0.0).q_wb) == pytest.approx(-0.1)


@pytest.mark.parametrize(("time", "x"), [(0.0, 0.0), (0.25, 0.25), (0.26, 0.12), (0.75, 1.1)])
def test_between_two_samples_as_near_the_older_one_counts(time, x):
    state = OwnState()
    state.add([attitude(0.0), LocalPosition(0.0, np.zeros(3), np.array([1.0, 0.0, 0.0]))])
    state.add([LocalPosition(0.5, np.array([0.6, 0.0, 0.0]), np.array([2.0, 0.0, 0.0]))])
    assert state.at(time).p[0] == pytest.approx(x)


def test_of_two_samples_of_one_instant_the_first_counts_and_none_is_out_of_order():
    state = fed(position(0.2, 0.0), position(0.2, 0.1), position(0.24, 0.1))
    assert state.at(0.21).p[0] == 0.0
    assert state.counters.out_of_order == 0


def test_a_hundred_samples_are_remembered():
    state = OwnState()
    state.add([attitude(0.0)])
    state.add([position(0.125 * n, 0.01 * n) for n in range(150)])
    assert state.at(0.125 * 50).p[0] == pytest.approx(0.5)
    assert state.at(0.125 * 49).p[0] == pytest.approx(0.5)


def test_new_attitudes_are_those_of_the_last_call():
    state = fed()
    state.add([attitude(0.2), position(0.2, 0.0), attitude(0.22), attitude(0.1)])
    assert [a.time for a in state.new_attitudes] == [0.2, 0.22]
    state.add([])
    assert state.new_attitudes == []


def test_the_age_is_that_of_the_older_stream():
    state = OwnState()
    state.add([attitude(0.1)])
    assert state.age(0.1) == np.inf
    state.add([position(0.05, 0.0)])
    assert state.age(0.3) == pytest.approx(0.25)
    state.add([position(0.2, 0.0)])
    assert state.age(0.3) == pytest.approx(0.2)
    assert state.age(0.05) == 0.0


def test_while_the_position_is_lost_the_age_is_that_of_the_attitude():
    assert fed(attitude(0.35)).age(0.4) == pytest.approx(0.22)  # 0.17 s without a position
    assert fed(attitude(0.37)).age(0.4) == pytest.approx(0.03)  # 0.19 s


def test_telemetry_beyond_what_the_clock_can_show_has_a_negative_age():
    """The newest sample is of 0.2 s; 30 ms are left open."""
    state = fed(attitude(0.2))
    state.add([], horizon=0.1)
    assert state.age(0.1) == pytest.approx(-0.07)
    state.add([], horizon=0.18)
    assert state.age(0.1) == 0.0


@pytest.mark.parametrize(("by", "refused"), [(0.029, 0), (0.031, 2)])
def test_stamps_may_be_ahead_of_the_clock_by_30_ms(by, refused):
    state = fed()
    state.add([attitude(1.0 + by), position(1.0 + by, 0.0)], horizon=1.0)
    assert state.counters.ahead == refused


@pytest.mark.parametrize(("rested", "refused"), [(False, [1, 2, 4]), (True, [1, 2, 3])])
def test_at_the_third_tick_on_end_with_a_stamp_of_the_future_no_stamp_is_believed(rested, refused):
    """Ticks without samples are none; one of good samples alone makes the count begin anew."""
    state, found = fed(), []
    for k in range(3):
        now = 0.2 + 0.1 * k
        state.add([attitude(now), position(now + 1.0, 0.0)], horizon=now)
        found.append(state.counters.ahead)
        state.add([], horizon=now)
        if rested:
            state.add([attitude(now + 0.01)], horizon=now)
    assert found == refused


@pytest.mark.parametrize(("length", "kept"), [(1.019, 1), (1.021, 0), (0.981, 1), (0.979, 0)])
def test_a_quaternion_may_differ_from_unit_length_by_a_fiftieth(length, kept):
    state = fed(attitude(0.2, q=length * LEVEL))
    assert state.counters.not_unit == 1 - kept
    assert len(state.new_attitudes) == kept
    assert state.counters.too_fast == 0


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(("rate", "kept"), [(34.9, 1), (-34.9, 1), (35.1, 0), (-35.1, 0)])
def test_no_gyro_measures_more_than_35_radians_a_second(axis, rate, kept):
    state = fed(attitude(0.2, omega=rate * np.eye(3)[axis]))
    assert state.counters.too_fast == 1 - kept
    assert len(state.new_attitudes) == kept
    assert state.counters.not_unit == 0


@pytest.mark.parametrize("stream", [attitude, euler])
def test_attitudes_that_are_not_finite_are_refused_and_counted(stream):
    state = fed()
    state.add([attitude(0.2, q=(np.nan, 0.0, 0.0, 0.0)), attitude(0.22, omega=(0.0, 0.0, np.inf))])
    assert state.counters.not_finite == 2
    assert state.new_attitudes == []


@pytest.mark.parametrize(("value", "kept"), [(1.2e-38, True), (-1.2e-38, True), (1.1e-38, False)])
def test_the_least_number_is_the_least_normal_one_of_32_bits(value, kept):
    state = fed(attitude(0.2, omega=(value, 0.0, 0.0)))
    assert state.counters.not_finite == (not kept)


BAD = {"attitude": lambda t: attitude(t, q=2.0 * LEVEL), "position": lambda t: position(t, 5.0)}


@pytest.mark.parametrize("stream", BAD)
@pytest.mark.parametrize(
    ("times", "fault"),
    [
        ((0.2, 0.34), False),
        ((0.2, 0.36), True),
        ((0.2, 0.22, 0.24, 0.26), False),
        ((0.2, 0.22, 0.24, 0.26, 0.28), True),
    ],
)
def test_outliers_are_a_fault_from_five_or_15_hundredths_of_a_second_on(stream, times, fault):
    state = fed(*map(BAD[stream], times))
    assert state.plausible(times[-1] + 0.01) is not fault
    assert state.plausible(times[-1] + 0.99) is not fault
    assert state.plausible(times[-1] + 1.01)


def test_a_jump_that_persists_is_where_the_drone_is():
    times = (0.2, 0.22, 0.24, 0.26, 0.28)
    assert fed(*[position(t, 5.0) for t in times[:4]]).at(0.28).p[0] == 0.0
    state = fed(*[position(t, 5.0) for t in times])
    assert state.at(0.28).p[0] == 5.0
    assert state.counters.jumps == 5
    state.add([position(0.3, 5.0), position(0.32, 9.0)])
    assert state.counters.jumps == 6
    assert state.plausible(1.29)  # one outlier after the fault is no fault
    assert state.at(0.32).p[0] == 5.0


@pytest.mark.parametrize("stream", BAD)
def test_a_good_sample_between_outliers_starts_their_count_anew(stream):
    good = {"attitude": attitude(0.3), "position": position(0.3, 0.0)}[stream]
    state = fed(BAD[stream](0.2), good, BAD[stream](0.38))
    state.add([attitude(0.4), position(0.4, 0.0)])
    assert state.plausible(0.4)


def test_angles_do_not_prove_that_quaternions_are_good_again():
    """The quaternions have been silent for so long that angles replace them."""
    bad = [attitude(t, q=2.0 * LEVEL) for t in (0.75, 0.95)]
    positions = [position(0.02 * n, 0.0) for n in range(10, 48)]
    assert not fed(*positions, bad[0], euler(0.8), bad[1]).plausible(0.96)
    assert fed(*positions, bad[0], attitude(0.8), bad[1]).plausible(0.96)


@pytest.mark.parametrize(("time", "kept"), [(0.67, 0), (0.69, 1)])
def test_angles_beside_quaternions_count_from_half_a_second_without_these(time, kept):
    state = fed(position(0.5, 0.0), euler(time, omega=(1.0, 0.0, 0.0)))
    assert len(state.new_attitudes) == kept
    assert state.at(time).omega[0] == kept
    state.add([euler(time + 0.005)])
    assert len(state.new_attitudes) == kept


@pytest.mark.parametrize(("time", "used"), [(0.67, 0.0), (0.69, 0.25)])
def test_odometry_counts_from_half_a_second_without_the_streams_it_replaces(time, used):
    state = fed(odometry(time, 0.25))
    assert state.at(time).p[0] == used
    assert state.at(time).omega[2] == used


def test_odometry_goes_on_for_its_own_samples_until_the_stream_comes_back():
    state = fed(odometry(0.7, 0.1), odometry(0.72, 0.2), position(0.74, 0.25))
    assert state.at(0.72).p[0] == 0.2
    state.add([odometry(0.76, 0.4)])
    assert state.at(0.76).p[0] == 0.25
    assert state.at(0.76).omega[2] == 0.4


@pytest.mark.parametrize(("back", "reboots"), [(0.9, 0), (1.1, 1)])
def test_a_clock_that_goes_back_by_more_than_a_second_is_a_reboot(back, reboots):
    state = OwnState()
    state.add([attitude(50.0), position(50.0, 0.0)])
    state.add([position(50.0 - back, 0.3) for _ in range(3)])
    assert state.counters.reboots == reboots
    assert state.counters.out_of_order == (2 if reboots else 3)
    assert (state.at(50.0) is None) == bool(reboots)


def test_stamps_of_before_on_end_alone_are_a_reboot():
    state = OwnState()
    state.add([attitude(50.0), position(50.0, 0.0)])
    state.add([position(t, 0.0) for t in (1.0, 1.0, 50.02, 1.0, 1.0)])
    assert state.counters.reboots == 0
    state.add([position(1.0, 0.0)])
    assert state.counters.reboots == 1


def test_after_a_reboot_the_vehicle_is_plausible_and_its_messages_may_be_coarse():
    state = fed(*[position(50.0 + 0.02 * n, 5.0 * (n > 0)) for n in range(6)])
    assert state.rates_by_gyro
    assert not state.plausible(50.1)
    state.add([position(0.1 * n, 0.0) for n in range(3)])
    assert state.counters.reboots == 1
    assert state.plausible(0.2)
    state.add([euler(0.3)])
    assert not state.rates_by_gyro
