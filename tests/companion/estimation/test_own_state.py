"""The own state: which samples it refuses, and when it is no longer plausible."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.estimation.own_state import OwnState
from mavlink_bridge.wire.messages import Attitude, LocalPosition

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
