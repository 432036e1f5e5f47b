"""Dryden turbulence against the formulas of MIL-F-8785C, typed here in feet."""

import math

import numpy as np
import pytest

from sitl_sim.vehicles.turbulence import Turbulence, intensities, scales

N = 200
DT = 0.02


def gusts(strength, height, seconds, wind=(8.0, 0.0, 0.0), seed=1):
    """(T, N, 3) m/s at drones that hover at one height."""
    air = Turbulence(strength, list(range(1, N + 1)), seed)
    where, mean, v = np.full(N, height), np.tile(wind, (N, 1)), np.zeros((N, 3))
    return np.array([air.step(DT, where, mean, v) for _ in range(round(seconds / DT))])


def test_intensity_and_scale_are_those_of_the_specification():
    height = 50.0  # ft
    across, up = intensities("light", np.array([height * 0.3048]))
    assert up[0] == pytest.approx(0.1 * 15 * 0.514444, rel=1e-4)  # 15 knots at 20 ft
    assert across[0] / up[0] == pytest.approx((0.177 + 0.000823 * height) ** -0.4)
    long, high = scales(np.array([height * 0.3048]))
    assert high[0] == pytest.approx(50 * 0.3048)
    assert long[0] == pytest.approx(50 / (0.177 + 0.000823 * 50) ** 1.2 * 0.3048)
    assert intensities("severe", np.array([20.0]))[1] == pytest.approx(3.0 * up)


def test_the_variance_is_the_intensity_squared():
    found = gusts("moderate", 4.0, 4.0)
    across, up = intensities("moderate", np.array([4.0]))
    for gust in (found[0], found[-1]):
        np.testing.assert_allclose(gust.std(axis=0), [*across, *across, *up], rtol=0.15)
    np.testing.assert_allclose(found.mean(axis=(0, 1)), 0.0, atol=0.5)


def test_the_correlation_over_time_is_that_of_the_spectra():
    """Transforms of the spectra: exp(-x) along the wind, (1 - x/2) exp(-x) across and upwards."""
    height, speed = 6.0, 8.0
    found = gusts("light", height, 6.0)
    sigma = intensities("light", np.array([height]))[0][0]
    passing = math.hypot(speed, sigma)
    long, high = (float(s[0]) for s in scales(np.array([height])))
    for axis, scale, form in (
        (0, long, lambda x: math.exp(-x)),
        (1, long, lambda x: (1 - x / 2) * math.exp(-x)),
        (2, high, lambda x: (1 - x / 2) * math.exp(-x)),
    ):
        for share in (0.25, 0.7):  # of the length scale
            steps = round(share * scale / passing / DT)
            pairs = found[:-steps, :, axis], found[steps:, :, axis]
            correlation = np.corrcoef(pairs[0].ravel(), pairs[1].ravel())[0, 1]
            assert correlation == pytest.approx(form(steps * DT * passing / scale), abs=0.05)


def test_gusts_differ_from_drone_to_drone_and_not_from_run_to_run():
    found = gusts("light", 2.0, 1.0)
    assert abs(np.corrcoef(found[:, 0, 0], found[:, 1, 0])[0, 1]) < 1.0 - 1e-9
    assert np.abs(found[-1, 0] - found[-1, 1]).max() > 0.1
    np.testing.assert_array_equal(found, gusts("light", 2.0, 1.0))
    assert not np.allclose(found, gusts("light", 2.0, 1.0, seed=2))


def test_gusts_along_the_wind_turn_with_it():
    east, north = gusts("light", 3.0, 0.1), gusts("light", 3.0, 0.1, wind=(0.0, 8.0, 0.0))
    np.testing.assert_allclose(north[..., 1], east[..., 0], atol=1e-12)
    np.testing.assert_allclose(north[..., 0], -east[..., 1], atol=1e-12)
