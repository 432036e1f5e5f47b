from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from companion.guidance.threat import (
    ThreatConfig,
    blocks_way,
    doubt,
    headway_speed,
    pass_on_right,
    rated_neighbours,
    relative_speed_limit,
    threat,
)
from companion.types import Track
from mavlink_bridge.wire.messages import VehicleState

OWN = VehicleState(0.0, np.zeros(3), np.array([1.5, 0, 0]), np.array([1.0, 0, 0, 0]), np.zeros(3))
CONFIG = ThreatConfig()
NUMBER = st.floats(-12, 12)


def track(n, p, v=(0.0, 0.0, 0.0)):
    return Track(n, np.array(p, float), np.array(v, float), np.eye(6), 1.0, 0.0)


def rated(p, v=(0.0, 0.0, 0.0)):
    return threat(OWN, np.array(p, float), np.array(v, float), CONFIG)


def test_nearer_and_faster_closing_are_worse():
    assert rated([2, 0, 0]) > rated([3, 0, 0])
    assert rated([3, 0, 0], [-1, 0, 0]) > rated([3, 0, 0], [1, 0, 0])


def test_one_who_flies_along_close_by_is_worse_than_one_who_closes_from_afar():
    assert rated([0, 0.8, 0], [1.5, 0, 0]) > rated([3.0, 0, 0])


def test_on_top_of_us_is_finite():
    assert np.isfinite(rated([0, 0, 0]))


@given(st.lists(st.tuples(NUMBER, NUMBER, NUMBER, NUMBER, NUMBER), max_size=9), st.randoms())
def test_worst_first_and_the_order_given_does_not_matter(places, random):
    tracks = [track(n, p[:3], [p[3], p[4], 0.0]) for n, p in enumerate(places)]
    worst = rated_neighbours(OWN, tracks, CONFIG)
    shuffled = list(tracks)
    random.shuffle(shuffled)
    assert [t.id for t, _ in rated_neighbours(OWN, shuffled, CONFIG)] == [t.id for t, _ in worst]
    assert all(np.linalg.norm(t.p) <= CONFIG.range_max for t, _ in worst)
    values = [value for _, value in worst]
    assert values == sorted(values, reverse=True)


def free_speed(*tracks):
    return headway_speed(OWN, tracks, np.array([9.0, 0, 0]), 1.65, CONFIG)


def test_a_formation_that_flies_along_slows_nobody():
    assert free_speed(track(1, [1.7, 0.2, 0], [1.5, 0, 0]), track(2, [0, 1.5, 0])) == 1.65


def test_one_on_the_ground_slows_nobody():
    assert free_speed(track(1, [1.7, 0.0, -2.0])) == 1.65


def test_two_that_meet_at_close_quarters_slow_but_never_stop():
    far, near = (free_speed(track(1, [x, 0, 0], [-1.0, 0, 0])) for x in (4.0, 2.0))
    assert 1.65 > far > near
    assert np.isclose(far, (4.0 - CONFIG.room) / CONFIG.headway - 1.0)
    assert near == CONFIG.creep * 1.65


def test_who_is_behind_or_beside_does_not_count():
    assert free_speed(track(1, [-1.0, 0, 0]), track(2, [0.2, 1.2, 0])) == 1.65


def bound(*tracks, speed=0.5):
    return relative_speed_limit(OWN, tracks, speed, 1.85, CONFIG)


def test_near_others_nobody_is_much_faster_than_they_are():
    assert np.isclose(bound(track(1, [1.1, 0, 0])), CONFIG.calm)
    assert np.isclose(bound(track(1, [1.1, 0, 0], [0.5, 0, 0])), CONFIG.calm + 0.5)
    assert bound(track(1, [4.0, 0, 0])) == 1.85
    assert bound() == 1.85
    assert 0.5 < bound(track(1, [0, 0, 0])) < CONFIG.calm


def test_nobody_flees_from_one_out_of_sight_as_fast_as_that_one_was():
    lost = replace(track(1, [-1.1, 0, 0], [1.0, 0, 0]), unseen=0.6)
    assert np.isclose(bound(lost), CONFIG.calm)
    assert bound(lost, speed=1.65) == 1.65  # one that follows close behind holds nobody up


def test_doubt_of_one_out_of_sight_takes_no_room_that_is_not_free():
    seen = track(1, [1.0, 0, 0])
    assert np.allclose(doubt(OWN, seen, 0.8, 4.0), 1.0)
    assert np.allclose(doubt(OWN, replace(seen, unseen=0.6), 0.8, 4.0), 0.2)
    assert doubt(OWN, replace(seen, unseen=0.6), 1.1, 4.0) == (0.0, 0.0)
    below = replace(track(1, [0.3, 0, -1.0]), unseen=0.6)  # (37) sees it 0.5 m away
    assert np.allclose(doubt(OWN, below, 0.4, 2.5), 0.1)


def aimed(*tracks, trunks=()):
    """Angle [°] by which the way to a goal straight ahead is turned, to the left."""
    cylinders = np.reshape(np.array(trunks, float), (-1, 3))
    goal = pass_on_right(OWN, tracks, cylinders, np.array([7.0, 0, 2.0]), CONFIG)
    assert np.isclose(np.hypot(*goal[:2]), 7.0)
    assert goal[2] == 2.0
    return np.degrees(np.arctan2(goal[1], goal[0]))


def test_who_comes_towards_us_is_passed_on_the_right():
    ahead, near_left = aimed(track(1, [4, 0, 0], [-1, 0, 0])), aimed(track(1, [4, 0.8, 0]))
    assert np.isclose(ahead, -np.degrees(np.arctan2(1.0, 4.0)))
    assert ahead < near_left < 0.0


def test_where_a_trunk_is_on_the_right_one_passes_on_the_left():
    standing, right, left = track(1, [3, 0, 0]), [3.0, -1.8, 1.0], [3.0, 1.8, 1.0]
    assert np.isclose(aimed(standing, trunks=[right]), np.degrees(np.arctan2(1.0, 3.0)))
    assert aimed(standing, trunks=[left]) < 0.0
    assert aimed(standing, trunks=[left, right]) == 0.0
    assert aimed(standing, trunks=[[3.0, -6.0, 1.0]]) < 0.0
    beside_us = [1.4, -1.6, 1.0]  # leaves 1.26 m to the one that stands
    assert aimed(standing, trunks=[beside_us]) > 0.0


def test_without_keep_right_nobody_turns_us():
    near_trunks = np.array([[3.0, -0.8, 1.0]])
    goal, none = np.array([7.0, 0.5, 2.0]), ThreatConfig(keep_right=0.0)
    assert np.allclose(pass_on_right(OWN, [track(1, [3, 0.5, 0])], near_trunks, goal, none), goal)


def test_nobody_else_turns_us():
    assert aimed() == 0.0
    assert aimed(track(1, [4, 0, 0], [1, 0, 0])) == 0.0  # flies along
    assert aimed(track(1, [4, 0, -2])) == 0.0  # has landed
    assert aimed(track(1, [4, 1.1, 0], [-1, 0, 0])) == 0.0  # passes on the left
    assert aimed(track(1, [4, -0.6, 0], [-1, 0, 0])) == 0.0  # clearly on the right
    assert aimed(track(1, [-2, 0, 0], [1, 0, 0])) == 0.0  # behind
    assert aimed(track(1, [6.5, 0, 0], [-1, 0, 0])) == 0.0  # far


@given(st.lists(st.tuples(NUMBER, NUMBER, NUMBER, NUMBER), max_size=9))
def test_the_turn_is_finite_and_bounded(places):
    tracks = [track(n, [p[0], p[1], 0.0], [p[2], p[3], 0.0]) for n, p in enumerate(places)]
    assert -35.0 < aimed(*tracks) <= 1e-9
    assert abs(aimed(*tracks, trunks=[[1, -1, 1], [3, 2, 0.5]])) < 35.0


def test_who_stands_close_ahead_is_in_the_way_though_the_next_aim_is_nearer():
    """Round a target's island the aim is never far; company keeps 2 m, so nobody got past."""
    aim = np.array([0.6, 0.0, 0.0])
    assert blocks_way(OWN, track(1, [1.5, 0.2, 0]), aim, CONFIG)
    assert not blocks_way(OWN, track(1, [2.5, 0.2, 0]), aim, CONFIG)
    assert not blocks_way(OWN, track(1, [1.5, 0.2, 0], [1.0, 0, 0]), aim, CONFIG)
