"""The ground's height, slope and range against geometry, and generated hills."""

import math

import numpy as np
import pytest

from sitl_sim.worlds.ground import Ground, stepped, uneven

RAMP = {"x": [-10.0, 10.0], "y": [-5.0, 5.0], "z": [[-1.0, 1.0], [1.0, 3.0]]}


def test_flat_ground_is_at_zero_and_level():
    ground = Ground({})
    assert ground.flat
    np.testing.assert_array_equal(ground.height([1.0, 2.0], 3.0), [0.0, 0.0])
    np.testing.assert_array_equal(ground.normal(1.0, 2.0), [0.0, 0.0, 1.0])
    p, down = np.array([[0.0, 0.0, 2.0]]), np.array([[math.sin(0.3), 0.0, -math.cos(0.3)]])
    assert ground.ranges(p, down)[0] == pytest.approx(2.0 / math.cos(0.3))
    assert ground.ranges(p, -down)[0] == math.inf


def test_a_ramp_has_the_height_and_normal_of_its_plane():
    ground = Ground({"terrain": RAMP})
    x, y = np.array([0.0, -4.0, 9.0]), np.array([0.0, 3.0, -4.0])
    np.testing.assert_allclose(ground.height(x, y), 1.0 + 0.1 * x + 0.2 * y)
    normal = np.array([-0.1, -0.2, 1.0])
    np.testing.assert_allclose(ground.normal(2.0, 1.0), normal / np.linalg.norm(normal))
    assert ground.height(100.0, 0.0) == pytest.approx(2.0)  # beyond the grid: the edge


def test_a_range_over_a_ramp_is_the_distance_along_the_beam():
    ground = Ground({"terrain": RAMP})
    p, down = np.array([[1.0, 1.0, 4.0]]), np.array([[0.0, math.sin(0.2), -math.cos(0.2)]])
    away = ground.ranges(p, down)
    hit = p + away[:, None] * down
    np.testing.assert_allclose(hit[:, 2], ground.height(hit[:, 0], hit[:, 1]), atol=1e-9)


def test_hills_are_as_steep_as_asked_and_the_same_for_one_seed():
    terrain = uneven(10.0, np.random.default_rng(3))
    z = np.array(terrain["z"])
    north, east = np.gradient(z, 2.0)
    assert math.degrees(math.atan(np.hypot(east, north).max())) == pytest.approx(10.0, abs=0.05)
    assert Ground({"terrain": terrain}).height(0.0, 0.0) == pytest.approx(0.0, abs=1e-3)
    assert terrain == uneven(10.0, np.random.default_rng(3))
    assert terrain != uneven(10.0, np.random.default_rng(4))


def test_terraces_are_level_and_a_step_apart_from_one_to_the_next():
    terrain = stepped(0.4, np.random.default_rng(3))
    ground = Ground({"terrain": terrain})
    north = np.arange(-59.75, 60.0, 0.5)
    heights = ground.height(7.0, np.array(terrain["y"]))
    rises = np.diff(heights)
    steps = rises[rises != 0.0]
    assert 8 <= len(steps) <= 20
    np.testing.assert_allclose(np.abs(steps), 0.4)
    assert (steps > 0).any()
    assert (steps < 0).any()
    assert np.abs(heights).max() <= 2.4
    wide = np.diff(np.flatnonzero(rises)) * 0.5
    assert wide.min() >= 5.5
    assert wide.max() <= 14.5
    assert ground.height(0.0, 0.0) == 0.0
    np.testing.assert_array_equal(ground.height(-30.0, north), ground.height(44.0, north))
    assert terrain != stepped(0.4, np.random.default_rng(4))
