"""The detour round trunks that stand too close to each other to pass between."""

from __future__ import annotations

import numpy as np
import pytest

from companion.guidance.detour import Detour

ROOM = 0.35
OPEN = np.zeros((0, 4))
# 0.57 m are free between the second and the third trunk, of 0.7 m needed.
POCKET = np.array([[0.9, -1.7, 0.3], [2.0, -2.1, 0.3], [2.2, -0.9, 0.2], [-0.3, 0.0, 0.2]])
HERE, THERE = np.array([1.57, -1.41, 1.3]), np.array([1.17, -3.81, 1.3])


def nearest_first(p, cylinders):
    """The cylinders in the order in which the obstacle map gives them."""
    gaps = np.linalg.norm(cylinders[:, :2] - p[:2], axis=1) - cylinders[:, 2]
    return cylinders[np.argsort(gaps, kind="stable")]


def walk(p, goal, cylinders, fence=OPEN, step=0.05, most=1200, sight=np.inf):
    """The places of a point that goes straight to each aim, step by step."""
    places, detour = [p], Detour(fence)
    while np.linalg.norm(places[-1] - goal) > step and len(places) < most:
        here = places[-1]
        aim = detour.aim(
            here, goal, nearest_first(here, cylinders[gaps(here[None], cylinders) < sight]), ROOM
        )
        way = aim - places[-1]
        places.append(places[-1] + step * way / np.linalg.norm(way))
    return np.array(places)


def gaps(places, cylinders):
    """The least distance [m] of all places to each surface, (K,)."""
    offsets = places[:, None, :2] - cylinders[None, :, :2]
    return (np.linalg.norm(offsets, axis=2) - cylinders[:, 2]).min(axis=0)


def test_the_way_leads_out_of_a_pocket_and_round():
    places = walk(HERE, THERE, POCKET)
    assert np.linalg.norm(places[-1] - THERE) <= 0.05
    assert gaps(places, POCKET).min() > ROOM - 0.02


@pytest.mark.parametrize("seed", range(20))
def test_the_way_leads_through_a_random_thicket_and_keeps_the_room(seed):
    rng = np.random.default_rng(seed)
    trunks = np.column_stack([rng.uniform(-3, 3, (10, 2)), rng.uniform(0.1, 0.4, 10)])
    start, goal = np.array([-5.0, rng.uniform(-1, 1), 1.0]), np.array([5.0, 0.0, 1.0])
    places = walk(start, goal, trunks)
    assert np.linalg.norm(places[-1] - goal) <= 0.05
    reach = trunks[:, 2] + ROOM
    apart = np.linalg.norm(trunks[:, None, :2] - trunks[None, :, :2], axis=2)
    crowded = (apart < reach[:, None] + reach[None]).sum(axis=1) > 1
    # Trunks that stand alone are left to the NMPC where the way leads round no thicket.
    assert gaps(places, trunks)[crowded].min(initial=np.inf) > ROOM - 0.05


def test_trunks_with_room_between_change_nothing():
    row = np.array([[2.0, y, 0.3] for y in (-1.5, -0.2, 1.1)])  # 0.7 m between surfaces
    goal = np.array([5.0, 0.4, 1.0])
    assert Detour(OPEN).aim(np.zeros(3), goal, row, ROOM - 1e-9) is goal


def test_a_thicket_beside_the_way_changes_nothing():
    goal = np.array([HERE[0] + 3.0, HERE[1], HERE[2]])
    assert Detour(OPEN).aim(HERE, goal, nearest_first(HERE, POCKET[:2]), ROOM) is goal


def test_the_aim_is_as_far_as_the_way_is_long():
    """The drone is not to slow down at each corner."""
    aim = Detour(OPEN).aim(HERE, THERE, nearest_first(HERE, POCKET), ROOM)
    assert np.linalg.norm(aim - HERE) > np.linalg.norm(THERE - HERE)
    assert aim[2] == THERE[2]


def test_a_goal_that_is_walled_in_stays_the_aim():
    angles = np.arange(8) * np.pi / 4
    ring = np.array([[3.0 + np.cos(a), np.sin(a), 0.2] for a in angles])  # 0.37 m between surfaces
    goal = np.array([3.0, 0.0, 1.0])
    start = np.array([0.0, 0.0, 1.0])
    assert Detour(OPEN).aim(start, goal, nearest_first(start, ring), ROOM) is goal


def test_the_way_round_stays_within_the_fence():
    pair = np.array([[2.0, -0.3, 0.2], [2.0, 0.6, 0.2]])
    start, goal = np.zeros(3), np.array([4.0, 0.0, 0.0])
    right = Detour(OPEN).aim(start, goal, pair, ROOM)
    south = np.array([[0.0, -1.0, 0.0, 0.9]])  # y > -0.9: no room on the right
    left = Detour(south).aim(start, goal, pair, ROOM)
    assert right[1] < 0.0 < left[1]
    places = walk(start, goal, pair, south)
    assert np.linalg.norm(places[-1] - goal) <= 0.05
    assert places[:, 1].min() > -0.9 + ROOM - 0.05


def test_a_drone_that_is_too_near_already_is_led_away():
    start = np.array([1.4, -1.75, 1.3])  # between the two
    places = walk(start, THERE, POCKET)
    assert np.linalg.norm(places[-1] - THERE) <= 0.05
    assert gaps(places, POCKET).min() > gaps(start[None], POCKET).min() - 0.06


@pytest.mark.parametrize("count", [13, 24])
@pytest.mark.parametrize("sight", [5.0, np.inf])
def test_the_way_leads_round_a_hedge_longer_than_its_known_part(count, sight):
    """The nearer end of the known part would always be the one behind."""
    hedge = np.array([[5.0, 1.4 * (k - (count - 1) / 2) + 0.1, 0.5] for k in range(count)])
    goal = np.array([10.0, 0.0, 1.0])
    places = walk(np.array([0.0, 0.0, 1.0]), goal, hedge, sight=sight)
    assert np.linalg.norm(places[-1] - goal) <= 0.05
    assert gaps(places, hedge).min() > ROOM - 0.05


def test_a_side_that_turns_out_to_be_closed_is_given_up():
    hook = [[5.0, y, 0.3] for y in np.arange(-2.0, 2.9, 0.8)] + [
        [x, 2.8, 0.3] for x in np.arange(1.0, 5.0, 0.8)
    ]
    goal = np.array([10.0, 1.5, 1.0])
    places = walk(np.array([0.0, 1.5, 1.0]), goal, np.array(hook), sight=2.5)
    assert np.linalg.norm(places[-1] - goal) <= 0.05
    assert gaps(places, np.array(hook)).min() > ROOM - 0.05


def test_the_way_to_a_new_goal_takes_the_nearer_side():
    pair = np.array([[2.0, -0.3, 0.2], [2.0, 0.5, 0.2]])
    detour, here = Detour(OPEN), np.zeros(3)
    assert detour.aim(here, np.array([4.0, -0.2, 0.0]), pair, ROOM)[1] < 0.0
    assert detour.aim(here, np.array([4.0, 0.6, 0.0]), pair, ROOM)[1] > 0.0


PAIR = np.array([[2.0, -0.4, 0.2], [2.0, 0.5, 0.2]])


def test_the_aim_is_at_the_first_corner_of_the_way_stretched_to_its_length():
    """The way touches three corners of an octagon around the right trunk.

    It is 0.607 m out: 0.55 m · 1.02 / cos 22.5°.
    """
    goal = np.array([4.0, 0.0, 1.5])
    aim = Detour(OPEN).aim(np.zeros(3), goal, PAIR, ROOM)
    legs = [1.77622, 0.46476, 0.46476, 1.77622]
    assert aim == pytest.approx(sum(legs) / legs[0] * np.array([1.57061, -0.82939, 0.0])
                                + [0.0, 0.0, 1.5], abs=1e-3)  # fmt: skip


@pytest.mark.parametrize(("moved", "left"), [(0.45, False), (0.55, True)])
def test_a_goal_that_moves_a_little_keeps_the_side(moved, left):
    detour = Detour(OPEN)
    assert detour.aim(np.zeros(3), np.array([4.0, 0.0, 1.0]), PAIR, ROOM)[1] < 0.0
    now = np.array([0.0, 0.3, 0.0])
    aim = detour.aim(now, np.array([4.0, moved, 1.0]), PAIR, ROOM)
    assert (aim[1] > now[1]) == left


def test_a_way_that_begins_backwards_stays_on_its_side():
    """Places of a drone that flew to and fro between two ends for 25 s (lsc-forest 107203)."""
    x = [2.68, 1.48, 3.48, 1.48, 0.48, 4.43, 2.18, 4.13]
    y = [4.89, 5.2, 3.89, 3.19, 4.2, 4.85, 2.2, 2.86]
    trunks = np.column_stack([x, y, [0.3, 0.2, 0.3, 0.2, 0.2, 0.25, 0.2, 0.15]])
    detour, goal = Detour(OPEN), np.array([4.78, 6.47, 1.0])
    ways = []
    for place in ((2.41, 4.2), (2.26, 4.38), (2.2, 4.45), (2.15, 4.52)):
        here = np.array([*place, 1.0])
        ways.append(detour.aim(here, goal, nearest_first(here, trunks), ROOM) - here)
    assert ways[2] @ (goal - here) < 0.0  # backwards
    assert np.linalg.norm(ways, axis=1) == pytest.approx([4.22, 4.01, 3.99, 3.78], abs=0.01)


def test_once_the_way_was_free_the_side_is_chosen_anew():
    goal = np.array([4.0, 0.3, 1.0])
    here, left = np.array([0.0, -0.4, 0.0]), np.array([0.0, 0.5, 0.0])
    for free in (PAIR[:1], PAIR + np.array([0.0, 9.0, 0.0])):  # one alone; both beside the way
        detour = Detour(OPEN)
        assert detour.aim(here, goal, PAIR, ROOM)[1] < here[1]
        assert detour.aim(left, goal, PAIR, ROOM)[1] < left[1]  # kept
        assert detour.aim(left, goal, free, ROOM) is goal
        assert detour.aim(left, goal, PAIR, ROOM)[1] > left[1]


def test_a_gap_of_just_twice_the_room_is_none_that_is_closed():
    goal = np.array([4.0, 0.0, 1.0])
    apart = np.array([[2.0, -0.56, 0.2], [2.0, 0.55, 0.2]])  # 0.71 m free, 0.7 m needed
    assert Detour(OPEN).aim(np.zeros(3), goal, apart, ROOM) is goal
    assert Detour(OPEN).aim(np.zeros(3), goal, apart * [1.0, 0.98, 1.0], ROOM) is not goal


def test_only_the_nearest_forty_trunks_are_looked_at():
    far = np.column_stack([np.full(40, 50.0), 3.0 * np.arange(40.0), np.full(40, 0.2)])
    goal = np.array([4.0, 0.0, 1.0])
    assert Detour(OPEN).aim(np.zeros(3), goal, np.vstack([far[:38], PAIR]), ROOM) is not goal
    assert Detour(OPEN).aim(np.zeros(3), goal, np.vstack([far[:39], PAIR]), ROOM) is goal


@pytest.mark.parametrize("turn", [0.0, 0.5, 1.4, 2.5, -1.0])
def test_a_side_is_kept_whichever_way_the_drone_flies(turn):
    """Though the drone has drifted to beyond the last trunk of the other side."""
    c, s = np.cos(turn), np.sin(turn)
    to_world = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    trunks = np.column_stack([PAIR[:, :2] @ to_world[:2, :2], PAIR[:, 2]])
    goal, right, left = (
        np.array(p) @ to_world for p in ([4.0, -0.4, 1.0], [0.0, -0.4, 1.0], [0.0, 1.2, 1.0])
    )

    def aside(detour, p):
        aim = detour.aim(p, goal, trunks, ROOM)
        return ((aim - p) @ to_world.T)[1]

    kept = Detour(OPEN)
    assert aside(kept, right) < -0.5
    assert aside(kept, left) < -1.5
    assert aside(Detour(OPEN), left) > -0.5  # past the left trunk
