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


def averaged(information, weighted):
    """The slope (2,) m/m by evidence of two axes that are independent: level or sloping ground.

    The slope is drawn from 0.003 m/m, or one time in ten as often from 0.15 m/m.
    """
    information, weighted = np.array(information), np.array(weighted)
    means, likely = [], []
    for prior in (0.003, 0.15):
        total = information + prior**-2.0
        means.append(weighted / total)
        odds = 0.5 * (weighted**2 / total - np.log(total * prior**2))
        likely.append(np.exp(odds.sum()))
    share = 0.1 * likely[1] / (likely[0] + 0.1 * likely[1])
    return share * means[1] + (1.0 - share) * means[0]


def range_over(*places, slope=None, sigma=0.03, drift=0.05, each=1.0):
    """Return the slope after a rangefinder saw places (n,3) m of the ground, `each` [s] apart."""
    slope = slope or Slope()
    for n, place in enumerate(places):
        slope.pass_over(place, each * n, sigma, drift)
    return np.array(slope.rise)


def variance(length, since=1.0, sigma=0.03, drift=0.05):
    """Of the climb between two places: of two heights, of the own height, and of bumps."""
    return 2.0 * sigma**2 + drift**2 * since + 0.03**2 * length


def test_at_first_the_ground_is_level():
    assert Slope().rise == (0.0, 0.0)
    assert range_over((3.0, 4.0, 5.0)).tolist() == [0.0, 0.0]


@pytest.mark.parametrize(("east", "climb"), [(2.0, 0.3), (-1.0, 0.2), (2.0, -0.05)])
def test_a_climb_between_two_places_is_weighed_by_its_doubt(east, climb):
    """By the densities of the climb itself on level ground and on sloping ground."""
    noise, length = variance(abs(east)), abs(east)
    odds, means = [], []
    for prior, rare in ((0.003, 1.0), (0.15, 0.1)):
        spread = noise + (length * prior) ** 2
        odds.append(rare * np.exp(-0.5 * climb**2 / spread) / np.sqrt(spread))
        means.append(east * prior**2 * climb / spread)
    expected = (odds[0] * means[0] + odds[1] * means[1]) / sum(odds)
    found = range_over((1.0, 2.0, 3.0), (1.0 + east, 2.0, 3.0 + climb))
    assert found == pytest.approx([expected, 0.0])
    assert averaged([east**2 / noise, 0.0], [east * climb / noise, 0.0])[0] == pytest.approx(
        expected
    )


def test_the_slope_to_the_north_is_told_as_that_to_the_east():
    east = range_over((0.0, 0.0, 0.0), (2.0, 0.0, 0.3))
    north = range_over((0.0, 0.0, 0.0), (0.0, 2.0, 0.3))
    assert north == pytest.approx(east[::-1])


@pytest.mark.parametrize(("length", "tells"), [(0.69, False), (0.71, True)])
def test_places_under_the_rangefinder_are_compared_from_07_m_on(length, tells):
    assert range_over((0.0, 0.0, 0.0), (0.0, length, 0.3)).any() == tells


def test_a_place_too_near_leaves_the_first_one_to_compare_with():
    near = range_over((0.0, 0.0, 0.0), (0.5, 0.0, 9.0), (2.0, 0.0, 0.3), each=0.5)
    assert near == pytest.approx(range_over((0.0, 0.0, 0.0), (2.0, 0.0, 0.3)))


def test_each_place_is_compared_with_the_one_before_it():
    found = range_over((0.0, 0.0, 0.0), (2.0, 0.0, 0.3), (2.0, 2.0, 0.3))
    noise = variance(2.0)
    assert found == pytest.approx(averaged([4.0 / noise] * 2, [0.6 / noise, 0.0]))


@pytest.mark.parametrize(("since", "tells"), [(2.9, True), (3.1, False)])
def test_places_more_than_3_s_apart_are_not_compared(since, tells):
    found = range_over((0.0, 0.0, 0.0), (2.0, 0.0, 0.3), each=since)
    noise = variance(2.0, since)
    assert found == pytest.approx(averaged([4.0 / noise, 0.0], [0.6 * tells / noise, 0.0]))


def test_after_a_long_time_the_new_place_is_compared_with():
    slope = Slope()
    slope.pass_over((0.0, 0.0, 0.0), 0.0, 0.03, 0.05)
    slope.pass_over((2.0, 0.0, 9.0), 9.0, 0.03, 0.05)
    slope.pass_over((4.0, 0.0, 9.3), 10.0, 0.03, 0.05)
    assert slope.rise == pytest.approx(range_over((0.0, 0.0, 0.0), (2.0, 0.0, 0.3)))


def test_what_a_rangefinder_told_fades_within_6_m():
    slope = Slope()
    range_over((0.0, 0.0, 0.0), (2.0, 0.0, 0.3), slope=slope)
    slope.move(2.0)
    slope.move(1.0)
    slope.pass_over((2.0, 2.0, 0.3), 2.0, 0.03, 0.05)
    noise, left = variance(2.0), np.exp(-0.5)
    expected = averaged([4.0 * left / noise, 4.0 / noise], [0.6 * left / noise, 0.0])
    assert slope.rise == pytest.approx(expected)


def test_no_ground_is_steeper_than_a_half():
    found = range_over((0.0, 0.0, 0.0), (3.0, 4.0, 9.0), sigma=0.001, drift=0.0)
    assert found == pytest.approx([0.3, 0.4])


# Places 2 m east and west and 1 m north and south of (7, -4), which rise by 0.1 to the east.
CROSS = np.array([[9.0, -4.0, 5.2], [5.0, -4.0, 4.8], [7.0, -3.0, 5.0], [7.0, -5.0, 5.0]])


def by_pictures(alike, tilt, sigma=0.1, left=1.0):
    """Return information and right side of one picture of the cross, whose tilt is in doubt."""
    information = left * np.array([8.0, 2.0]) / (alike * sigma**2)
    less = 1.0 / (1.0 + tilt**2 * information)
    return less * information, less * information * np.array([0.1, 0.0])


@pytest.mark.parametrize(("tilt", "counts"), [(0.0, 0.01), (0.01, 0.01), (0.03, 0.03)])
@pytest.mark.parametrize("alike", [1.0, 14.0])
def test_a_picture_is_weighed_by_what_its_errors_share(alike, tilt, counts):
    """Pictures in a row are alike; an attitude is never sure to less than 0.01 rad."""
    slope = Slope()
    slope.see(CROSS, np.full(4, 0.1), alike, tilt)
    assert slope.rise == pytest.approx(averaged(*by_pictures(alike, counts)))


def test_the_less_sure_places_of_a_picture_count_less():
    """Two places 3 m apart, known to 0.1 and 0.2 m, tell as much as their difference."""
    slope, noise = Slope(), 0.1**2 + 0.2**2
    places = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.6]])
    slope.see(places, np.array([0.1, 0.2]), 1.0, 0.02)
    information = 9.0 / noise
    less = 1.0 / (1.0 + 0.02**2 * information)
    expected = averaged([less * information, 0.0], [less * 1.8 / noise, 0.0])
    assert slope.rise == pytest.approx(expected)


def test_what_pictures_told_fades_too_and_adds_to_what_the_rangefinder_tells():
    slope = Slope()
    slope.see(CROSS, np.full(4, 0.1), 2.0, 0.02)
    slope.move(3.0)
    range_over((0.0, 0.0, 0.0), (0.0, 2.0, 0.3), slope=slope)
    information, weighted = by_pictures(2.0, 0.02, left=np.exp(-0.5))
    ranged = np.array([[0.0, 4.0], [0.0, 0.6]]) / variance(2.0)
    expected = averaged(information + ranged[0], weighted + ranged[1])
    assert slope.rise == pytest.approx(expected)
