"""Surfaces remembered from depth images."""

import numpy as np
import pytest

from companion.estimation.surface_map import SurfaceConfig, SurfaceMap
from tests.companion.depth_images import (
    CAMERA,
    LEVEL,
    NO_TRUNKS,
    rays,
    read,
    state,
    to_cylinder,
    to_planes,
)


@pytest.mark.parametrize("value", [np.nan, 0.0, -1.0])
def test_a_range_that_the_camera_cannot_tell_is_neither_free_nor_near(value):
    surfaces = SurfaceMap(CAMERA, SurfaceConfig())
    p = np.array([0.0, 0.0, 2.0])
    wall = to_planes(p, rays(), [((1, 0, 0), 3.0)])
    for time in (0.0, 0.1):
        surfaces.update(read(wall, p)[1], state(p, time=time))
    before = surfaces.points(NO_TRUNKS)
    trunks, ranges = read(np.full((100, 160), value), p)
    assert np.isnan(ranges).all()
    assert trunks == []
    for time in (0.2, 0.3):
        surfaces.update(ranges, state(p, time=time))
    assert len(before) > 100
    np.testing.assert_array_equal(surfaces.points(NO_TRUNKS), before)


def test_a_surface_that_is_gone_is_forgotten_at_once_and_one_out_of_view_after_a_while():
    surfaces = SurfaceMap(CAMERA, SurfaceConfig(memory=4.0))
    p, behind = np.array([0.0, 0.0, 2.0]), np.array([0.0, 0, 0, 1.0])
    wall = read(to_planes(p, rays(), [((1, 0, 0), 3.0)]), p)[1]
    free = read(np.full((100, 160), np.inf), p)[1]
    for time in (0.0, 0.1):
        surfaces.update(wall, state(p, time=time))
    seen = len(surfaces.points(NO_TRUNKS))
    surfaces.update(free, state(p, behind, 2.0))
    assert len(surfaces.points(NO_TRUNKS)) == seen > 100
    surfaces.update(free, state(p, LEVEL, 2.1))
    assert len(surfaces.points(NO_TRUNKS)) < 0.05 * seen
    surfaces.update(wall, state(p, LEVEL, 2.2))
    surfaces.update(wall, state(p, LEVEL, 2.3))
    surfaces.update(free, state(p, behind, 6.5))
    assert len(surfaces.points(NO_TRUNKS)) == 0


def test_points_of_a_known_trunk_are_not_surfaces():
    surfaces = SurfaceMap(CAMERA, SurfaceConfig())
    p = np.array([0.0, 0.0, 2.0])
    _, ranges = read(to_cylinder(p, rays(), 3.0, 0.0, 0.8), p)
    for time in (0.0, 0.1):
        surfaces.update(ranges, state(p, time=time))
    assert len(surfaces.points(NO_TRUNKS)) > 5
    assert len(surfaces.points(np.array([[3.0, 0.0, 0.8]]))) == 0
