"""The way along walls, and the free room around the drone."""

import numpy as np
import pytest

from companion.estimation.surface_map import SurfaceConfig, SurfaceMap
from companion.guidance.corridor import corridor_planes, free_heading
from tests.companion.depth_images import CAMERA, NO_TRUNKS, rays, read, state, to_planes

REACH = SurfaceConfig().range
TUNNEL = [((0, 1, 0), 1.0), ((0, -1, 0), 1.0), ((0, 0, 1), 3.0), ((0, 0, -1), -1.0)]


def test_free_room_in_a_tunnel_is_the_tunnel():
    surfaces = SurfaceMap(CAMERA, SurfaceConfig())
    p = np.array([0.0, 0.2, 2.0])
    for n in range(3):
        _, ranges = read(to_planes(p, rays(), TUNNEL), p)
        surfaces.update(ranges, state(p, time=0.1 * n))
    goal = p + np.array([5.0, -0.2, 0])
    planes = corridor_planes(p, goal, surfaces.points(NO_TRUNKS), SurfaceConfig())
    assert len(planes) == 4
    assert np.linalg.norm(planes[:, :3], axis=1) == pytest.approx(1.0)
    for normal, b in TUNNEL:
        close = planes[planes[:, :3] @ np.array(normal) > 0.97]
        assert len(close) == 1
        assert close[0, 3] == pytest.approx(b, abs=0.05)
    ahead = np.array([[2.0, 0.0, 2.0]])
    assert (ahead @ planes[:, :3].T + 0.4 < planes[:, 3]).all()


def test_no_remembered_point_is_inside_the_free_room():
    rng = np.random.default_rng(4)
    config = SurfaceConfig(planes=32, rough=0.0)
    points = rng.uniform(-4, 4, (300, 3))
    planes = corridor_planes(np.zeros(3), np.array([9.0, 0, 0]), points, config)
    assert (points @ planes[:, :3].T >= planes[:, 3] - 1e-9).any(axis=1).all()
    assert (planes[:, 3] > 0.0).all()


def wall_with_opening():
    """Points 0.1 m apart of a wall across y = 5 m, open for |x| < 1 m, and of the tunnel behind."""
    x, y, z = (np.arange(a, b, 0.1) for a, b in ((1.0, 5.0), (5.0, 8.0), (1.0, 3.0)))
    right = [(a, 5.0, c) for a in x for c in z] + [(1.0, b, c) for b in y for c in z]
    return np.array([(sign * a, b, c) for a, b, c in right for sign in (-1.0, 1.0)])


def test_beside_an_opening_the_drone_first_flies_sideways_to_it():
    points = wall_with_opening()
    goal, p = np.array([0.3, 9.5, 2.0]), np.array([1.2, 3.7, 2.0])
    for _ in range(100):
        d = free_heading(p, goal, points, 0.5, REACH) - p
        p = p + 0.1 * d / max(np.linalg.norm(d), 0.1)
        assert np.linalg.norm(points[:, :2] - p[:2], axis=1).min() > 0.4
    assert p == pytest.approx(goal, abs=0.1)


def test_a_slanting_way_turns_past_the_wall_and_stays_on_its_side():
    points = wall_with_opening()
    p = np.array([0.5, 3.6, 2.0])
    d = free_heading(p, np.array([0.95, 9.5, 2.0]), points, 0.4, REACH) - p
    at_mouth, at_end = (p[0] + d[0] / d[1] * (y - p[1]) for y in (5.0, 8.0))
    assert 0.2 < at_end <= at_mouth <= 0.6  # the left side is for a drone that comes the other way


def test_a_free_way_and_a_way_without_another_stay_as_they_are():
    points = wall_with_opening()
    goal = np.array([0.0, 9.5, 2.0])
    p = np.array([0.1, 2.0, 2.0])
    assert free_heading(p, goal, points, 0.5, REACH) is goal
    assert free_heading(p, goal, np.zeros((0, 3)), 0.5, REACH) is goal
    closed = np.array([(0.1 * k, 5.0, 2.0) for k in range(-60, 60)])
    assert free_heading(p, goal, closed, 0.5, REACH) is goal


def test_a_point_where_the_drone_is_itself_has_no_side():
    here, goal = np.array([1.0, 2.0, 1.5]), np.array([6.0, 2.0, 1.5])
    wall = np.array([[1.0, 3.0, 1.5]])
    planes = corridor_planes(here, goal, np.vstack([here[None], wall]), SurfaceConfig())
    assert planes == pytest.approx(corridor_planes(here, goal, wall, SurfaceConfig()))
    assert planes[0] == pytest.approx([0.0, 1.0, 0.0, 3.0])
