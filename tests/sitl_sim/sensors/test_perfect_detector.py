"""A perfect detector reports what is visible by eq. (6)."""

import numpy as np
import pytest

from sitl_sim.sensors.perfect_detector import WallRanges
from sitl_sim.worlds.world import Occluders


def test_ranges_to_walls_are_those_of_the_boxes_and_unknown_behind_trunks():
    world = {
        "boxes": [{"min": [4, -9, 0], "max": [5, 9, 9]}],
        "cylinders": [{"x": 2.0, "y": 0.0, "radius": 0.3, "height": 9.0}],
    }
    ranges = WallRanges(Occluders(world), 640, 400, 160.0)
    level = np.array([1.0, 0.0, 0.0, 0.0])
    seen = ranges(np.array([0.0, 0.0, 2.0]), level, 15.0)
    assert seen.shape == (50, 80)
    assert np.isnan(seen[24:26, 39:41]).all()  # the trunk, dead ahead
    azimuth = (np.arange(80) - 39.5) * np.radians(2.0)
    wall = (np.abs(azimuth) < np.arctan(9 / 4)) & (np.abs(azimuth) > 0.2)
    # One degree above the horizon; the rays of a row are not all level.
    assert seen[24, wall] == pytest.approx(4.0 / np.cos(azimuth[wall]), rel=2e-2)
    assert np.isinf(ranges(np.array([-20.0, 0.0, 2.0]), level, 15.0)).all()
    turned = np.array([np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)])  # to the north
    beside = ranges(np.array([0.0, 0.0, 2.0]), turned, 15.0)
    assert np.isinf(beside[24, :40]).all()  # the wall is on its right
    assert np.isfinite(beside[24, 45:]).any()
