"""Finds of neighbours against the depth image of the same view."""

import numpy as np
import pytest

from companion.perception.depth_finds import DepthCheck
from companion.types import Detection
from tests.companion.depth_images import CAMERA, rays, to_planes

P = np.array([0.0, 0.0, 2.0])
GROUND = ((0, 0, -1), 0.0)
RIGHT = CAMERA.unproject(np.array([[420.0, 195.0]]))[0]  # a little right of ahead


def body(p, hull=0.12):
    """Range [m] to a body of radius `hull` at p (3,) m, world axes; inf beside it."""
    d, off = rays(), p - P
    along = d @ off
    root = hull**2 - (off @ off - along**2)
    return np.where((root > 0) & (along > 0), along - np.sqrt(np.maximum(root, 0)), np.inf)


def world(direction, distance):
    """Place (3,) m of what is in that direction of the camera frame."""
    x, y, z = direction
    return P + distance * np.array([z, -x, -y])


def checked(depth, *drones, farthest=8.0):
    return DepthCheck(CAMERA, farthest).checked(drones, depth.astype(np.float32))


WALL = to_planes(P, rays(), [((1, 0, 0), 4.0), GROUND])


@pytest.mark.parametrize("distance", [0.8, 1.5, 2.5])
@pytest.mark.parametrize("told", [0.8, 1.0, 1.25])
def test_a_drone_gets_the_range_that_depth_shows(distance, told):
    depth = np.minimum(WALL, body(world(RIGHT, distance)))
    find = Detection(RIGHT, told * distance, 0.01, 0.15 * distance, 0.9)
    (found,) = checked(depth, find)
    assert found.range == pytest.approx(distance - 0.12, abs=0.05)
    assert found.sigma_range < 0.12
    assert found.direction is find.direction
    assert found.score == 0.9


def opening():
    """A wall 3 m ahead with an opening to the right, 8 m behind which stands another."""
    d = rays()
    near, far = (to_planes(P, d, [((1, 0, 0), b), GROUND]) for b in (3.0, 8.0))
    y, z = (near * d[..., k] for k in (1, 2))
    middle = 3.0 / RIGHT[2] * np.array([-RIGHT[0], -RIGHT[1]])
    hole = (np.abs(y - middle[0]) < 0.4) & (np.abs(z - middle[1]) < 0.4)
    return np.where(hole, far, near)


TRUNK = np.where(np.abs(np.arange(160) - 105) < 4, 2.0, 6.0) * np.ones((100, 1))
SKY = to_planes(P, rays(), [GROUND])
DARK = np.full((100, 160), np.inf)


@pytest.mark.parametrize(
    ("depth", "distance"),
    [(WALL, 1.0), (WALL, 3.9), (opening(), 0.9), (TRUNK, 2.0), (SKY, 2.0)],
    ids=["before a wall", "on a wall", "an opening", "on a trunk", "in the sky"],
)
def test_what_does_not_stand_out_is_no_drone(depth, distance):
    assert checked(depth, Detection(RIGHT, distance, 0.01, 0.15 * distance)) == []


def test_what_stands_out_at_another_distance_is_not_the_find():
    depth = np.minimum(WALL, body(world(RIGHT, 2.5)))
    assert checked(depth, Detection(RIGHT, 1.0, 0.01, 0.15)) == []


def test_two_finds_of_one_drone_are_one():
    depth = np.minimum(WALL, body(world(RIGHT, 1.5)))
    near, far = Detection(RIGHT, 1.3, 0.01, 0.2), Detection(RIGHT, 1.9, 0.01, 0.4)
    assert len(checked(depth, far, near)) == 1


HOLE = np.where((np.abs(np.arange(160) - 105) < 5) * (np.arange(160) % 4 > 0), np.nan, WALL)


@pytest.mark.parametrize(
    ("depth", "farthest"),
    [(np.full((100, 160), np.nan), 8.0), (HOLE, 8.0), (DARK, 8.0), (WALL, 2.0)],
    ids=["unknown", "a hole", "nothing at all", "too far"],
)
def test_where_depth_cannot_tell_a_find_stays(depth, farthest):
    find = Detection(RIGHT, 1.9, 0.01, 0.3)
    assert checked(depth, find, farthest=farthest) == [find]


def test_a_find_whose_middle_is_out_of_the_picture_stays():
    beside = CAMERA.unproject(np.array([[665.0, 200.0]]))[0]
    find = Detection(beside, 2.0, 0.01, 0.3)
    assert checked(WALL, find) == [find]
