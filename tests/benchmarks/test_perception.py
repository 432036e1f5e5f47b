"""The perception figures on seeds used for nothing else, with the goals as bounds."""

import numpy as np

from companion.perception.ball import ColorDetector
from companion.perception.camera import Camera
from tests.benchmarks import perception_scenes, trunk_scenes


def test_marked_drones_to_8_m():
    detector = ColorDetector(Camera.equidistant(640, 400))
    bands, _ = perception_scenes.evaluate(detector, 120, 20260, 640, 400)
    band = bands[(0.3, 8.0)]
    assert band.wanted > 200
    assert band.found / band.wanted >= 0.97
    assert band.found / (band.found + band.false) >= 0.98
    assert np.sqrt(np.mean(np.square(band.bearing))) <= 0.5
    assert np.median(np.abs(band.relative)) <= 0.025
    assert abs(np.median(band.relative)) <= 0.01
    # sigma_range is honest: the errors are about as large as it says.
    assert np.percentile(np.abs(band.normalised), 95) < 2.0


def test_trunks_in_flight_attitudes():
    figures, _ = trunk_scenes.evaluate(100, 20260, 640, 400, tilt_deg=12.0)
    near, all_ = figures.bands[(2.0, 5.0)], figures.bands[(0.0, 8.0)]
    assert near.found == near.wanted > 40
    assert all_.found / all_.wanted >= 0.97
    assert np.median(np.abs(all_.relative)) <= 0.03
    assert figures.ghosts <= 0.08 * figures.reports


def test_trunks_at_any_attitude():
    figures, _ = trunk_scenes.evaluate(100, 20261, 640, 400)
    band = figures.bands[(0.0, 8.0)]
    assert band.found / band.wanted >= 0.92
    assert np.median(np.abs(band.relative)) <= 0.05
