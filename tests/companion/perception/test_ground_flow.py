"""The way over the ground, from corners of the ground and of what stands on it."""

import cv2
import numpy as np
import pytest

from companion.estimation.known_obstacles import KnownObstacles
from companion.perception.camera import Camera
from companion.perception.ground_flow import GroundFlow, hidden_by, way_over_ground
from companion.perception.ground_plane import GroundPlane
from companion.perception.parallax import Parallax
from companion.perception.reduced import Reduced
from companion.perception.view import View
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import VehicleState

WAY = np.array([0.15, -0.04])
HEIGHT = 2.0
CAMERA = Camera.equidistant(640, 400, 160.0)


def rays(points, here):
    to = points - here
    return to / np.linalg.norm(to, axis=1)[:, None]


def looks(points, way=WAY, noise=0.0015, seed=1):
    """Rays to points (n,3) from the two ends of a way, 2 m high, with noise [rad]."""
    rng = np.random.default_rng(seed)
    found = []
    for here in (np.array([0.0, 0.0, HEIGHT]), np.array([*way, HEIGHT])):
        r = rays(points, here) + rng.normal(0.0, noise, (len(points), 3))
        found.append(r / np.linalg.norm(r, axis=1)[:, None])
    return found


def ground(n, seed=2):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(0.5, 4.0, n), rng.uniform(-3.0, 3.0, n), np.zeros(n)])


def bark(n, seed=3):
    """Points of a trunk 1.2 m ahead, below the horizon."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0.7 * np.pi, 1.3 * np.pi, n)
    around = 0.4 * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.column_stack([1.6 + around[:, 0], around[:, 1], rng.uniform(0.2, 1.4, n)])


def test_the_ground_tells_the_way():
    way = way_over_ground(*looks(ground(30)), HEIGHT, HEIGHT)
    assert way == pytest.approx(WAY, abs=0.006)


def test_sloping_ground_tells_the_way():
    plane = GroundPlane(0.0, (0.0, 0.0), (0.1, -0.15))
    points = ground(30)
    points[:, 2] = plane.below(points)
    lower = HEIGHT - plane.below(WAY[None])[0]
    way = way_over_ground(*looks(points), HEIGHT, lower, plane)
    assert way == pytest.approx(WAY, abs=0.008)
    level = way_over_ground(*looks(points), HEIGHT, lower)
    assert level is None or np.abs(level - WAY).max() > 0.015


@pytest.mark.parametrize("seed", range(10))
def test_corners_of_a_trunk_are_outvoted_but_for_its_foot(seed):
    """A foot passes a little faster than the ground behind it: the way is a little too long."""
    points = np.concatenate([ground(20, seed), bark(10, seed)])
    way = way_over_ground(*looks(points, seed=seed), HEIGHT, HEIGHT)
    along, size = WAY / np.linalg.norm(WAY), np.linalg.norm(WAY)
    assert abs(way[0] * along[1] - way[1] * along[0]) < 0.1 * size
    assert 0.95 * size < way @ along < 1.25 * size


@pytest.mark.parametrize("seed", range(10))
def test_a_trunk_that_fills_the_picture_tells_nothing(seed):
    points = np.concatenate([ground(6, seed), bark(30, seed)])
    assert way_over_ground(*looks(points, 3.0 * WAY, seed=seed), HEIGHT, HEIGHT) is None


def test_corners_of_known_trunks_do_not_count():
    """The trunk that fills the picture is known: the ground beside it tells the way."""
    points, here = np.concatenate([ground(14), bark(40)]), np.array([0.0, 0.0, HEIGHT])
    before, after = looks(points)
    assert way_over_ground(before, after, HEIGHT, HEIGHT) is None
    hidden = hidden_by(np.array([[1.6, 0.0, 0.4]]), here[:2], after, HEIGHT)
    assert hidden[14:].all()
    assert hidden[:14].mean() < 0.5
    way = way_over_ground(before[~hidden], after[~hidden], HEIGHT, HEIGHT)
    assert way == pytest.approx(WAY, abs=0.01)
    behind = hidden_by(np.array([[-1.6, 0.0, 0.4]]), here[:2], after, HEIGHT)
    assert not behind.any()


def test_a_trunk_known_at_the_wrong_place_does_not_pass_for_the_ground():
    """Its place is 0.4 m off, and as doubtful."""
    points, here = np.concatenate([ground(14), bark(40)]), np.array([0.0, 0.0, HEIGHT])
    before, after = looks(points)
    known = KnownObstacles(np.array([[1.6, 0.4, 0.4]]), sigmas=np.array([0.2]))
    hidden = hidden_by(known.cylinders, here[:2], after, HEIGHT)
    assert not hidden[14:].all()
    hidden = hidden_by(known.widest, here[:2], after, HEIGHT)
    assert hidden[14:].all()
    way = way_over_ground(before[~hidden], after[~hidden], HEIGHT, HEIGHT)
    assert way is None or way == pytest.approx(WAY, abs=0.01)


def test_too_few_corners_or_too_low_tell_nothing():
    assert way_over_ground(*looks(ground(5)), HEIGHT, HEIGHT) is None
    assert way_over_ground(*looks(ground(30)), 0.3, 0.3) is None
    above = ground(30) + np.array([0.0, 0.0, 4.0])
    assert way_over_ground(*looks(above), HEIGHT, HEIGHT) is None


def test_a_climb_is_no_way():
    points, still = ground(30), np.zeros(2)
    before = rays(points, np.array([0.0, 0.0, 2.0]))
    after = rays(points, np.array([0.0, 0.0, 2.2]))
    assert way_over_ground(before, after, 2.0, 2.2) == pytest.approx(still, abs=1e-9)


def test_a_row_is_the_flow_again():
    flow = GroundFlow(1.0, 1.1, WAY, HEIGHT)
    again = GroundFlow.from_row(np.array(flow.row))
    assert again.row == flow.row
    assert GroundFlow.from_row(None) is None


def picture(own):
    """Textured ground at level 0, and a bright sky."""
    noise = np.random.default_rng(3).uniform(0, 255, (600, 600)).astype(np.float32)
    texture = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2.0), None, 0, 255, cv2.NORM_MINMAX)
    to = CAMERA.directions @ (rotation_matrix(own.q_wb) @ rotation_matrix(CAMERA.mount)).T
    reach = own.p[2] / np.maximum(-to[..., 2], 1e-3)
    u, v = ((own.p[k] + reach * to[..., k]) * 20 % 599 for k in (0, 1))
    grey = cv2.remap(texture, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
    grey[to[..., 2] > -0.05] = 220
    return np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)


def test_pictures_tell_the_way_whatever_the_position_says():
    parallax, ways = Parallax(View(CAMERA, needs_foot=False)), []
    level = np.array([1.0, 0.0, 0.0, 0.0])
    for n in range(12):
        true = np.array([0.12 * n, 0.05 * n, HEIGHT])
        told = true + np.array([0.0, 0.08 * n, 0.0])  # it slides at 0.8 m/s
        state = [VehicleState(0.1 * n, p, np.zeros(3), level, np.zeros(3)) for p in (true, told)]
        parallax.update(Reduced(picture(state[0])), state[1], [])
        if parallax.flow is not None:
            ways.append(parallax.flow.way)
    assert len(ways) >= 8
    assert np.median(ways, axis=0) == pytest.approx([0.12, 0.05], abs=0.01)
