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


@pytest.mark.parametrize("turn", np.deg2rad([40, 80, 100, 120, 150, 180, -60, -110]))
def test_what_is_in_view_is_forgotten_and_what_is_not_stays_however_the_drone_turns(turn):
    surfaces = SurfaceMap(CAMERA, SurfaceConfig())
    p = np.array([0.0, 0.0, 2.0])
    wall = read(to_planes(p, rays(), [((1, 0, 0), 3.0)]), p)[1]
    for time in (0.0, 0.1):
        surfaces.update(wall, state(p, time=time))
    before = surfaces.points(NO_TRUNKS)
    turned = np.array([np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)])
    surfaces.update(read(np.full((100, 160), np.inf), p)[1], state(p, turned, 0.2))
    kept = surfaces.points(NO_TRUNKS)
    bearing = np.arctan2(before[:, 1], before[:, 0]) - turn
    aside = np.abs(np.arctan2(np.sin(bearing), np.cos(bearing)))
    level = np.abs(before[:, 2] - 2.0) < 0.3  # where azimuth alone decides
    stays = {tuple(q) for q in before[level & (aside > np.deg2rad(83))]}
    goes = {tuple(q) for q in before[level & (aside < np.deg2rad(70))]}
    left = {tuple(q) for q in kept}
    assert stays <= left
    assert not goes & left
    assert stays or goes


def test_points_of_a_known_trunk_are_not_surfaces():
    surfaces = SurfaceMap(CAMERA, SurfaceConfig())
    p = np.array([0.0, 0.0, 2.0])
    _, ranges = read(to_cylinder(p, rays(), 3.0, 0.0, 0.8), p)
    for time in (0.0, 0.1):
        surfaces.update(ranges, state(p, time=time))
    assert len(surfaces.points(NO_TRUNKS)) > 5
    assert len(surfaces.points(np.array([[3.0, 0.0, 0.8]]))) == 0


@pytest.mark.parametrize(
    ("name", "good", "bad"),
    [
        ("cube", 0.03, 0.02),
        ("memory", 0.0, -0.1),
        ("range", 0.5, 0.0),
        ("hits_to_count", 1, 0),
        ("stretch", 1.0, 0.9),
        ("rough", 0.0, -0.1),
        ("planes", 0, -1),
        ("planes", 32, 33),
        ("trunk_margin", 0.0, -0.1),
    ],
)
def test_numbers_of_the_map_that_mean_nothing_are_refused(name, good, bad):
    assert getattr(SurfaceConfig(**{name: good}), name) == good
    with pytest.raises(ValueError, match=name):
        SurfaceConfig(**{name: bad})


P = np.array([0.05, 0.05, 2.05])  # in a corner of a cube of 0.2 m
AHEAD = P + np.array([[3.0, 0.0, 0.0]])
UNKNOWN, FREE = np.nan, np.inf


def picture(middle, around=FREE):
    """A depth image of 3 by 5 pixels; that in its middle looks straight ahead."""
    ranges = np.full((3, 5), around, np.float16)
    ranges[1, 2] = middle
    return ranges


def seen(*middles, p=P, **config):
    """Return a map that has seen these ranges [m] ahead, 0.1 s apart."""
    surfaces = SurfaceMap(CAMERA, SurfaceConfig(**config))
    for n, middle in enumerate(middles):
        surfaces.update(picture(middle), state(p, time=0.1 * n))
    return surfaces


def count(surfaces):
    return len(surfaces.points(NO_TRUNKS))


def test_a_cube_counts_from_its_second_look_on():
    assert count(seen(3.0)) == 0
    assert seen(3.0, 3.0).points(NO_TRUNKS) == pytest.approx(AHEAD)
    assert count(seen(3.0, hits_to_count=1)) == 1
    assert count(seen(3.0, 3.0, hits_to_count=3)) == 0


@pytest.mark.parametrize(("range_", "counts"), [(4.9, 1), (5.1, 0)])
def test_surfaces_within_5_m_are_taken_in(range_, counts):
    assert count(seen(range_, range_)) == counts


def test_two_looks_into_one_cube_are_of_one_surface_at_the_place_seen_first():
    """The cube reaches from 3.0 to 3.2 m."""
    assert seen(3.0, 3.125).points(NO_TRUNKS) == pytest.approx(AHEAD)
    assert count(seen(3.0, 3.1875)) == 0


@pytest.mark.parametrize("origin", [0.0, -60.0])
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(("moved", "counts"), [(0.1, 1), (-0.04, 1), (0.2, 0), (-0.1, 0)])
def test_cubes_are_told_apart_along_each_axis(origin, axis, moved, counts):
    surfaces = seen(3.0, p=P + origin)
    surfaces.update(picture(3.0), state(P + origin + moved * np.eye(3)[axis], time=0.1))
    assert count(surfaces) == counts


def test_all_points_of_one_frame_in_a_cube_are_one_look_at_their_mean():
    """Two pixels of a fine picture; the second shows a place 0.05 m to the right."""
    ranges = np.full((101, 161), FREE, np.float16)
    ranges[50, 80:82] = 3.0
    surfaces = SurfaceMap(CAMERA, SurfaceConfig(hits_to_count=1))
    surfaces.update(ranges, state(P))
    assert count(surfaces) == 2  # it lies beyond the cube's edge
    surfaces = SurfaceMap(CAMERA, SurfaceConfig(hits_to_count=1))
    surfaces.update(ranges, state(P + np.array([0.0, 0.05, 0.0])))
    turn = np.radians(160.0) / 161
    mean = np.array([[1.5 * (1.0 + np.cos(turn)), 0.05 - 1.5 * np.sin(turn), 0.0]])
    assert surfaces.points(NO_TRUNKS) == pytest.approx(P + mean)


@pytest.mark.parametrize(
    ("middle", "around", "counts"),
    [
        (3.25, FREE, 1),  # as deep as the cube, with some noise
        (3.375, FREE, 0),
        (FREE, FREE, 0),
        (FREE, 3.25, 1),  # an edge of it still shows beside
        (UNKNOWN, FREE, 1),
        (FREE, UNKNOWN, 1),
    ],
)
def test_a_cube_is_gone_where_the_picture_shows_03_m_behind_it(middle, around, counts):
    surfaces = seen(3.0, 3.0)
    surfaces.update(picture(middle, around), state(P, time=0.2))
    there = surfaces.points(NO_TRUNKS)[:, 0]
    assert np.count_nonzero(np.abs(there - P[0] - 3.0) < 0.01) == counts


@pytest.mark.parametrize(("time", "counts"), [(4.0, 1), (4.2, 0)])
def test_a_cube_that_does_not_show_is_kept_for_4_s_after_its_last_look(time, counts):
    surfaces = seen(3.0, 3.0)
    surfaces.update(picture(UNKNOWN, UNKNOWN), state(P, time=0.1 + time - 0.05))
    assert count(surfaces) == counts


@pytest.mark.parametrize(("away", "counts"), [(1.95, 1), (2.05, 0)])
def test_a_cube_that_is_left_more_than_5_m_behind_is_forgotten(away, counts):
    surfaces = seen(3.0, 3.0)
    surfaces.update(picture(UNKNOWN, UNKNOWN), state(P - [away, 0.0, 0.0], time=0.2))
    assert count(surfaces) == counts


@pytest.mark.parametrize(("radius", "counts"), [(0.6, 1), (0.7, 0)])
def test_points_within_035_m_of_any_trunk_are_the_trunks(radius, counts):
    trunk, far = [P[0] + 3.0, P[1] + 1.0, radius], [-9.0, 0.0, 0.5]
    for trunks in ([trunk], [far, trunk], [trunk, far]):
        assert len(seen(3.0, 3.0).points(np.array(trunks))) == counts


def test_pictures_may_change_their_size():
    surfaces = seen(3.0)
    ranges = np.full((7, 9), FREE, np.float16)
    ranges[3, 4] = 3.0
    surfaces.update(ranges, state(P, time=0.1))
    assert surfaces.points(NO_TRUNKS) == pytest.approx(AHEAD)


def test_a_cube_at_the_very_edge_of_the_picture_can_be_gone():
    """It is seen in the leftmost column, and lies a third of a pixel right of it after a turn."""
    surfaces, ranges = SurfaceMap(CAMERA, SurfaceConfig()), picture(FREE)
    ranges[1, 0] = 3.0
    for time in (0.0, 0.1):
        surfaces.update(ranges, state(P, time=time))
    assert count(surfaces) == 1
    half = 0.5 * np.radians(160.0) / 5 * 0.3
    surfaces.update(picture(FREE), state(P, [np.cos(half), 0.0, 0.0, np.sin(half)], 0.2))
    assert count(surfaces) == 0
