"""Vehicle states and looks of a rangefinder, for tests of the height."""

import numpy as np
import pytest

from companion.estimation.height import HeightEstimator
from mavlink_bridge.wire.messages import DistanceSensor, VehicleState

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
DOWN, LASER = 25, 0
STILL = np.zeros(3)
RISE = np.array([-0.2, 0.15])  # of the ground, east and north


def at(time, x=0.0, y=0.0, z=2.0, q=LEVEL, v=(0.0, 0.0, 0.0)):
    return VehicleState(time, np.array([x, y, z]), np.array(v), np.array(q), STILL)


def look(distance, time=0.0, least=0.1, most=12.0, orientation=DOWN, sigma=0.0, quality=0):
    return DistanceSensor(time, distance, least, most, orientation, LASER, sigma, quality)


def over_a_slope():
    """An estimator that has flown to and fro over a slope, and is at x, y = 0, 0 at 16 s."""
    estimator = HeightEstimator()
    for k in range(161):
        s = 0.1 * k % 8.0
        x, y = 1.5 * min(s, 8.0 - s), 2.0 * np.sin(np.pi * s / 2.0)
        estimator.update(at(0.1 * k, x, y), [look(2.0 - RISE @ (x, y), 0.1 * k)])
    height = estimator.update(at(16.0), 5 * [look(2.0, 16.0)])
    assert height.value == pytest.approx(2.0, abs=0.01)
    assert height.ground.rise == pytest.approx(RISE, abs=0.02)
    return estimator
