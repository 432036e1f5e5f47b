"""Speed limits by view, by neighbours ahead and by neighbours near."""

import math
from dataclasses import replace

import numpy as np

from companion.estimation.delay import Delay
from companion.guidance.right_of_way import RightOfWayConfig
from companion.guidance.speed_limits import (
    SpeedLimitConfig,
    followed,
    headway_speed,
    reaction_speed,
    relative_speed_limit,
    visibility_speed,
)
from tests.companion.tracks import OWN, track

CONFIG, FAR = SpeedLimitConfig(), np.array([9.0, 0.0, 0.0])


def free_speed(*tracks):
    way = np.array([9.0, 0, 0])
    return headway_speed(OWN, tracks, way, 1.65, CONFIG, RightOfWayConfig(), range_max=10.0)


def test_a_formation_that_flies_along_is_no_limit():
    assert free_speed(track(1, [1.7, 0.2, 0], [1.5, 0, 0]), track(2, [0, 1.5, 0])) == 1.65


def test_behind_a_fast_one_there_is_room_to_brake_after_it_does():
    """By time: both fly along; the one ahead brakes by 4 m/s² from now, this by 3 after 0.25 s."""
    for ahead, room in ((5.0, 1.0), (4.3, 1.8), (2.0, 0.5), (1.0, 3.0)):
        speed = followed(ahead, CONFIG.clearance + room, CONFIG)
        assert speed <= ahead + room / CONFIG.headway
        dt, left, mine, its = 1e-3, room, speed, ahead
        for k in range(5000):
            mine = max(mine - (3.0 * dt if k * dt >= 0.25 else 0.0), 0.0)
            its = max(its - 4.0 * dt, 0.0)
            left += (its - mine) * dt
        assert left > -0.01
        if speed < ahead + room / CONFIG.headway - 1e-6:  # the room is used
            assert left < 0.01


def test_a_neighbour_on_the_ground_is_no_limit():
    assert free_speed(track(1, [1.7, 0.0, -2.0])) == 1.65


def test_two_drones_that_meet_slow_down_but_never_stop():
    far, near = (free_speed(track(1, [x, 0, 0], [-1.0, 0, 0])) for x in (4.0, 2.0))
    assert 1.65 > far > near
    assert np.isclose(far, (4.0 - CONFIG.clearance) / CONFIG.headway - 1.0)
    assert near == CONFIG.headway_least * 1.65


def test_a_neighbour_behind_or_beside_does_not_count():
    assert free_speed(track(1, [-1.0, 0, 0]), track(2, [0.2, 1.2, 0])) == 1.65


def bound(*tracks, speed=0.5):
    return relative_speed_limit(OWN, tracks, speed, 1.85, CONFIG)


def test_a_drone_near_others_is_not_much_faster_than_they_are():
    assert np.isclose(bound(track(1, [1.1, 0, 0])), CONFIG.relative_speed)
    assert np.isclose(bound(track(1, [1.1, 0, 0], [0.5, 0, 0])), CONFIG.relative_speed + 0.5)
    assert bound(track(1, [4.0, 0, 0])) == 1.85
    assert bound() == 1.85
    assert 0.5 < bound(track(1, [0, 0, 0])) < CONFIG.relative_speed


def test_the_old_speed_of_a_neighbour_out_of_sight_is_no_reason_to_flee():
    lost = replace(track(1, [-1.1, 0, 0], [1.0, 0, 0]), unseen=0.6)
    assert np.isclose(bound(lost), CONFIG.relative_speed)
    assert bound(lost, speed=1.65) == 1.65  # a follower close behind is no limit


def test_the_drone_flies_slowly_where_it_does_not_look():
    c = SpeedLimitConfig()
    assert visibility_speed(c, 0.0, FAR) == 1.0
    assert visibility_speed(c, math.pi, FAR) == c.no_view_share
    assert c.no_view_share < visibility_speed(c, 1.0, FAR) < 1.0


def test_a_command_acts_before_the_drone_is_far():
    """1.65 m/s and more with the delay of a board, less where it is long or in doubt."""
    assert reaction_speed(CONFIG, Delay(0.06, 0.003)) > 4.0
    assert math.isclose(reaction_speed(CONFIG, Delay(0.3, 0.005)), 0.3 / 0.31)
    assert math.isclose(reaction_speed(CONFIG, Delay(0.06, 0.1)), 0.3 / 0.26)
