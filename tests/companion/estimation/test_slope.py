"""The slope of the ground: under a rangefinder, in pictures, and where there is none."""

from itertools import pairwise

import numpy as np
import pytest

from companion.estimation.slope import Slope
from companion.perception.ground_plane import GroundPlane
from mavlink_bridge.shared.arrays import norm

STEEP = np.array([0.17, -0.05])  # m/m: 10°


def pass_over(slope, rise, corners, seed=1):
    """Fly from corner to corner (n,2) m, with a rangefinder of 3 cm, at 1.5 m/s."""
    rng, time = np.random.default_rng(seed), 0.0
    for a, b in pairwise(corners):
        length = np.linalg.norm(np.subtract(b, a))
        for part in np.linspace(0.0, 1.0, round(length / 0.15), endpoint=False):
            place = np.add(a, part * np.subtract(b, a))
            level = place @ rise + rng.normal(0.0, 0.03)
            slope.move(0.15)
            slope.pass_over((*place.tolist(), level), time, 0.03, 0.01)
            time += 0.1
    return np.array(slope.rise)


def see(slope, rise, tilt=0.0, pictures=30, seed=2):
    """See 20 points of the ground in each of some pictures, by an attitude that is `tilt` off."""
    rng = np.random.default_rng(seed)
    for _ in range(pictures):
        points = rng.uniform([0.5, -3.0, 0.0], [5.0, 3.0, 0.0], (20, 3))
        points[:, 2] = points[:, :2] @ (rise + np.array([tilt, 0.0])) + rng.normal(0.0, 0.15, 20)
        slope.move(0.15)
        slope.see(points, np.full(20, 0.15), 14.0, 0.006)
    return np.array(slope.rise)


@pytest.mark.parametrize("length", [3.0, 5.0, 8.0])
def test_a_rangefinder_tells_the_slope_once_the_way_has_turned(length):
    ways = [[0.0, 0.0], [length, 0.0], [length, length]]
    errors = [norm(pass_over(Slope(), STEEP, ways, seed) - STEEP) for seed in range(50)]
    assert np.median(errors) < 0.06
    assert np.quantile(errors, 0.9) < 0.1


def test_bumps_are_no_slope():
    """Ground that wanders by 5 cm in a metre."""
    rng = np.random.default_rng(4)
    for _ in range(50):
        slope, level = Slope(), 0.0
        for k in range(80):
            level += rng.normal(0.0, 0.05 * np.sqrt(0.15))
            slope.move(0.15)
            slope.pass_over((0.15 * k, 0.0, level), 0.1 * k, 0.03, 0.01)
        assert np.hypot(*slope.rise) < 0.1


@pytest.mark.parametrize("seed", range(5))
def test_pictures_tell_the_slope(seed):
    assert see(Slope(), STEEP, seed=seed) == pytest.approx(STEEP, abs=0.03)


@pytest.mark.parametrize("seed", range(5))
def test_level_ground_stays_level_under_a_tilted_attitude(seed):
    slope, flat = Slope(), np.zeros(2)
    assert np.abs(pass_over(slope, flat, [[0, 0], [4, 0], [4, 4]], seed)).max() < 0.003
    assert np.abs(see(slope, flat, tilt=0.015, seed=seed)).max() < 0.004


def test_a_slope_that_is_left_behind_is_forgotten():
    slope = Slope()
    see(slope, STEEP)
    pass_over(slope, np.zeros(2), [[0, 0], [9, 0], [9, 9], [0, 9], [0, 0]])
    assert np.abs(slope.rise).max() < 0.02


def test_a_plane():
    plane = GroundPlane(1.0, (2.0, 3.0), (0.1, -0.2))
    p = np.array([4.0, 2.0, 3.0])
    assert plane.below(p[None]) == pytest.approx([1.4])
    assert plane.under(p) == pytest.approx(1.6)
    ray = np.array([0.6, 0.0, -0.8])
    assert plane.under(p + 0.5 * ray) == pytest.approx(1.6 - 0.5 * plane.drop(ray))
    space = plane.half_space(0.8)  # of places 0.8 m over it, upright
    assert space[:3] @ (p - [0.0, 0.0, 0.8]) == pytest.approx(space[3])
    assert np.linalg.norm(space[:3]) == pytest.approx(1.0)
