"""Strangers: who is taken for one that gives no way."""

from dataclasses import replace

import numpy as np
import pytest

from companion.guidance.right_of_way import RightOfWayConfig
from companion.guidance.speed_limits import SpeedLimitConfig, headway_speed
from companion.guidance.strangers import Strangers
from mavlink_bridge.wire.messages import VehicleState
from tests.companion.tracks import track

CRUISE, STILL, HERE = 1.65, np.zeros(3), np.array([0.0, 0.0, 2.0])


def met(apart, speed, beside=0.0, own=STILL, unseen=0.0, ticks=5, headway=1.5):
    """Return whether a drone `apart` m ahead that comes at `speed` for `ticks` is a stranger."""
    strangers, found = Strangers(SpeedLimitConfig(headway=headway), CRUISE), frozenset()
    for k in range(ticks):
        at = [apart - 0.1 * k * speed, beside, 2.0]
        one = replace(track(7, at, [-speed, 0.0, 0.0]), unseen=unseen)
        found = strangers.update(0.1 * k, HERE + 0.1 * k * own, own, [one])
    return found == {7}


@pytest.mark.parametrize(
    ("found", "case"),
    [
        (True, {"apart": 2.0, "speed": 1.0}),
        (False, {"apart": 2.0, "speed": 1.0, "ticks": 4}),
        (False, {"apart": 2.0, "speed": 1.0, "unseen": 0.4}),
        (False, {"apart": 2.0, "speed": 1.0, "beside": 0.7}),  # it passes by
        (False, {"apart": 2.0, "speed": 1.0, "headway": 0.0}),  # nobody slows down
        (False, {"apart": 3.0, "speed": 1.0}),  # one of ours may be as fast there
        (False, {"apart": 1.5, "speed": 0.6}),  # and so fast anywhere
        (True, {"apart": 1.5, "speed": 0.8}),
        (False, {"apart": 1.5, "speed": -0.8}),
        (True, {"apart": 3.0, "speed": 3.0}),
        # The own drone flees: to follow at its speed is no lack of manners.
        (False, {"apart": 2.0, "speed": 1.5, "own": np.array([-1.0, 0.0, 0.0])}),
        (True, {"apart": 2.0, "speed": 2.2, "own": np.array([-1.0, 0.0, 0.0])}),
    ],
)
def test_who_comes_faster_than_one_of_ours_is_a_stranger(found, case):
    assert met(**case) is found


@pytest.mark.parametrize("apart", np.arange(0.5, 6.0, 0.25))
def test_none_of_ours_is_one(apart):
    """A drone that keeps to its headway is no stranger to the one that it comes at."""
    comes = VehicleState(0.0, np.array([apart, 0.0, 2.0]), STILL, np.array([1.0, 0, 0, 0]), STILL)
    way, limits = np.array([-9.0, 0.0, 0.0]), SpeedLimitConfig()
    us = [track(1, HERE, STILL)]
    speed = headway_speed(comes, us, way, CRUISE, limits, RightOfWayConfig(), 8.0)
    assert not met(apart, speed)


def test_a_stranger_is_one_for_twenty_seconds_in_sight_or_not():
    strangers = Strangers(SpeedLimitConfig(), CRUISE)
    for k in range(5):
        one = [track(7, [2.0, 0.0, 2.0], [-1.0, 0.0, 0.0])]
        assert strangers.update(0.1 * k, HERE, STILL, one) == ({7} if k == 4 else frozenset())
    assert strangers.update(20.3, HERE, STILL, []) == {7}
    assert strangers.update(20.5, HERE, STILL, []) == frozenset()


def test_a_clock_that_begins_anew_ends_it():
    strangers = Strangers(SpeedLimitConfig(), CRUISE)
    for k in range(5):
        strangers.update(100.0 + k, HERE, STILL, [track(7, [2.0, 0.0, 2.0], [-1.0, 0.0, 0.0])])
    assert strangers.update(1.0, HERE, STILL, []) == frozenset()
