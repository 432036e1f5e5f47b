"""Stamps of a vehicle's clock and clocks that heard them, for tests of the vehicle's clock."""

from companion.estimation.vehicle_clock import VehicleClock

START = 100.0  # s, local


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


def is_taken_for_a_jump(clock, ahead, start):
    """Whether stamps that are `ahead` [s] of local time make the clock begin anew."""
    jumped = [clock.hear(start + k / 16, start + k / 16 + ahead) for k in range(3)]
    return any(jumped)
