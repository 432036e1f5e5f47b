"""The vehicle's clock by answers to requests: they bound it, prove jumps, and refute stamps."""

import pytest

from companion.estimation.vehicle_clock import VehicleClock
from tests.companion.estimation.clock_stamps import START, is_taken_for_a_jump, that_heard, ticks


def that_answered(seconds=2.0, forth=0.005, back=0.005, rate=1.0, since=0.0):
    """A clock of a `rate`, asked and answered at each tick from `since` on; times in s."""
    clock = VehicleClock()
    for t in ticks(seconds):
        clock.hear(t, rate * (t - back))
        if t > START + since:
            clock.hear_answer(t - back - forth, rate * (t - back), t)
    return clock


def test_answers_put_the_clock_midway_between_the_bounds_and_bound_its_doubt():
    """5 ms each way, so that 10 ms are open at the newest stamp, and 5 ms are between.

    Rates are tried in steps of 2.75 ms over the 2.01 s: three of them fit between the bounds. On
    top comes the millisecond of the stamps.
    """
    clock = that_answered().estimate
    assert clock.vehicle(107.0) == pytest.approx(107.0, abs=1e-6)
    assert clock.rate == pytest.approx(1.0)
    assert clock.bounded
    assert clock.rate_doubt == pytest.approx(0.00925 / 2.01, rel=1e-3)
    assert clock.doubt == pytest.approx(0.006 + 0.01 * 0.00825 / 2.01, rel=1e-3)


@pytest.mark.parametrize("rate", [0.8, 1.3])
def test_bounds_that_cross_by_the_resolution_of_stamps_still_give_rate_and_doubt(rate):
    """Stamps are ahead of the clock by 1 ms and behind it by 1 ms: twice 2 ms are in doubt."""
    clock = VehicleClock()
    for t in ticks(2.0):
        clock.hear(t, rate * t + 0.001)
        clock.hear_answer(t, rate * t - 0.001, t)
    assert clock.estimate.rate == pytest.approx(rate, abs=1e-5)
    assert clock.estimate.vehicle(102.05) == pytest.approx(102.05 * rate, abs=2e-5)
    assert clock.estimate.doubt == pytest.approx(0.004, abs=1e-4)
    assert clock.estimate.rate_doubt == pytest.approx(0.0005, abs=2e-5)


@pytest.mark.parametrize(("answers", "bounded"), [(3, False), (4, True)])
def test_four_answers_bound_a_clock(answers, bounded):
    clock = that_heard(2.0, latency=0.005)
    for k in range(answers):
        t = 102.15 + 0.4 * k
        clock.hear_answer(t - 0.01, t - 0.005, t)
    assert clock.estimate.bounded is bounded
    assert clock.estimate.vehicle(103.0) == pytest.approx(103.0 if bounded else 102.995, abs=1e-5)


@pytest.mark.parametrize(("since", "error"), [(1.3, -0.005), (1.2, 0.0)])
def test_answers_of_less_than_eight_tenths_of_a_second_leave_the_line_above_the_stamps(
    since, error
):
    clock = that_answered(since=since).estimate
    assert clock.vehicle(102.0) - 102.0 == pytest.approx(error, abs=1e-5)


def that_stepped_back(ago, by):
    """A clock that was set back, so many s ago, of a link that takes no time; asked at 108.05 s."""
    clock = VehicleClock()
    for t in ticks(8.0):
        stamp = t - by * (t > 108.0 - ago)
        clock.hear(t, stamp)
        clock.hear_answer(t, stamp, t)
    return clock.estimate


@pytest.mark.parametrize(("ago", "counts"), [(1.5, 1.0), (2.5, 2.0), (4.5, 4.0)])
def test_where_the_bounds_cross_by_more_than_3_ms_only_later_ones_count(ago, counts):
    """Those of one, two or four seconds; over these, 1 ms of the stamps is the rate's doubt."""
    clock = that_stepped_back(ago, 0.005)
    assert clock.vehicle(108.05) == pytest.approx(108.045, abs=1e-4)
    assert clock.rate_doubt == pytest.approx(0.001 / counts, rel=0.12)


@pytest.mark.parametrize(("by", "counts"), [(0.0026, False), (0.0034, True)])
def test_bounds_that_cross_by_less_than_3_ms_all_count(by, counts):
    clock = that_stepped_back(1.5, by)
    assert (clock.rate_doubt > 0.0009) is counts


@pytest.mark.parametrize(("early", "jumped"), [(0.19, False), (0.21, True)])
def test_an_answer_that_is_a_fifth_of_a_second_too_early_is_a_jump_back(early, jumped):
    clock = that_heard(2.0)
    assert clock.hear_answer(102.15, 102.15 - early, 102.2) is jumped
    assert clock.estimate.jumps == jumped


def test_an_answer_that_came_before_its_request_bounds_nothing():
    clock = that_heard(2.0)
    assert not clock.hear_answer(102.5, 101.0, 102.2)
    assert clock.estimate.jumps == 0
    assert clock.estimate.vehicle(102.2) == pytest.approx(102.2)


@pytest.mark.parametrize(("ahead", "left"), [(0.028, 0.028), (0.045, 0.0)])
def test_an_answer_takes_back_a_stamp_that_was_ahead_by_more_than_30_ms(ahead, left):
    clock = that_heard(2.0)
    clock.hear(102.15, 102.15 + ahead)
    assert clock.estimate.vehicle(102.15) - 102.15 == pytest.approx(ahead)
    clock.hear_answer(102.15, 102.15, 102.15)
    assert clock.estimate.vehicle(102.15) - 102.15 == pytest.approx(left, abs=1e-6)


@pytest.mark.parametrize(("ahead", "moved"), [(0.07, True), (0.09, False)])
def test_after_a_jump_an_answer_refutes_what_no_change_of_the_rate_by_a_tenth_explains(
    ahead, moved
):
    """Half a second after the answer: 30 ms, and a tenth of 0.5 s."""
    clock = that_heard(2.0)
    assert is_taken_for_a_jump(clock, 5.0, 102.15)
    clock.hear_answer(102.3, 107.3, 102.3)
    clock.hear(102.8, 107.8 + ahead)
    expected = 107.8 + ahead if moved else 107.8
    assert clock.estimate.vehicle(102.8) == pytest.approx(expected)


def test_where_the_newest_stamp_is_late_the_floors_before_it_leave_more_in_doubt():
    """It is 10 ms late, so that the bound of a tenth of a second before counts.

    Of the rates in steps of 2.75 ms over the 2.11 s, three fit; they part over that tenth.
    """
    clock = that_answered()
    clock.hear_answer(102.135, 102.14, 102.15)
    clock = clock.estimate
    assert clock.vehicle(107.0) == pytest.approx(107.0, abs=1e-6)
    assert clock.rate_doubt == pytest.approx(0.00925 / 2.11, rel=1e-3)
    assert clock.doubt == pytest.approx(0.006 + 0.1 * 0.00825 / 2.11, rel=1e-3)
