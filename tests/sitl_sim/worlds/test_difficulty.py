"""How hard a world is: by worlds whose ways, rooms and turns are known."""

import math
from itertools import pairwise

import numpy as np
import pytest

from sitl_sim.worlds.difficulty import NoWay, difficulty, guide_path
from sitl_sim.worlds.world import surface_distance

START, GOAL = np.array([0.0, 0.0, 2.0]), np.array([[20.0, 0.0, 2.0]])
RADIUS = 0.2


def trunk(x, y, radius=1.0):
    return {"x": x, "y": y, "radius": radius, "height": 8.0}


def lane(width):
    """Two walls along the way, `width` apart."""
    half = width / 2
    sides = [(half, half + 1.0), (-half - 1.0, -half)]
    return {"boxes": [{"min": [-8.0, low, 0.0], "max": [28.0, high, 4.0]} for low, high in sides]}


def of(world, goals=GOAL):
    return difficulty(world, START[None], [goals], RADIUS)


def test_where_nothing_stands_there_is_room_and_no_turn():
    found = of({})
    assert found.obstruction == 0.5
    assert found.angle_over_length == 0.0
    assert found.length == pytest.approx(20.0)
    assert found.trunks_per_hectare == 0.0


@pytest.mark.parametrize("width", [1.4, 2.0, 4.0])
def test_in_a_lane_every_sphere_fills_it(width):
    found = of(lane(width))
    assert found.obstruction == pytest.approx(4.0 / 2 / (width / 2 - RADIUS), rel=0.03)
    assert found.length == pytest.approx(20.0)


def test_the_way_round_a_trunk_is_tight_and_its_turns_count():
    world = {"cylinders": [trunk(10.0, 0.05)]}
    (leg,) = guide_path(world, START, GOAL, RADIUS)
    share = np.linspace(0, 1, 200)[:, None]
    way = np.vstack([a + share * (b - a) for a, b in pairwise(leg)])
    assert surface_distance(way, world).min() > RADIUS - 0.01
    shortest = 2 * math.sqrt(100 - 1.2**2) + 1.2 * 2 * math.asin(1.2 / 10)  # tangents and an arc
    found = of(world)
    assert shortest < found.length < shortest + 0.25
    turned = 2 * math.asin(1.2 / 10)  # by all turns together, each of them small
    assert found.angle_over_length * found.length == pytest.approx(2 * turned / math.pi, rel=0.2)
    assert found.obstruction > 0.6


def test_a_turn_at_a_goal_costs_more():
    corner = np.array([[10.0, 0.0, 2.0], [10.0, 10.0, 2.0]])
    found = of({}, corner)
    assert found.angle_over_length == pytest.approx(math.expm1(3.0) / 20.0)


def test_trunks_are_counted_on_the_ground_that_is_flown_over():
    world = {"cylinders": [trunk(5.0, 1.9, 0.1), trunk(5.0, -1.9, 0.1), trunk(5.0, 9.0, 0.1)]}
    assert of(world).trunks_per_hectare == pytest.approx(2 / (24 * 4) * 1e4, rel=0.05)


def test_a_goal_at_the_start_is_no_way_and_no_turn():
    found = of({}, START[None])
    assert (found.obstruction, found.angle_over_length, found.length) == (0.5, 0.0, 0.0)


def test_a_goal_behind_a_wall_without_end_is_told():
    wall = {"boxes": [{"min": [9.0, -30.0, 0.0], "max": [10.0, 30.0, 4.0]}]}
    with pytest.raises(NoWay, match=r"leg 1: no way to \[20"):
        of(wall)
