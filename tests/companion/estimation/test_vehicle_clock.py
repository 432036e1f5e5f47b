"""The vehicle's clock: its offset and rate from stamps that arrive late, in made-up time series."""

import itertools

import numpy as np
import pytest

from companion.estimation.vehicle_clock import VehicleClock
from tests.companion.estimation.clock_stamps import START


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
