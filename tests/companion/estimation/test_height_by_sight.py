"""Height over ground by pictures: what points of the ground tell, and which points count."""

import numpy as np
import pytest

from companion.estimation.height import HeightEstimator
from companion.estimation.own_doubt import OwnDoubt
from companion.perception.parallax import FixedPoints
from mavlink_bridge.wire.messages import VehicleState
from tests.companion.estimation.height_looks import (
    LEVEL,
    RISE,
    at,
    look,
    over_a_slope,
)


def ground_points(rng, p, ground, trunks=0.2, n=60):
    """Points that parallax shows around p: ground at depressions of 20 to 60°, some on trunks."""
    azimuth, depression = rng.uniform(-1.2, 1.2, n), rng.uniform(0.35, 1.05, n)
    length = (p[2] - ground) / np.sin(depression)
    length *= np.where(rng.random(n) < trunks, rng.uniform(0.4, 0.9, n), 1.0)
    length *= 1.0 + rng.normal(0.0, 0.06, n)
    flat = np.cos(depression)
    rays = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), -np.sin(depression)])
    rows = np.zeros((n, 7))
    rows[:, :3], rows[:, 3] = p + length[:, None] * rays, 0.06 * length
    return FixedPoints.from_rows(rows)


def fly_by_pictures(ground, seconds=60.0, drift=0.0, speed=1.5, doubt=None):
    """Fly without a rangefinder; return errors and doubts [m] after five seconds."""
    rng, estimator, found = np.random.default_rng(5), HeightEstimator(), []
    doubt = doubt or OwnDoubt(velocity=0.08, tilt=0.006, height=0.1)
    for k in range(round(10 * seconds)):
        t = 0.1 * k
        p, v = np.array([speed * t, 0.0, 2.0 + drift * t]), np.array([speed, 0.0, drift])
        own, level = VehicleState(t, p, v, LEVEL, np.zeros(3)), ground(speed * t) + drift * t
        h = estimator.update(own, [], doubt.height)
        found.append((h.value - (p[2] - level), h.sigma))
        estimator.see(own, ground_points(rng, p, level), doubt)
    return np.array(found[50:]).T


def test_without_a_rangefinder_the_parallax_of_the_ground_tells_a_drift_of_the_height():
    errors, sigmas = fly_by_pictures(lambda x: 0.0, drift=1.0 / 60.0)
    assert np.abs(errors).max() < 0.25
    assert 0.05 < sigmas.max() < 0.3


def test_without_a_rangefinder_the_parallax_of_the_ground_tells_a_slope():
    errors, sigmas = fly_by_pictures(lambda x: 0.5 * np.sin(0.2 * x))  # up to 6°
    assert np.sqrt(np.mean(errors**2)) < 0.2
    assert np.mean((errors / sigmas) ** 2) < 3.0


def test_pictures_of_a_drone_that_does_not_move_say_nothing():
    doubt = OwnDoubt(height=0.5)
    errors, sigmas = fly_by_pictures(lambda x: 0.0, drift=1.0 / 60.0, speed=0.0, doubt=doubt)
    assert errors[-1] == pytest.approx(1.0, abs=0.05)
    assert sigmas[-1] > 0.5


def bark_points(rng, p, n=40):
    """Points of the bark of a trunk of 1 m radius, 1 m ahead of p, most at one height."""
    angle = rng.uniform(0.8, 1.2, n) * np.pi
    rows = np.zeros((n, 7))
    rows[:, 0], rows[:, 1] = p[0] + 2.0 + np.cos(angle), p[1] + np.sin(angle)
    rows[:, 2] = rng.normal(1.1, 0.05, n)
    rows[:, 3] = 0.05
    return FixedPoints.from_rows(rows)


@pytest.mark.parametrize("known", [False, True])
def test_a_trunk_that_fills_the_picture_is_no_step_of_the_ground(known):
    """Held for a step of 1.1 m after half a second, it made a drone jump up among others."""
    rng, estimator, doubt = np.random.default_rng(6), HeightEstimator(), OwnDoubt(height=0.1)
    for k in range(40 if known else 15):
        p, v = np.array([0.05 * k, 0.0, 2.0]), np.array([0.5, 0.0, 0.0])
        own = VehicleState(0.1 * k, p, v, LEVEL, np.zeros(3))
        height = estimator.update(own, [], doubt.height)
        trunks = np.array([[p[0] + 2.0, 0.0, 1.0]]) if known else np.zeros((0, 3))
        estimator.see(own, bark_points(rng, p), doubt, trunks)
    assert height.value == pytest.approx(2.0, abs=0.05)


def test_a_terrace_is_believed_by_sight():
    errors, _ = fly_by_pictures(lambda x: 1.0 * (x > 15.0), seconds=20.0)  # the first 5 s are cut
    assert errors[51:53].max() == pytest.approx(1.0, abs=0.2)
    assert np.abs(errors[75:]).max() < 0.3


def ring(n=8, level=0.2, away=2.0, sigma=0.1):
    """Points of the ground (n) around a drone at x = y = 0, `away` [m] from it."""
    angles = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    rows = np.zeros((n, 7))
    rows[:, 0], rows[:, 1] = away * np.cos(angles), away * np.sin(angles)
    rows[:, 2], rows[:, 3] = level, sigma
    return rows


def after_pictures(*rows, times=(0.0,), speed=1.0, doubt=None, trunks=None):
    """The height [m] of 2 m over the frame's origin after pictures of points at some times [s]."""
    estimator, own = HeightEstimator(), at(0.0, v=(speed, 0.0, 0.0))
    doubt = doubt or OwnDoubt(velocity=0.1, tilt=0.0)
    estimator.update(own, [])
    more = () if trunks is None else (np.array(trunks),)
    for t, row in zip(times, rows, strict=True):
        estimator.see(at(t, v=own.v), FixedPoints.from_rows(row), doubt, *more)
    return estimator.update(own, [])


@pytest.mark.parametrize(("dt", "lasts"), [(0.1, 0.1), (0.01, 0.02), (2.0, 0.7)])
@pytest.mark.parametrize("speed", [1.0, 2.0])
def test_a_picture_counts_by_its_points_the_speed_and_how_soon_it_comes(dt, lasts, speed):
    """The error of the speed lasts for 0.7 s: what comes sooner says less that is new."""
    height = after_pictures(ring(), ring(), times=(0.0, dt), speed=speed)
    scale = np.hypot(np.hypot(0.1 / np.hypot(2.0, 1.8), 0.1 / speed), 0.06)
    first, then = (2.0 * 0.7 / since * (1.8 * scale) ** 2 for since in (0.7, lasts))
    sure = 1.0 / 0.01 + 1.0 / first + 1.0 / then
    assert height.value == pytest.approx(2.0 - 0.2 * (1.0 / first + 1.0 / then) / sure)
    assert height.sigma == pytest.approx(1.0 / np.sqrt(sure))


@pytest.mark.parametrize(("tilt", "least"), [(0.048, 0.096), (0.06, 0.1), (0.01, 0.0952)])
def test_no_picture_makes_the_level_surer_than_the_tilt_does(tilt, least):
    """2 m away a tilt of 0.048 rad is 0.096 m of level; the doubt of before was 0.1 m."""
    height = after_pictures(ring(), doubt=OwnDoubt(velocity=0.1, tilt=tilt))
    assert height.sigma == pytest.approx(least, abs=1e-4)


@pytest.mark.parametrize(
    ("how", "counts"),
    [
        ({"n": 8}, True),
        ({"n": 7}, False),
        ({"away": 1.8 * np.sqrt(1.0 / 0.31**2 - 1.0)}, True),
        ({"away": 1.8 * np.sqrt(1.0 / 0.29**2 - 1.0)}, False),
    ],
)
def test_eight_points_that_are_seen_steeply_enough_make_a_look(how, counts):
    assert (after_pictures(ring(**how)).value < 1.999) is counts


@pytest.mark.parametrize(("speed", "counts"), [(0.39, False), (0.4, True)])
def test_a_drone_that_is_slower_than_40_cm_a_second_learns_nothing(speed, counts):
    assert (after_pictures(ring(), speed=speed).value < 1.999) is counts


@pytest.mark.parametrize(("radius", "counts"), [(0.19, True), (0.21, False)])
def test_points_within_30_cm_of_a_known_bark_are_not_the_ground(radius, counts):
    """The trunk is half a metre from one of the eight points."""
    assert (after_pictures(ring(), trunks=[[2.5, 0.0, radius]]).value < 1.999) is counts
    aside = after_pictures(ring(), trunks=[[2.0, 0.5, radius]]).value
    assert (aside < 1.999) is counts


@pytest.mark.parametrize(("others", "counts"), [(12, True), (13, False)])
def test_two_fifths_of_all_points_below_have_to_agree(others, counts):
    """The others are at levels 0.25 m apart, where 0.2 m is alike."""
    rows = ring(8 + others)
    rows[8:, 2] = -0.5 - 0.25 * np.arange(others)
    assert (after_pictures(rows).value != 2.0) is counts


@pytest.mark.parametrize(("apart", "counts"), [(0.19, True), (0.21, False)])
def test_points_agree_within_a_tenth_of_the_height(apart, counts):
    rows = ring(8)
    rows[0, 2] += apart
    assert (after_pictures(rows).value != 2.0) is counts


@pytest.mark.parametrize(("pictures", "believed"), [(19, False), (20, True)])
def test_a_step_by_sight_takes_twenty_pictures_in_a_row(pictures, believed):
    rows, doubt = pictures * [ring(level=-2.5, sigma=0.01)], OwnDoubt(velocity=0.01, tilt=0.0)
    height = after_pictures(*rows, times=0.1 * np.arange(pictures), doubt=doubt)
    assert (height.value > 3.0) is believed
    assert believed or height.value == 2.0


def test_points_of_a_known_slope_tell_the_level_below_the_drone():
    """They are up to 2 m aside, where the ground is up to half a metre higher or lower."""
    rows, estimator = ring(level=0.0), over_a_slope()
    rows[:, 2] = rows[:, :2] @ RISE
    rows = np.concatenate([rows, 0.5 * rows])
    rows[:, 3] = 0.1
    own = at(16.1, v=(1.0, 0.0, 0.0))
    before = estimator.update(own, [])
    estimator.see(own, FixedPoints.from_rows(rows), OwnDoubt(velocity=0.01, tilt=0.0))
    after = estimator.update(own, [])
    assert after.sigma < before.sigma  # the points agree
    assert after.value == pytest.approx(before.value, abs=0.01)


def test_points_less_than_a_metre_away_count_by_their_distance_as_others_do():
    """0.6 m above the ground and 0.45 m aside: 0.75 m away, known to 0.075 m, a tenth of it."""
    estimator, own = HeightEstimator(), at(0.0, z=0.8, v=(1.0, 0.0, 0.0))
    estimator.update(own, [])
    points = FixedPoints.from_rows(ring(away=0.45, sigma=0.075))
    estimator.see(own, points, OwnDoubt(velocity=0.0, tilt=0.0))
    noise = 2.0 * (0.6 * np.hypot(0.1, 0.06)) ** 2  # twice: 2 · 0.7 s over 0.7 s
    expected = 0.8 - 0.2 * 0.01 / (0.01 + noise)
    assert estimator.update(own, []).value == pytest.approx(expected)


@pytest.mark.parametrize(("apart", "counts"), [(0.09, True), (0.11, False)])
def test_points_agree_within_a_tenth_of_the_height_over_the_ground_and_not_over_the_frame(
    apart, counts
):
    estimator, own = HeightEstimator(), at(0.0, v=(1.0, 0.0, 0.0))
    before = estimator.update(own, 5 * [look(1.0)])
    rows = ring(8, level=before.ground.level)
    rows[0, 2] += apart
    estimator.see(own, FixedPoints.from_rows(rows), OwnDoubt(velocity=0.1, tilt=0.0))
    assert (estimator.update(own, []).sigma < before.sigma) is counts


@pytest.mark.parametrize("ahead", [(1.0, 0.0), (0.0, -1.0)])
def test_a_tilt_in_doubt_moves_the_level_by_how_far_away_the_points_are(ahead):
    """Eight points 1.9 to 2.1 m ahead; 0.03 rad there are 0.06 m of level."""
    estimator, own = HeightEstimator(), at(0.0, v=(1.0, 0.0, 0.0))
    estimator.update(own, [])
    rows = ring()
    rows[:, :2] = np.linspace(1.9, 2.1, 8)[:, None] * ahead
    for k in range(200):
        seen = at(0.7 * k, v=(1.0, 0.0, 0.0))
        estimator.see(seen, FixedPoints.from_rows(rows), OwnDoubt(velocity=0.1, tilt=0.03))
    assert estimator.update(own, []).sigma == pytest.approx(0.06, rel=0.01)
