"""Openings are found where they are seen, not where a coordinate says."""

import numpy as np
import pytest

from companion.guidance.goals import Goal
from companion.guidance.mission import Mission, MissionConfig
from companion.guidance.opening import OpeningFinder, middle
from mavlink_bridge.wire.messages import VehicleState

NORTH = np.array([0.0, 1.0])


def wall(centre=(0.0, 2.0), size=(2.0, 2.0), y=0.0, depth=0.0, step=0.2, seed=1):
    """Points of a wall 8 m × 4 m at y, with an opening, and of its sides as deep as `depth`."""
    rng = np.random.default_rng(seed)
    x, z = np.meshgrid(np.arange(-4.0, 4.01, step), np.arange(0.0, 4.01, step))
    x, z = x.ravel(), z.ravel()
    half = np.array(size) / 2
    inside = (np.abs(x - centre[0]) < half[0]) & (np.abs(z - centre[1]) < half[1])
    face = np.column_stack([x, np.full_like(x, y), z])[~inside]
    sides = [
        (centre[0] + s * half[0], d, centre[1] + u)
        for s in (-1, 1)
        for d in np.arange(y, y + depth, step)
        for u in np.arange(-half[1], half[1] + 0.01, step)
    ]
    points = np.concatenate([face, np.array(sides).reshape(-1, 3)])
    return points + rng.normal(0.0, 0.03, points.shape)


@pytest.mark.parametrize("off", [(0.0, 0.0), (1.0, 0.4), (-1.2, -0.5), (0.6, -0.6)])
def test_the_middle_of_an_opening_is_found_though_the_goal_is_beside_it(off):
    goal = np.array([off[0], 1.0, 2.0 + off[1]])
    seen = middle(goal - [0.0, 4.0, 0.0], goal, NORTH, wall(depth=1.5))
    assert goal + seen == pytest.approx([0.0, 1.0, 2.0], abs=0.15)


def test_the_way_may_lead_anywhere():
    turn = np.array([[0.6, 0.8], [-0.8, 0.6]])
    points = wall(depth=1.0)
    points[:, :2] = points[:, :2] @ turn.T
    goal = np.array([*(turn @ [0.8, 1.0]), 2.0])
    seen = middle(goal - [*(4.0 * turn @ NORTH), 0.0], goal, turn @ NORTH, points)
    assert (goal + seen)[:2] == pytest.approx(turn @ [0.0, 1.0], abs=0.15)


def test_where_nothing_has_been_seen_there_is_no_opening():
    goal = np.array([0.5, 1.0, 2.0])
    assert middle(goal - [0, 4, 0], goal, NORTH, np.zeros((0, 3))) is None
    closed = wall(size=(0.1, 0.1))
    assert middle(goal - [0, 4, 0], goal, NORTH, closed) is None
    for side in (-1.0, 1.0):  # the other one is out of view
        half = wall()[side * wall()[:, 0] > 0.0]
        assert middle(goal - [0, 4, 0], goal, NORTH, half) is None


def test_a_gap_too_narrow_is_none():
    goal = np.array([0.3, 1.0, 2.0])
    assert middle(goal - [0, 4, 0], goal, NORTH, wall(size=(0.8, 0.8))) is None


def test_looks_are_averaged():
    finder, goal = OpeningFinder(), np.array([0.8, 1.0, 2.0])
    found = [finder.update(goal - [0, 4, 0], goal, NORTH, wall(seed=k)) for k in range(20)]
    assert np.std([f[0] for f in found[5:]]) < 0.05
    assert goal + found[-1] == pytest.approx([0.0, 1.0, 2.0], abs=0.12)


def test_a_mission_flies_through_an_opening_and_past_its_goal():
    mission = Mission(
        MissionConfig(tolerance=1.5),
        [Goal(np.array([1.0, 1.0, 2.0]), opening=True), Goal(np.array([0.0, 9.0, 2.0]))],
    )

    def at(p):
        return VehicleState(0.0, np.array(p), np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3))

    start = at([1.0, -6.0, 2.0])
    goal, way = mission.opening(start.p)
    assert (goal.tolist(), way.tolist()) == ([1.0, 1.0, 2.0], [0.0, 1.0])
    mission.shift = np.array([-1.0, 0.0, 0.0])
    assert mission.update(start).goal.tolist() == [0.0, 1.0, 2.0]  # no roundabout in a wall
    assert mission.update(at([0.0, 0.5, 2.0])).index == 0  # near, but not through
    assert mission.update(at([0.0, 1.1, 2.0])).index == 1
    assert mission.shift.tolist() == [0.0, 0.0, 0.0]


GOAL = np.array([0.8, 1.0, 2.0])
FROM = GOAL - [0.0, 4.0, 0.0]


def test_the_first_look_counts_whole_and_each_later_one_a_quarter():
    finder, beside = OpeningFinder(), wall(centre=(0.4, 2.0), seed=2)
    assert finder.update(FROM, GOAL, NORTH, np.zeros((0, 3))).tolist() == [0.0, 0.0, 0.0]
    first = finder.update(FROM, GOAL, NORTH, wall())
    assert first.tolist() == middle(FROM, GOAL, NORTH, wall()).tolist()
    other = middle(FROM, GOAL, NORTH, beside)
    assert finder.update(FROM, GOAL, NORTH, beside) == pytest.approx(0.75 * first + 0.25 * other)
    kept = finder.shift.tolist()
    assert finder.update(FROM, GOAL, NORTH, np.zeros((0, 3))).tolist() == kept


@pytest.mark.parametrize(
    ("y", "seen"),
    [(-3.2, False), (-2.8, True), (0.0, True), (1.8, True), (2.2, False)],
)
def test_a_wall_is_one_between_the_drone_and_a_metre_behind_the_goal(y, seen):
    assert (middle(FROM, GOAL, NORTH, wall(y=y)) is not None) == seen


def test_thirty_points_make_a_wall():
    """Two jambs, 1 m to each side of the goal, at its height."""
    z = np.linspace(1.0, 3.0, 15)
    left, right = (np.column_stack([np.full(15, x), np.zeros(15), z]) for x in (-0.15, 1.85))
    both = np.concatenate([left, right])
    assert middle(FROM, GOAL, NORTH, both) == pytest.approx([0.05, 0.0, 0.0], abs=0.06)
    assert middle(FROM, GOAL, NORTH, both[1:]) is None


@pytest.mark.parametrize("out", [[1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1]])
def test_points_far_aside_above_or_below_are_of_no_wall(out):
    """Two jambs of too few points, and more beyond 3 m aside or 1.6 m up, or within."""
    z = np.linspace(1.0, 3.0, 14)
    jambs = [np.column_stack([np.full(14, x), np.zeros(14), z]) for x in (-0.15, 1.85)]
    for far, seen in [(1.03, False), (0.97, True)]:
        place = GOAL + far * np.array(out) * [3.0, 0.0, 1.6] - [0.0, 1.0, 0.0]
        points = np.concatenate([*jambs, np.repeat(place[None], 9, axis=0)])
        assert (middle(FROM, GOAL, NORTH, points) is not None) == seen


def test_of_two_openings_the_nearer_is_taken():
    x, z = np.meshgrid(np.arange(-2.0, 4.01, 0.2), np.arange(0.0, 4.01, 0.2))
    x, z = x.ravel(), z.ravel()
    low = np.abs(z - 2.0) < 0.9
    free = low & ((np.abs(x + 0.4) < 0.9) | (np.abs(x - 2.4) < 0.9))
    points = np.column_stack([x, np.zeros_like(x), z])[~free]
    for beside, there in [(0.6, -0.4), (1.4, 2.4)]:
        goal = np.array([beside, 1.0, 2.0])
        seen = middle(goal - [0, 4, 0], goal, NORTH, points)
        assert goal[0] + seen[0] == pytest.approx(there, abs=0.15)


@pytest.mark.parametrize("away", [(3.0, 0.0), (-3.0, 0.0), (0.0, 1.6), (0.0, -1.6)])
def test_a_point_at_the_very_edge_of_the_picture_changes_nothing(away):
    goal, points = np.zeros(3), wall(centre=(0.4, 0.3)) - [0.0, 1.0, 0.0]
    x, z = (np.nextafter(a, 0.0) for a in away)
    seen = middle(goal - [0, 4, 0], goal, NORTH, points)
    more = np.concatenate([points, [[x, -1.0, z]]])
    assert middle(goal - [0, 4, 0], goal, NORTH, more) == pytest.approx(seen, abs=0.02)
