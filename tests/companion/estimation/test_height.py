"""Height over ground: slopes, drift of the own height, what passes below."""

import numpy as np
import pytest

from companion.estimation.height import HeightEstimator
from companion.estimation.own_doubt import OwnDoubt
from companion.perception.parallax import FixedPoints
from mavlink_bridge.wire.messages import DistanceSensor, VehicleState

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
DOWN, LASER = 25, 0


def fly(estimator, ground, seconds=20.0, drift=0.0, fitted=True, q=LEVEL, below=lambda t: np.inf):
    """Fly on at 1.5 m/s, 2 m over the ground at the start; return errors and doubts [m]."""
    rng, found = np.random.default_rng(2), []
    upright = 1.0 - 2.0 * (q[1] ** 2 + q[2] ** 2)
    for k in range(round(10 * seconds)):
        t = 0.1 * k
        true = 2.0 - ground(1.5 * t)
        p, v = np.array([1.5 * t, 0.0, 2.0 + drift * t]), np.array([1.5, 0.0, drift])
        seen = min(true, below(t)) / upright + rng.normal(0.0, 0.03)
        looks = [DistanceSensor(t, seen, 0.1, 12.0, DOWN, LASER)] if fitted else []
        h = estimator.update(VehicleState(t, p, v, q, np.zeros(3)), looks)
        found.append((h.value - true, h.sigma))
    return np.array(found[10:]).T


def test_a_slope_is_followed():
    errors, sigmas = fly(HeightEstimator(), lambda x: -np.tan(np.radians(10.0)) * x)
    assert np.abs(errors).max() < 0.2
    assert sigmas.max() < 0.1


def test_a_drifting_height_is_not_followed_into_the_ground():
    errors, _ = fly(HeightEstimator(), lambda x: 0.0, seconds=60.0, drift=1.0 / 60.0)
    assert np.abs(errors).max() < 0.1
    unmeasured, sigmas = fly(HeightEstimator(), lambda x: 0.0, 60.0, 1.0 / 60.0, fitted=False)
    assert unmeasured[-1] == pytest.approx(1.0, abs=0.05)
    assert sigmas[-1] > 0.5  # and the drone knows that it does not know


def test_what_passes_below_is_not_the_ground():
    errors, _ = fly(HeightEstimator(), lambda x: 0.0, below=lambda t: 0.8 if 5 < t < 5.35 else 9.0)
    assert np.abs(errors).max() < 0.1


def test_a_step_of_the_ground_is_believed_after_half_a_second():
    errors, _ = fly(HeightEstimator(), lambda x: 1.0 * (x > 7.5))
    assert np.abs(errors[-100:]).max() < 0.1


def test_a_tilted_beam_measures_the_height():
    roll = np.array([np.cos(0.2), np.sin(0.2), 0.0, 0.0])
    errors, _ = fly(HeightEstimator(), lambda x: 0.0, q=roll)
    assert np.abs(errors).max() < 0.1


@pytest.mark.parametrize("climb", [1.5, -1.5])
def test_a_look_counts_for_the_moment_at_which_it_was_taken(climb):
    """Its beam is a tenth of a second older than the state that it is compared with."""
    estimator = HeightEstimator()
    for t in np.arange(0.0, 3.0, 0.1):
        p, v = np.array([0.0, 0.0, 5.0 + climb * t]), np.array([0.0, 0.0, climb])
        look = DistanceSensor(t - 0.1, p[2] - 0.1 * climb, 0.1, 12.0, DOWN, LASER)
        h = estimator.update(VehicleState(t, p, v, LEVEL, np.zeros(3)), [look])
    assert h.value == pytest.approx(p[2], abs=0.02)


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


def test_a_vehicle_that_stands_on_the_ground_has_no_height_whatever_its_estimator_tells():
    """With GPS one told 1.16 m before the take-off, looked for trunks, and saw nothing clearly."""
    estimator, still = HeightEstimator(), np.zeros(3)
    for k in range(300):
        own = VehicleState(0.1 * k, np.array([0.0, 0.0, 1.16 + 0.002 * k]), still, LEVEL, still)
        height = estimator.update(own, [], 0.5, stands=True)
        assert height.value == 0.0
    own = VehicleState(30.1, np.array([0.0, 0.0, 3.76]), still, LEVEL, still)
    height = estimator.update(own, [], 0.5)
    assert height.value == pytest.approx(2.0, abs=0.01)
    assert height.sigma == pytest.approx(0.112, abs=0.005)  # 0.1 m, and 0.2 s of wandering


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
