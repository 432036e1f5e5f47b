"""Distances by parallax: from rays of known points, and from pictures of a textured room."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from companion.perception.camera import Camera
from companion.perception.inverse_distance import refined
from companion.perception.parallax import Parallax
from companion.perception.reduced import Reduced
from companion.perception.view import View
from companion.types import Detection
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import VehicleState

CAMERA = Camera.equidistant(320, 200, 160.0)
WALL = 6.0  # m north of the start, upright, endless


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@pytest.mark.parametrize("distance", [1.5, 4.0, 12.0])
def test_a_point_passed_abeam_is_placed_by_the_own_motion(distance):
    rng = np.random.default_rng(0)
    point, first = np.array([1.0, distance, 0.5]), np.zeros(3)
    inverse, variance = np.array([0.15]), np.array([0.15**2])
    ray = unit(point - first)[None]
    for x in np.arange(0.15, 2.1, 0.15):
        here = np.array([x, 0.0, 0.0])
        now = unit(point - here + 0.002 * distance * rng.normal(size=3))[None]
        inverse, variance, fits = refined((first - here)[None], ray, now, inverse, variance, 0.004)
        assert fits.all()
    true = 1 / np.linalg.norm(point)
    assert inverse[0] == pytest.approx(true, abs=4 * np.sqrt(variance[0]))
    assert inverse[0] == pytest.approx(true, rel=0.1)


def test_a_point_that_moves_across_its_line_does_not_fit():
    moved, ray = np.array([[-0.3, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    now = unit(np.array([[-0.3, 5.0, 0.4]]))
    assert not refined(moved, ray, now, np.array([0.2]), np.array([0.01]), 0.004)[2].all()


def own_state(x, yaw=np.pi / 2):
    q = Rotation.from_euler("z", yaw).as_quat()[[3, 0, 1, 2]]
    return VehicleState(0.0, np.array([x, 0.0, 2.0]), np.array([1.5, 0, 0]), q, np.zeros(3))


def wall_picture(own):
    """A textured wall at y = WALL, from the ground to the sky."""
    noise = np.random.default_rng(3).uniform(0, 255, (600, 600)).astype(np.float32)
    texture = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2.0), None, 0, 255, cv2.NORM_MINMAX)
    rays = CAMERA.directions @ (rotation_matrix(own.q_wb) @ rotation_matrix(CAMERA.mount)).T
    along = WALL / np.maximum(rays[..., 1], 1e-3)
    u = (own.p[0] + along * rays[..., 0]) * 20 % 599
    v = (own.p[2] + along * rays[..., 2]) * 20 % 599
    grey = cv2.remap(texture, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
    return np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)


def flown(drones=()):
    parallax = Parallax(View(CAMERA, needs_foot=False))
    for n in range(14):
        own = own_state(0.15 * n)
        found = parallax.update(Reduced(wall_picture(own)), own, list(drones))
    return found


def test_a_wall_is_where_it_stands():
    found = flown()
    assert len(found.names) > 40
    off = np.abs(found.places[:, 1] - WALL)
    assert np.median(off) < 0.15
    assert np.mean(off < 4 * found.sigmas + 0.1) > 0.9


def test_what_moves_with_a_neighbour_is_no_fixed_point():
    ahead = Detection(np.array([0.0, 0.0, 1.0]), 0.5, 0.01, 0.05)
    rays = unit(flown([ahead]).places - own_state(0.15 * 13).p)
    assert rays[:, 1].max() < np.cos(0.75)


def test_a_drone_that_hovers_knows_no_distance():
    parallax = Parallax(View(CAMERA, needs_foot=False))
    own = own_state(0.0)
    for _ in range(10):
        found = parallax.update(Reduced(wall_picture(own)), own, [])
    assert not len(found.names)


def test_corners_that_left_the_picture_hinder_no_search_for_new_ones():
    parallax = Parallax(View(CAMERA, needs_foot=False))
    picture = Reduced(wall_picture(own_state(0.0)))
    parallax.update(picture, own_state(0.0), [])
    for u, v in ((322.0, 100.0), (-3.0, 203.0)):
        corners = parallax._corners[np.arange(len(parallax._corners)) < 5]
        corners.pixels[0] = u, v
        parallax._corners = corners
        parallax._refill(
            Reduced(wall_picture(own_state(0.0))).grey(320, 200), np.zeros(3), np.eye(3)
        )
        assert len(parallax._corners) > 50
