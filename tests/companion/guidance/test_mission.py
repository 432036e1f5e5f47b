"""The mission: goals in order, round their islands, on the drone's level."""

import math

import numpy as np
import pytest

from companion.guidance.goals import Goal
from companion.guidance.mission import Mission, MissionConfig, Roundabout, outside, turn_side
from mavlink_bridge.wire.messages import VehicleState

NOTHING = np.zeros((0, 3))
GOALS = [[0.0, 20.0, 2.0], [15.0, 20.0, 2.0], [15.0, 0.0, 2.0]]


def at(p, v=(0.0, 0.0, 0.0), time=0.0):
    level = np.array([1.0, 0.0, 0.0, 0.0])
    return VehicleState(time, np.array(p, float), np.array(v, float), level, np.zeros(3))


def walk(mission, p, step=0.1, most=2000, keep_out=NOTHING):
    """The places of a point that goes where the mission leads it, and its last progress.

    It slides along the circles keep_out (K,3) m, to the right where its aim is right behind one.
    """
    path = [np.array(p, float)]
    for _ in range(most):
        progress = mission.update(at(path[-1]), keep_out=keep_out)
        if progress.complete:
            break
        d = progress.goal - path[-1]
        path.append(path[-1] + d * min(step / max(np.linalg.norm(d), 1e-9), 1.0))
        for x, y, radius in keep_out:
            out = path[-1][:2] - [x, y]
            if (off := np.linalg.norm(out)) < radius:
                ahead = abs(d[0] * out[1] - d[1] * out[0]) < 0.06 * np.hypot(*d[:2]) * off
                angle = math.atan2(out[1], out[0]) + 0.05 * (ahead and d[:2] @ out < 0)
                path[-1][:2] = x + radius * math.cos(angle), y + radius * math.sin(angle)
    return np.array(path), progress


def random_trunk(seed, most):
    """A circle (1,3) m around a trunk at most `most` [m] from the goal (0, 20)."""
    rng = np.random.default_rng(seed)
    angle, off = rng.uniform(-math.pi, math.pi), rng.uniform(0.0, most)
    return np.array([[off * math.sin(angle), 20.0 + off * math.cos(angle), rng.uniform(0.7, 1.6)]])


@pytest.mark.parametrize("seed", range(30))
def test_a_trunk_in_the_way_round_a_goal_is_got_round(seed):
    trunk = random_trunk(seed, 3.3)
    mission = Mission(MissionConfig(goals=GOALS, tolerance=3.0))
    path, progress = walk(mission, [0.0, 0.0, 2.0], keep_out=trunk)
    assert progress.complete
    assert np.linalg.norm(path - GOALS[0], axis=1).min() <= 3.0
    assert np.hypot(*(path[:, :2] - trunk[0, :2]).T).min() > trunk[0, 2] - 1e-6


def test_a_goal_that_a_trunk_stands_at_is_reached_as_near_as_it_allows():
    """The whole way round, 0.65 m from the goal, lies in the trunk or too near to it."""
    trunk = np.array([[0.1, 20.05, 0.9]])
    path, progress = walk(Mission(MissionConfig(goals=GOALS)), [0.0, 0.0, 2.0], keep_out=trunk)
    assert progress.complete
    assert np.linalg.norm(path - GOALS[0], axis=1).min() <= 1.0


def test_a_place_in_trunks_is_moved_out_of_them():
    here, trunks = np.array([4.0, 0.0, 1.0]), np.array([[0.0, 0.0, 1.0], [1.2, -0.3, 0.5]])
    middle = np.array([0.0, 0.0, 2.0])
    assert np.allclose(outside(middle, here, trunks[:1]), [1.0, 0.0, 2.0])  # towards the drone
    x, y, _ = outside(np.array([0.9, 0.0, 2.0]), here, trunks)  # in both
    assert (np.hypot(x - trunks[:, 0], y - trunks[:, 1]) > trunks[:, 2] - 0.03).all()
    assert np.hypot(x - 0.9, y) < 0.3
    assert np.array_equal(outside(here, here, trunks), here)


def test_goals_are_reached_in_order_within_the_tolerance():
    config = MissionConfig(goals=GOALS, tolerance=3.0)
    path, progress = walk(Mission(config), [0.0, 0.0, 2.0])
    assert progress.complete
    nearest = [int(np.linalg.norm(path - g, axis=1).argmin()) for g in GOALS]
    assert nearest == sorted(nearest)
    for goal in GOALS[:2]:
        assert np.linalg.norm(path - goal, axis=1).min() < 3.0
    assert np.linalg.norm(path[-1] - GOALS[-1]) <= config.final_tolerance


def test_the_way_keeps_clear_of_the_island_and_on_its_outer_side():
    config = MissionConfig(goals=GOALS, tolerance=3.0)
    path, _ = walk(Mission(config), [0.0, 0.0, 2.0])
    radius = config.island * config.tolerance
    corner = np.array(GOALS[0])
    near = path[np.linalg.norm(path - corner, axis=1) < 3.0]
    assert np.linalg.norm(near - corner, axis=1).min() > 0.9 * radius
    # The way turns right at (0, 20): the island stays on the right, so the path is north-west.
    outer = near[np.linalg.norm(near - corner, axis=1).argmin()]
    assert (outer - corner)[:2] @ np.array([-1.0, 1.0]) > 0


@pytest.mark.parametrize(
    ("following", "side"),
    [([10, 10], 1), ([10, -10], -1), ([20, 0], 1), ([20, -4], 1), ([0, 0.1], 1), ([0, -0.1], 1)],
)
def test_the_way_turns_left_where_it_is_nearly_straight_or_back(following, side):
    a, b = np.zeros(3), np.array([10.0, 0.0, 0.0])
    assert turn_side(a, b, np.array([*following, 0.0])) == side


def test_drones_that_come_and_drones_that_go_keep_apart():
    """At a sharp turn the two lanes are on opposite sides of the island."""
    r = Roundabout(np.zeros(3), 1.8, np.array([7.0, -21.0, 0.0]), -1.0)
    coming = r.aim(np.array([-7.0, -12.0, 0.0]))
    towards = math.atan2(-21.0, 7.0)
    leaving = 1.8 * np.array([math.cos(towards + 1.49), math.sin(towards + 1.49)])
    assert r.passed(np.array([*leaving, 0.0]))
    assert np.linalg.norm(coming[:2] - leaving) > 3.0
    assert not r.passed(coming)


def test_without_goals_the_drone_stays():
    mission = Mission(MissionConfig())  # land: true by default, and yet there is nothing to end
    for east in (1.0, 1.5, 2.0):  # the wind carries it
        progress = mission.update(at([east, 2.0, 3.0]))
        assert not progress.complete
        assert np.array_equal(progress.goal, [1.0, 2.0, 3.0])


def test_a_drone_sets_out_only_after_its_look_round():
    mission = Mission(MissionConfig(goals=[[5.0, 0.0, 2.0]]))
    assert np.allclose(mission.update(at([1.0, 1.0, 2.0]), surveyed=False).goal, [1.0, 1.0, 2.0])
    assert np.allclose(mission.update(at([1.2, 1.0, 2.0]), surveyed=False).goal, [1.0, 1.0, 2.0])
    assert np.allclose(mission.update(at([1.0, 1.0, 2.0], time=5.0)).goal, [5.0, 0.0, 2.0])


def test_the_last_goal_is_reached_slowly():
    mission = Mission(MissionConfig(goals=[[5.0, 0.0, 2.0]], final_speed=0.4))
    assert not mission.update(at([5.0, 0.0, 2.0], v=[1.0, 0.0, 0.0])).complete
    assert mission.update(at([5.0, 0.1, 2.0])).complete


def test_the_way_is_flown_on_the_drones_own_level_and_the_goal_reached_at_its_height():
    config = MissionConfig(goals=[[0.0, 10.0, 2.0]], level=0.6)
    path, progress = walk(Mission(config), [0.0, 0.0, 2.0], step=0.05)
    assert progress.complete
    middle = path[np.abs(path[:, 1] - 7.0).argmin()]
    assert middle[2] == pytest.approx(2.6, abs=0.25)
    assert path[-1][2] == pytest.approx(2.0, abs=config.final_tolerance)


@pytest.mark.parametrize("level", [0.0, 6.0])
def test_a_goal_on_the_way_is_passed_on_the_drones_level(level):
    """The level may be high above the goal; a goal above the goal before is not passed below."""
    goals = [[0.0, 10.0, 2.0], [10.0, 10.0, 2.0], [10.0, 10.0, 6.0], [0.0, 0.0, 2.0]]
    config = MissionConfig(goals=goals, level=level)
    path, progress = walk(Mission(config), [0.0, 0.0, 2.0])
    assert progress.complete
    assert path[:, 2].max() > 6.0 - config.tolerance


def test_the_least_room_round_the_island_is_enough():
    assert MissionConfig(goals=[[0, 0, 2], [9, 0, 2]], tolerance=1.0, island=0.9).island == 0.9


def test_a_goal_that_lies_too_low_is_reached_at_the_floor():
    mission = Mission(MissionConfig(goals=[[5.0, 0.0, 1.0]]))
    assert mission.update(at([0.0, 0.0, 2.0]), floor=1.8).goal.tolist() == [5.0, 0.0, 1.8]
    assert not mission.update(at([5.0, 0.0, 1.0]), floor=1.8).complete
    assert mission.update(at([5.0, 0.0, 1.8]), floor=1.8).complete


def test_the_way_from_goal_to_goal_is_straight():
    """Over a slope a drone that climbed at once flew 5 m above the ground, where it saw little."""
    goals = [[0.0, 0.0, 2.0], [40.0, 0.0, 10.0], [80.0, 0.0, 10.0]]
    mission = Mission(MissionConfig(goals=goals, tolerance=1.0, island=0.5))
    assert mission.update(at([-5.0, 0.0, 1.0])).climb == 0.0
    walk(mission, [-2.0, 0.0, 2.0], most=60)
    half_way = mission.update(at([20.0, 0.0, 6.0]))
    assert half_way.index == 1
    assert half_way.climb == pytest.approx(0.2 * 18.0)  # 2 m ahead
    assert mission.update(at([36.0, 0.0, 9.0])).climb == pytest.approx(0.4)
    walk(mission, [36.0, 0.0, 9.2], most=120)
    level = mission.update(at([50.0, 0.0, 10.0]))
    assert (level.index, level.climb) == (2, 0.0)


@pytest.mark.parametrize(
    ("away", "above"),
    [(9.0, 0.6), (1.6, 0.6), (1.5, 0.6), (1.25, 0.45), (1.0, 0.3), (0.6, 0.06), (0.5, 0.0)],
)
@pytest.mark.parametrize("bearing", [0.3, 2.0, -2.5])
def test_the_level_is_left_from_a_metre_and_a_half_of_the_goal_on(away, above, bearing):
    """The distance is that seen from above."""
    mission = Mission(MissionConfig(goals=[[10.0, -4.0, 2.0]], level=0.6))
    p = [10.0 - away * math.cos(bearing), -4.0 - away * math.sin(bearing), 7.0]
    assert mission.update(at(p)).goal == pytest.approx([10.0, -4.0, 2.0 + above])


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("following", "leave"),
    [
        ([20.0, 0.0], -1.5457963),  # the tangent from far away: arccos 0.025 off
        ([0.8, 0.0], -0.8956648),  # close by: arccos 0.625
        ([0.0, 0.8], 0.6751315),  # a quarter of a turn on
        ([0.4, 0.0], 0.0),  # on the island: straight to it
    ],
)
def test_the_way_leaves_the_island_on_the_tangent_to_the_next_goal(following, leave, side):
    """The island is 1 m wide; it is left 0.35 rad before, and up to a quarter of a turn behind."""
    x, y = following
    way = Roundabout(np.array([5.0, 5.0, 2.0]), 0.5, np.array([5.0 + x, 5.0 + side * y, 2.0]), side)

    def passed(angle):
        on_rim = 0.5 * np.array([math.cos(angle), side * math.sin(angle), 0.0])
        return way.passed(way.centre + on_rim)

    assert passed(leave)
    assert passed(leave - 0.34)
    assert not passed(leave - 0.36)
    assert passed(leave + 1.56)
    assert not passed(leave + 1.58)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("p", "angle", "out"),
    [
        ((math.pi, 5.0), math.pi + 1.3694384, 1.0),  # along the tangent: arccos 0.2 on
        ((math.pi, 1.0), math.pi + 0.8, 1.4353242),  # on the rim: 0.8 rad on, 1 / cos 0.8 out
        ((math.pi, 0.3), math.pi + 0.8, 1.4353242),
        ((math.pi, 1.3), math.pi + 0.8, 1.4353242),
        # Where less is left to go round, so far; and 0.35 rad at least.
        ((0.0500209 - 0.5, 1.0), 0.0500209, 1.1394939),
        ((0.0500209 - 0.1, 1.0), 0.3000209, 1.0645402),
    ],
)
def test_the_aim_leads_on_round_the_island(p, angle, out, side):
    """Of 1 m around the place (2, -3); the next goal is 20 m north of it, or south."""
    centre = np.array([2.0, -3.0, 2.5])
    way = Roundabout(centre, 1.0, centre + np.array([0.0, side * 20.0, 4.0]), side)

    def place(at_angle, far):
        return centre + far * np.array([math.cos(at_angle), side * math.sin(at_angle), 0.0])

    assert way.aim(place(*p) + np.array([0.0, 0.0, 1.0])) == pytest.approx(
        place(angle, out), abs=1e-6
    )


def test_an_aim_in_a_trunk_moves_on_along_the_rim_to_the_first_free_place():
    way = Roundabout(np.zeros(3), 1.0, np.array([0.0, 20.0, 0.0]), 1.0)
    here, angle = np.array([-1.0, 0.0, 0.0]), math.pi + 0.8
    trunk = np.array([[1.4 * math.cos(angle), 1.4 * math.sin(angle), 0.45]])
    on = way.aim(here, trunk)
    turned = (math.atan2(on[1], on[0]) - math.pi) % (2.0 * math.pi)
    assert np.hypot(on[0], on[1]) == pytest.approx(1.0)
    assert turned == pytest.approx(1.0)  # 0.1 rad on it is still in the trunk
    assert way.aim(here, np.array([[0.0, 0.0, 2.0]])) is None


@pytest.mark.parametrize(
    ("angle", "side"),
    [(-0.59, 1), (-0.6, 1), (-0.61, -1), (-1.5, -1), (-2.79, -1), (-2.8, 1), (-2.81, 1),
     (0.0, 1), (0.61, 1), (1.5, 1), (2.79, 1), (2.81, 1), (math.pi, 1)],
)  # fmt: skip
def test_a_way_turns_right_between_its_two_limits_alone(angle, side):
    following = np.array([math.cos(angle), math.sin(angle), -3.0])
    assert turn_side(np.array([-1.0, 0.0, 2.0]), np.zeros(3), following) == side
    if angle in (-0.6, -2.8):  # the limits themselves, to the last bit
        assert math.atan2(following[1], following[0]) == angle


def test_an_opening_is_passed_along_the_way_from_the_goal_before():
    goals = [Goal(np.array([0.0, 0.0, 2.0])), Goal(np.array([3.0, 4.0, 2.0]), opening=True)]
    mission = Mission(MissionConfig(), [*goals, Goal(np.array([3.0, 4.0, 9.0]), opening=True)])
    here = at([-1.0, 0.0, 2.0])
    assert mission.opening(here.p) is None
    walk(mission, here.p, most=30)
    place, way = mission.opening(here.p)
    assert place.tolist() == [3.0, 4.0, 2.0]
    assert way == pytest.approx([0.6, 0.8])
    assert mission.update(at([2.9, 3.9, 2.0])).index == 1
    assert mission.update(at([3.1, 4.1, 2.0])).index == 2
    assert mission.opening(here.p) is None  # straight above the one before: no way leads there


def test_the_way_to_an_opening_that_comes_first_begins_where_the_mission_began():
    mission = Mission(MissionConfig(), [Goal(np.array([3.0, 4.0, 2.0]), opening=True)])
    assert mission.opening(np.array([3.0, 1.0, 2.0]))[1] == pytest.approx([0.0, 1.0])
    mission.update(at([0.0, 0.0, 2.0]))
    assert mission.opening(np.array([3.0, 1.0, 2.0]))[1] == pytest.approx([0.6, 0.8])


def test_the_way_climbs_from_the_floor_where_the_goal_before_was_below():
    mission = Mission(MissionConfig(goals=[[0.0, 0.0, 2.0], [0.0, 40.0, 10.0]]))
    mission.update(at([0.0, 0.0, 2.0]))
    assert mission.update(at([0.0, 18.0, 6.0])).climb == pytest.approx(0.5 * 8.0)
    assert mission.update(at([0.0, 18.0, 6.0]), floor=4.0).climb == pytest.approx(0.5 * 6.0)
    assert mission.update(at([24.0, 22.0, 6.0])).climb == pytest.approx((30.0 - 2.0) / 40.0 * 8.0)
    assert mission.update(at([0.0, -9.0, 2.0])).climb == pytest.approx(8.0)  # no more than all
    assert mission.update(at([0.0, 39.0, 2.0])).climb == 0.0


def test_a_goal_at_which_the_way_turns_back_is_passed_there_and_not_on_the_way_to_it():
    """All the way there, the drone is where the way back leaves the island."""
    mission = Mission(MissionConfig(goals=[[0.0, 0.0, 2.0], [20.0, 0.0, 2.0], [0.0, 0.0, 2.0]]))
    assert mission.update(at([0.0, 0.0, 2.0])).index == 1
    for east in (5.0, 18.9):
        assert mission.update(at([east, 0.0, 2.0])).index == 1
    assert mission.update(at([19.1, 0.0, 2.0])).index == 2
