"""Height over ground: slopes, drift of the own height, what passes below."""

import numpy as np
import pytest

from companion.estimation.height import HeightEstimator
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
