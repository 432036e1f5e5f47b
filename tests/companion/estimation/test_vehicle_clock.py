"""The vehicle's clock: its offset and rate from stamps that arrive late, in made-up time series."""

import itertools
import math

import numpy as np
import pytest

from companion.estimation.vehicle_clock import ClockEstimate, VehicleClock

START = 100.0  # s, local


def quick(rng):
    """A cable: 1 ms and more."""
    return 0.001 + rng.exponential(0.004)


def wild(rng):
    """A bad radio."""
    return rng.uniform(0.0, 0.1)


def follow(clock_at, seconds=20.0, latency=quick, loss=0.0, answers=True):
    """Yield (local time, error [s], clock, jumped) at each of 100 messages a second.

    clock_at: the vehicle's time [s] at a local time.
    """
    rng, follower, events = np.random.default_rng(3), VehicleClock(), []
    for k in range(round(50 * seconds)):
        made = START + 0.02 * k
        events += [(made + latency(rng), made, None) for _ in range(2)]
        if answers and k % 12 == 0:
            answered = made + latency(rng)
            events.append((answered + latency(rng), answered, made))
    for arrival, made, sent in sorted(events, key=lambda e: e[0]):
        if rng.random() < loss:
            continue
        if sent is None:  # telemetry has whole milliseconds
            jumped = follower.hear(arrival, round(clock_at(made), 3))
        else:
            jumped = follower.hear_answer(sent, clock_at(made), arrival)
        error = follower.estimate.vehicle(arrival) - clock_at(arrival)
        yield arrival - START, error, follower, jumped


def worst(followed, since=1.5):
    return max(abs(error) for t, error, *_ in followed if t > since)


@pytest.mark.parametrize("answers", [True, False])
@pytest.mark.parametrize("rate", [0.5, 0.8, 0.95, 0.98, 1.0, 1.05, 2.0])
def test_any_steady_rate_is_found_within_a_second_and_a_half(rate, answers):
    followed = list(follow(lambda t: 7.0 + rate * (t - START), answers=answers))
    assert worst(followed) < (0.0015 if answers else 0.003)
    clock = followed[-1][2].estimate
    assert abs(clock.rate - rate) < clock.rate_doubt < 0.002
    assert clock.bounded is answers
    assert not any(jumped for *_, jumped in followed)


@pytest.mark.parametrize("rate", [0.5, 0.98, 1.0, 2.0])
def test_a_bad_radio_that_delays_by_up_to_100_ms_and_loses_a_tenth(rate):
    followed = list(follow(lambda t: 7.0 + rate * (t - START), latency=wild, loss=0.1))
    assert worst(followed, 3.0) < 0.012
    assert all(abs(error) <= c.estimate.doubt for t, error, c, _ in followed if t > 3.0)


def test_messages_that_come_in_bursts():
    """All that was made in half a second arrives together."""
    clock = VehicleClock()
    for burst in range(40):
        arrival = START + 0.5 * burst + 0.002
        for k in range(25):
            clock.hear(arrival, 7.0 + 0.95 * (arrival - 0.002 - 0.48 + 0.02 * k - START))
        if burst > 4:
            assert abs(clock.estimate.vehicle(arrival) - 7.0 - 0.95 * (arrival - START)) < 0.004
    assert clock.estimate.rate == pytest.approx(0.95, abs=1e-4)
    assert clock.estimate.jumps == 0


def slowing(t):
    """From rate 1 to 0.8 in twenty seconds."""
    s = t - START
    return 7.0 + s - 0.005 * np.clip(s - 5.0, 0.0, 20.0) ** 2 - 0.2 * max(s - 25.0, 0.0)


def test_a_rate_that_changes():
    assert worst(follow(slowing, 35.0)) < 0.02
    assert worst(follow(slowing, 35.0, answers=False)) < 0.035
    *_, (_, _, clock, _) = follow(slowing, 35.0)
    assert clock.estimate.rate == pytest.approx(0.8, abs=1e-3)


def test_a_simulator_that_suddenly_slows_down_by_a_tenth():
    def loaded(t):
        return t - 0.1 * max(t - START - 10.0, 0.0)

    assert worst(follow(loaded)) < 0.04


@pytest.mark.parametrize("answers", [True, False])
@pytest.mark.parametrize("by", [0.5, 0.12, -3.0, -95.0])
def test_a_jump_is_noticed_and_followed(by, answers):
    """By −95 s: the vehicle has started anew."""
    followed = list(follow(lambda t: t + by * (t > START + 10.0), answers=answers))
    (jump,) = [t for t, *_, jumped in followed if jumped]
    assert 10.0 < jump < 10.2
    assert worst(followed, jump + 0.3) < 0.007
    assert followed[-1][2].estimate.jumps == 1


def test_an_answer_proves_a_short_jump_back():
    followed = list(follow(lambda t: t - 0.5 * (t > START + 10.0)))
    assert [round(t, 0) for t, *_, jumped in followed if jumped] == [10.0]
    assert worst(followed, 10.6) < 0.007


def test_a_late_link_is_not_taken_for_a_slow_clock():
    """From 10 s on all comes 200 ms later: the doubt says it, and the clock is not set back."""
    rng, clock = np.random.default_rng(0), VehicleClock()
    for k in range(1000):
        made = START + 0.02 * k
        late = 0.2 * (k > 500) + 0.001 + rng.exponential(0.002)
        clock.hear(made + late, made)
        if k % 12 == 0:
            clock.hear_answer(made - 0.003, made, made + late)
        if 550 < k < 800:
            assert abs(clock.estimate.vehicle(made + late) - made - late) < 0.01
    error = clock.estimate.vehicle(made + late) - made - late
    assert -clock.estimate.doubt < error < -0.05
    assert clock.estimate.doubt > 0.08


def test_one_stream_of_the_future_moves_nothing():
    truth, clock = [], VehicleClock()
    for k in range(500):
        arrival = START + 0.02 * k
        assert not clock.hear(arrival, arrival - 0.002)
        assert not clock.hear(arrival, arrival + (0.12 if k > 100 else -0.002))
        truth.append(abs(clock.estimate.vehicle(arrival) - arrival))
    assert max(truth) < 0.003


def test_answers_refute_a_stream_that_was_of_the_future_from_the_start():
    clock = VehicleClock()
    for k in range(500):
        arrival = START + 0.02 * k
        clock.hear(arrival, arrival + 0.12)
        clock.hear(arrival, arrival - 0.002)
        if k % 12 == 0:
            clock.hear_answer(arrival - 0.004, arrival - 0.002, arrival)
    assert abs(clock.estimate.vehicle(arrival) - arrival) < 0.01


def test_a_few_odd_stamps_and_what_is_no_number_are_ignored():
    clock = VehicleClock()
    odd = itertools.cycle([3600.0, -3600.0, np.nan, np.inf])
    for k in range(500):
        arrival = START + 0.02 * k
        clock.hear(arrival, arrival - 0.002)
        if k % 10 == 9:
            clock.hear(arrival, arrival + next(odd))
    assert clock.estimate.jumps == 0
    assert abs(clock.estimate.vehicle(arrival) - arrival) < 0.003


def test_times_are_turned_over_both_ways():
    *_, (_, _, clock, _) = follow(lambda t: 7.0 + 0.8 * (t - START), 3.0)
    assert clock.estimate.local(clock.estimate.vehicle(123.4)) == pytest.approx(123.4)
    assert clock.estimate.local(8.0) - clock.estimate.local(7.92) == pytest.approx(0.1, abs=1e-3)


def ticks(seconds, start=START):
    """Local times [s], ten a second, each amid a tenth of a second."""
    return [start + 0.05 + 0.1 * k for k in range(round(10 * seconds) + 1)]


def that_heard(seconds=2.0, latency=0.0):
    """A clock that shows local time, whose stamps all arrive after the same `latency` [s]."""
    clock = VehicleClock()
    for t in ticks(seconds):
        assert not clock.hear(t, t - latency)
        assert clock.estimate is not None
    return clock


def that_answered(seconds=2.0, forth=0.005, back=0.005, rate=1.0, since=0.0):
    """A clock of a `rate`, asked and answered at each tick from `since` on; times in s."""
    clock = VehicleClock()
    for t in ticks(seconds):
        clock.hear(t, rate * (t - back))
        if t > START + since:
            clock.hear_answer(t - back - forth, rate * (t - back), t)
    return clock


def is_taken_for_a_jump(clock, ahead, start):
    """Whether stamps that are `ahead` [s] of local time make the clock begin anew."""
    jumped = [clock.hear(start + k / 16, start + k / 16 + ahead) for k in range(3)]
    return any(jumped)


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


@pytest.mark.parametrize("first", [0.4, 0.5, 1.37, 2.0, 2.4])
@pytest.mark.parametrize("lasts", [0.9, 1.3, 2.0])
def test_a_rate_that_was_wrong_at_first_is_measured_anew(first, lasts):
    """A simulator that catches up at its start: answers then refute stamps that are right."""

    def clock_at(local):
        since = local - START
        return 7.0 + first * min(since, lasts) + 0.8 * max(since - lasts, 0.0)

    followed = list(follow(clock_at, seconds=12.0))
    assert worst(followed, lasts + 4.0) < 0.005
    assert followed[-1][2].estimate.rate == pytest.approx(0.8, abs=0.002)
