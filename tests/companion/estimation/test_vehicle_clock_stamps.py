"""The vehicle's clock by single stamps: offset, rate, their doubts, and what is a jump."""

import itertools
import math

import numpy as np
import pytest

from companion.estimation.vehicle_clock import ClockEstimate, VehicleClock
from tests.companion.estimation.clock_stamps import START, is_taken_for_a_jump, that_heard, ticks


def test_an_estimate_is_a_line_over_local_time():
    clock = ClockEstimate(10.0, 2.0)
    assert clock.vehicle(3.0) == 16.0
    assert clock.local(16.0) == 3.0


def test_of_one_stamp_the_rate_is_not_known_and_taken_for_one():
    clock = VehicleClock()
    assert clock.estimate is None
    assert not clock.hear(100.0, 30.0)
    assert clock.estimate == ClockEstimate(-70.0, 1.0, 0.02, math.inf, False, 0)
    assert not clock.estimate.measured


@pytest.mark.parametrize(("arrival", "stamp"), [(np.nan, 1.0), (1.0, np.nan), (np.inf, 1.0)])
def test_what_is_no_number_is_no_first_stamp(arrival, stamp):
    clock = VehicleClock()
    assert not clock.hear(arrival, stamp)
    assert not clock.hear_answer(0.5, stamp, arrival)
    assert clock.estimate is None


def test_while_the_rate_is_not_known_the_quickest_stamp_tells_the_offset():
    clock = VehicleClock()
    for arrival, stamp in [(100.0, 50.0), (100.2, 50.21), (100.4, 50.38)]:
        clock.hear(arrival, stamp)
    assert clock.estimate.offset == pytest.approx(-49.99)
    assert clock.estimate.rate == 1.0
    assert clock.estimate.doubt == 0.02


def test_of_a_tenth_of_a_second_the_least_delayed_stamp_counts_wherever_it_comes():
    for order in itertools.permutations([(100.01, 7.0), (100.05, 7.03), (100.09, 7.05)]):
        clock = VehicleClock()
        for arrival, stamp in order:
            clock.hear(arrival, stamp)
        assert clock.estimate.offset == pytest.approx(-93.01)


def test_stamps_that_are_all_as_late_leave_the_doubt_of_the_latency_and_of_their_milliseconds():
    """1 ms over two seconds is a rate of 0.0005; at the newest it is worth half a millisecond."""
    follower = VehicleClock()
    for k in range(17):
        follower.hear(100.0 + k / 8, 100.0 + k / 8)
    clock = follower.estimate
    assert clock.rate == pytest.approx(1.0)
    assert clock.vehicle(107.0) == pytest.approx(107.0)
    assert clock.rate_doubt == pytest.approx(0.0005)
    assert clock.doubt == pytest.approx(0.0205)
    assert clock.measured
    assert not clock.bounded


def test_latencies_that_differ_add_to_the_doubt():
    """Two of three stamps are 10 ms late: of the rate, 1 and 10 ms over 2.1 s."""
    clock = VehicleClock()
    for k, t in enumerate(ticks(2.1)):
        clock.hear(t, 0.5 * t - 0.01 * (k % 3 > 0))
    assert clock.estimate.rate == pytest.approx(0.5)
    assert clock.estimate.vehicle(110.0) == pytest.approx(55.0)
    assert clock.estimate.rate_doubt == pytest.approx(0.011 / 2.1)
    assert clock.estimate.doubt == pytest.approx(0.0255)


@pytest.mark.parametrize(("seconds", "measured"), [(0.7, False), (0.9, True)])
def test_a_rate_is_believed_after_eight_tenths_of_a_second(seconds, measured):
    assert that_heard(seconds).estimate.measured is measured


@pytest.mark.parametrize(("rate", "believed"), [(0.39, 0), (0.41, 1), (2.45, 1), (2.55, 0)])
def test_rates_from_two_fifths_to_five_halves_are_believed(rate, believed):
    clock = VehicleClock()
    for t in ticks(2.0):
        clock.hear(t, rate * t)
    assert clock.estimate.rate == pytest.approx(rate if believed else 1.0)
    assert clock.estimate.measured == believed


def that_slowed_down(to, seconds):
    """The clock of a vehicle that ran at the local rate for ten seconds, and then at `to`."""
    clock = VehicleClock()
    for t in ticks(10.0 + seconds):
        clock.hear(t, t - (1.0 - to) * max(t - START - 10.05, 0.0))
    return clock.estimate


@pytest.mark.parametrize(("seconds", "rate"), [(1.8, 1.0), (2.2, 0.996)])
def test_a_slight_change_of_the_rate_shows_after_a_quarter_of_eight_seconds(seconds, rate):
    assert that_slowed_down(0.996, seconds).rate == pytest.approx(rate, abs=1e-6)


@pytest.mark.parametrize(("seconds", "rate"), [(1.0, 1.0), (1.2, 0.92)])
def test_a_change_that_makes_a_whole_second_late_by_a_centisecond_shows_sooner(seconds, rate):
    assert that_slowed_down(0.92, seconds).rate == pytest.approx(rate, abs=1e-6)


@pytest.mark.parametrize(("ahead", "odd"), [(0.05, False), (0.052, True)])
def test_stamps_ahead_of_a_measured_clock_by_more_than_its_doubt_and_30_ms_are_a_jump(ahead, odd):
    """Its doubt is 20.5 ms."""
    assert is_taken_for_a_jump(that_heard(2.0), ahead, 102.15) is odd


@pytest.mark.parametrize(("stamp", "another"), [(101.06, False), (101.04, True)])
def test_stamps_more_than_a_second_before_the_last_one_are_of_another_boot(stamp, another):
    """The last one was 102.05 s."""
    clock = that_heard(2.0)
    for t in (102.06, 102.12, 102.18):
        jumped = clock.hear(t, stamp)
    assert jumped is another
    assert clock.estimate.vehicle(102.18) == pytest.approx(stamp if another else 102.18)


@pytest.mark.parametrize(("stamp", "moved"), [(50.74, True), (50.76, False), (49.01, False)])
def test_while_the_rate_is_not_known_stamps_may_run_ahead_by_a_half_more_than_time(stamp, moved):
    """0.25 s, and 1.5 of the 0.2 s since the first one: by 0.55 s beyond 50.2 s."""
    clock = VehicleClock()
    clock.hear(100.0, 50.0)
    clock.hear(100.2, stamp)
    assert clock.estimate.vehicle(100.2) == pytest.approx(stamp if moved else 50.2)


def test_two_stamps_of_one_instant_may_be_as_far_ahead_as_they_like():
    clock = VehicleClock()
    clock.hear(100.0, 50.0)
    clock.hear(100.0, 55.0)
    assert clock.estimate.vehicle(100.0) == pytest.approx(55.0)


@pytest.mark.parametrize(
    ("times", "jumped"),
    [((0.0, 0.06, 0.12), True), ((0.0, 0.04, 0.09), False), ((0.0, 0.2), False)],
)
def test_a_jump_takes_three_odd_stamps_over_a_tenth_of_a_second(times, jumped):
    clock = that_heard(2.0)
    found = [clock.hear(102.15 + t, 107.15 + t) for t in times]
    assert found == [False] * (len(times) - 1) + [jumped]
    assert clock.estimate.jumps == jumped


def test_a_good_stamp_between_odd_ones_starts_their_count_anew():
    clock = that_heard(2.0)
    for t, off in [(102.15, 5.0), (102.25, 5.0), (102.35, 0.0), (102.45, 5.0), (102.55, 5.0)]:
        assert not clock.hear(t, t + off)
    assert clock.hear(102.65, 107.65)


def test_a_clock_that_jumped_keeps_its_rate_and_forgets_its_offset():
    clock = VehicleClock()
    for t in ticks(2.0):
        clock.hear(t, 0.5 * t)
    assert clock.estimate.measured
    for t in (102.15, 102.25, 102.35):
        jumped = clock.hear(t, 0.5 * t + 8.0)
    assert jumped
    assert clock.estimate.rate == pytest.approx(0.5)
    assert clock.estimate.offset == pytest.approx(8.0)
    assert clock.estimate.doubt == 0.02
    assert not clock.estimate.measured
    assert clock.estimate.jumps == 1
    for t in ticks(1.0, 102.4):
        clock.hear(t, 0.5 * t + 8.0)
    assert clock.estimate.measured
    assert clock.estimate.jumps == 1
