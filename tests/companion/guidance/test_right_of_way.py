"""Right of way: which neighbours turn the goal, and to which side."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from companion.guidance.right_of_way import RightOfWayConfig, blocks_way, pass_on_right
from tests.companion.tracks import OWN, track

CONFIG = RightOfWayConfig()
NUMBER = st.floats(-12, 12)


def aimed(*tracks, trunks=(), config=CONFIG):
    """Angle [°] by which the way to a goal straight ahead is turned, to the left."""
    cylinders = np.reshape(np.array(trunks, float), (-1, 3))
    goal = pass_on_right(OWN, tracks, cylinders, np.array([7.0, 0, 2.0]), config)
    assert np.isclose(np.hypot(*goal[:2]), 7.0)
    assert goal[2] == 2.0
    return np.degrees(np.arctan2(goal[1], goal[0]))


def test_an_oncoming_neighbour_is_passed_on_the_right():
    ahead, near_left = aimed(track(1, [4, 0, 0], [-1, 0, 0])), aimed(track(1, [4, 0.8, 0]))
    assert np.isclose(ahead, -np.degrees(np.arctan2(1.0, 4.0)))
    assert ahead < near_left < 0.0


def test_a_trunk_on_the_right_lets_the_drone_pass_on_the_left():
    standing, right, left = track(1, [3, 0, 0]), [3.0, -1.8, 1.0], [3.0, 1.8, 1.0]
    assert np.isclose(aimed(standing, trunks=[right]), np.degrees(np.arctan2(1.0, 3.0)))
    assert aimed(standing, trunks=[left]) < 0.0
    assert aimed(standing, trunks=[left, right]) == 0.0
    assert aimed(standing, trunks=[[3.0, -6.0, 1.0]]) < 0.0
    beside_us = [1.4, -1.6, 1.0]  # leaves 1.26 m to the one that stands
    assert aimed(standing, trunks=[beside_us]) > 0.0


def test_a_neighbour_is_passed_with_as_much_room_as_trunks_leave():
    """Two metres, as set; less by a trunk, but one metre at least."""
    standing, wide = track(1, [4, 0, 0]), RightOfWayConfig(keep_right=2.0)
    for gap, room in ((3.0, 2.0), (2.0, 1.6), (1.5, 1.1)):
        turn = aimed(standing, trunks=[[4.0, -gap - 1.0, 1.0]], config=wide)
        assert np.isclose(turn, -np.degrees(np.arctan2(room, 4.0)))
    left = aimed(standing, trunks=[[4.0, -2.3, 1.0], [4.0, 2.6, 1.0]], config=wide)
    assert np.isclose(left, np.degrees(np.arctan2(1.2, 4.0)))


def test_where_there_is_no_room_on_its_right_one_clearly_on_the_left_turns_nothing():
    wall = [[4.0, y, 0.5] for y in (-1.0, -2.0)]
    assert aimed(track(1, [4, -0.2, 0]), trunks=wall) > 0.0
    near_left = [[4.0, -0.3, 0.5]]  # 0.4 m to its bark
    assert aimed(track(1, [4, 0.6, 0]), trunks=near_left) == 0.0


def test_without_keep_right_the_goal_stays():
    near_trunks = np.array([[3.0, -0.8, 1.0]])
    goal, none = np.array([7.0, 0.5, 2.0]), RightOfWayConfig(keep_right=0.0)
    assert np.allclose(pass_on_right(OWN, [track(1, [3, 0.5, 0])], near_trunks, goal, none), goal)


def test_other_neighbours_do_not_turn_the_goal():
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


def test_a_neighbour_close_ahead_blocks_the_way_beyond_the_next_goal():
    """Round a target's island the next goal is never far."""
    aim = np.array([0.6, 0.0, 0.0])
    assert blocks_way(OWN, track(1, [1.5, 0.2, 0]), aim, CONFIG)
    assert not blocks_way(OWN, track(1, [2.5, 0.2, 0]), aim, CONFIG)
    assert not blocks_way(OWN, track(1, [1.5, 0.2, 0], [1.0, 0, 0]), aim, CONFIG)


def test_a_thin_trunk_close_by_on_the_right_lets_the_drone_pass_on_the_left():
    standing = track(1, [3, 0, 0])
    assert aimed(standing, trunks=[[3.0, -0.9, 0.3]]) > 0.0
    assert aimed(standing, trunks=[[3.0, 0.9, 0.3]]) < 0.0
