import numpy as np
import pytest

from companion.estimation.surface_map import SurfaceConfig, SurfaceMap
from companion.perception.camera import Camera
from companion.perception.depth import DepthConfig, DepthReader
from companion.types import Detection
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import VehicleState

CAMERA = Camera.equidistant(640, 400)
LENS = CAMERA.scaled(160, 100)
LEVEL = np.array([1.0, 0, 0, 0])
NO_TRUNKS = np.zeros((0, 3))


def state(p, q=LEVEL, time=0.0):
    return VehicleState(time, np.array(p, float), np.zeros(3), np.array(q, float), np.zeros(3))


def rays(q=LEVEL):
    """(100,160,3) world directions of the depth image's pixels."""
    return LENS.directions.astype(float) @ (rotation_matrix(q) @ rotation_matrix(CAMERA.mount)).T


def to_cylinder(p, d, x, y, radius):
    a, f = (d[..., :2] ** 2).sum(-1), p[:2] - np.array([x, y])
    b = d[..., :2] @ f
    root = b * b - a * (f @ f - radius**2)
    t = (-b - np.sqrt(np.maximum(root, 0))) / a
    return np.where((root > 0) & (t > 0), t, np.inf)


def to_planes(p, d, planes):
    """Nearest of walls n·x = b seen from their free side."""
    with np.errstate(divide="ignore", invalid="ignore"):
        t = [(b - np.dot(n, p)) / (d @ np.array(n, float)) for n, b in planes]
    return np.min([np.where(x > 0, x, np.inf) for x in t], axis=0)


def read(depth, p, q=LEVEL, drones=()):
    r_wc = rotation_matrix(np.array(q)) @ rotation_matrix(CAMERA.mount)
    return DepthReader(CAMERA, DepthConfig()).read(depth.astype(np.float32), r_wc, p[2], drones)


@pytest.mark.parametrize("pitch", [0.0, 0.3, -0.3])
def test_trunks_with_place_and_radius(pitch):
    p = np.array([0.0, 0.0, 2.0])
    q = np.array([np.cos(pitch / 2), 0.0, np.sin(pitch / 2), 0.0])
    stand = [(3.0, 0.5, 0.4), (5.0, -3.0, 1.0), (2.0, 2.5, 0.25)]
    d = rays(q)
    depth = np.min([to_cylinder(p, d, *c) for c in stand], axis=0)
    trunks, _ = read(depth, p, q)
    r_wc = rotation_matrix(q) @ rotation_matrix(CAMERA.mount)
    found = sorted([*(r_wc @ t.direction * t.distance)[:2], t.radius] for t in trunks)
    assert np.array(found) == pytest.approx(np.array(sorted(stand)), abs=0.12)


@pytest.mark.parametrize(("x", "y"), [(1.2, 0.4), (0.2, 0.95), (3.0, -2.0)])
def test_a_drone_that_nobody_found_is_no_trunk(x, y):
    p = np.array([0.0, 0.0, 2.0])
    d = rays()
    body = to_cylinder(p, d, x, y, 0.15)
    z = np.where(np.isfinite(body), body, 0.0) * d[..., 2]
    wall = to_planes(p, d, [((1, 0, 0), 6.0), ((0, 0, -1), 0.0)])
    depth = np.minimum(np.where(np.abs(z) < 0.12, body, np.inf), wall)
    assert read(np.minimum(body, wall), p)[0]  # the same with a foot is one
    assert read(depth, p)[0] == []


def test_a_trunk_is_known_from_low_above_the_ground():
    p = np.array([0.0, 0.0, 0.6])
    depth = np.minimum(
        to_cylinder(p, rays(), 2.0, 0.5, 0.3), to_planes(p, rays(), [((0, 0, -1), 0.0)])
    )
    assert [t.radius for t in read(depth, p)[0]] == pytest.approx([0.3], abs=0.1)


def test_a_wall_is_no_trunk_and_the_ground_nothing():
    p = np.array([0.0, 0.0, 2.0])
    trunks, ranges = read(to_planes(p, rays(), [((1, 0, 0), 3.0), ((0, 0, -1), 0.0)]), p)
    assert trunks == []
    directions = CAMERA.scaled(80, 50).directions @ rotation_matrix(CAMERA.mount).T
    met = ranges < 5.0  # as far as surfaces are remembered
    x = (p + directions[met] * ranges[met, None])[:, 0]
    assert x == pytest.approx(3.0, abs=0.05)  # half a pixel off where one of four shows the ground
    assert np.median(x) == pytest.approx(3.0, abs=0.005)
    assert np.isinf(ranges[-1, 40])


def test_a_neighbour_is_neither_wall_nor_free():
    p = np.array([0.0, 0.0, 2.0])
    depth = np.full((100, 160), 7.0)
    depth[48:52, 76:84] = 2.0
    _, ranges = read(depth, p, drones=[Detection(np.array([0, 0, 1.0]), 2.1)])
    assert np.isnan(ranges[24:26, 38:42]).all()
    assert (ranges[:, :30] == 7.0).any()


@pytest.mark.parametrize("value", [np.nan, 0.0, -1.0])
def test_what_the_camera_cannot_tell_is_neither_free_nor_near(value):
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


TUNNEL = [((0, 1, 0), 1.0), ((0, -1, 0), 1.0), ((0, 0, 1), 3.0), ((0, 0, -1), -1.0)]


def test_free_room_in_a_tunnel_is_the_tunnel():
    surfaces = SurfaceMap(CAMERA, SurfaceConfig())
    p = np.array([0.0, 0.2, 2.0])
    for n in range(3):
        _, ranges = read(to_planes(p, rays(), TUNNEL), p)
        surfaces.update(ranges, state(p, time=0.1 * n))
    planes = surfaces.planes(p, p + np.array([5.0, -0.2, 0]), surfaces.points(NO_TRUNKS))
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
    surfaces = SurfaceMap(CAMERA, SurfaceConfig(planes=32, rough=0.0))
    points = rng.uniform(-4, 4, (300, 3))
    planes = surfaces.planes(np.zeros(3), np.array([9.0, 0, 0]), points)
    assert (points @ planes[:, :3].T >= planes[:, 3] - 1e-9).any(axis=1).all()
    assert (planes[:, 3] > 0.0).all()


def test_what_is_gone_is_forgotten_at_once_what_left_the_view_after_a_while():
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


def test_points_of_a_trunk_are_left_to_the_trunk():
    surfaces = SurfaceMap(CAMERA, SurfaceConfig())
    p = np.array([0.0, 0.0, 2.0])
    _, ranges = read(to_cylinder(p, rays(), 3.0, 0.0, 0.8), p)
    for time in (0.0, 0.1):
        surfaces.update(ranges, state(p, time=time))
    assert len(surfaces.points(NO_TRUNKS)) > 5
    assert len(surfaces.points(np.array([[3.0, 0.0, 0.8]]))) == 0


def wall_with_opening():
    """Points 0.1 m apart of a wall across y = 5 m, open for |x| < 1 m, and of the tunnel behind."""
    x, y, z = (np.arange(a, b, 0.1) for a, b in ((1.0, 5.0), (5.0, 8.0), (1.0, 3.0)))
    right = [(a, 5.0, c) for a in x for c in z] + [(1.0, b, c) for b in y for c in z]
    return np.array([(sign * a, b, c) for a, b, c in right for sign in (-1.0, 1.0)])


def test_beside_an_opening_the_way_leads_sideways_to_it():
    surfaces, points = SurfaceMap(CAMERA, SurfaceConfig()), wall_with_opening()
    goal, p = np.array([0.3, 9.5, 2.0]), np.array([1.2, 3.7, 2.0])
    for _ in range(100):
        d = surfaces.lane(p, goal, points, 0.5) - p
        p = p + 0.1 * d / max(np.linalg.norm(d), 0.1)
        assert np.linalg.norm(points[:, :2] - p[:2], axis=1).min() > 0.4
    assert p == pytest.approx(goal, abs=0.1)


def test_a_slanting_way_is_turned_past_the_wall_and_stays_on_its_side():
    surfaces, points = SurfaceMap(CAMERA, SurfaceConfig()), wall_with_opening()
    p = np.array([0.5, 3.6, 2.0])
    d = surfaces.lane(p, np.array([0.95, 9.5, 2.0]), points, 0.4) - p
    at_mouth, at_end = (p[0] + d[0] / d[1] * (y - p[1]) for y in (5.0, 8.0))
    assert 0.2 < at_end <= at_mouth <= 0.6  # who comes the other way has the left side


def test_a_way_that_is_free_or_has_no_other_stays_as_it_is():
    surfaces, points = SurfaceMap(CAMERA, SurfaceConfig()), wall_with_opening()
    goal = np.array([0.0, 9.5, 2.0])
    p = np.array([0.1, 2.0, 2.0])
    assert surfaces.lane(p, goal, points, 0.5) is goal
    assert surfaces.lane(p, goal, np.zeros((0, 3)), 0.5) is goal
    closed = np.array([(0.1 * k, 5.0, 2.0) for k in range(-60, 60)])
    assert surfaces.lane(p, goal, closed, 0.5) is goal
