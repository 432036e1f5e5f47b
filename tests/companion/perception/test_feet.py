"""Obstacles from the network's classes, made here by geometry."""

import numpy as np
import pytest

from companion.perception.camera import Camera
from companion.perception.eyes import SCENE
from companion.perception.feet import FootFinder
from companion.perception.object_fit import FootSettings

CAMERA = Camera.equidistant(640, 400)
HEIGHT = 2.0  # m, of the camera


def gravity(pitch_deg=0.0, roll_deg=0.0):
    """Down in the camera's frame (right, down, forward) of a drone with its nose down by pitch."""
    p, r = np.radians([pitch_deg, roll_deg])
    return np.array([-np.sin(r) * np.cos(p), np.cos(r) * np.cos(p), np.sin(p)])


def classes(down, x, y, radius, top=100.0):
    """Probabilities (2,h,w) of a cylinder at x forward, y right [m] on flat ground."""
    rays = CAMERA.scaled(SCENE[1], SCENE[0]).directions.astype(float)
    axis = np.array([0.0, 0.0, 1.0])
    forward = axis - (axis @ down) * down
    forward /= np.linalg.norm(forward)
    right = np.cross(down, forward)
    f, r, d = rays @ forward, rays @ right, rays @ down
    flat = np.hypot(f, r)
    along = (f * x + r * y) / flat
    off = np.abs(f * y - r * x) / flat
    hit = (off < radius) & (along > 0)
    t = along - np.sqrt(np.maximum(radius**2 - off**2, 0.0))
    drop = t * d / flat  # below the camera, where the ray meets the cylinder
    obstacle = hit & (drop < HEIGHT) & (drop > HEIGHT - top)
    ground = (d > 0) & ~obstacle
    return np.stack([obstacle, ground]).astype(np.float32)


def find(scene, down):
    finder = FootFinder(CAMERA, FootSettings(), SCENE)
    return finder.find(scene, down, HEIGHT), finder.clarity


@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (15.0, -10.0), (-12.0, 20.0)])
@pytest.mark.parametrize(
    ("x", "y", "radius"), [(3.5, 0.5, 0.5), (4.0, -2.0, 0.15), (6.0, 2.0, 1.5)]
)
def test_a_trunk_is_found_at_its_place_at_any_attitude(pitch, roll, x, y, radius):
    down = gravity(pitch, roll)
    (trunk,), clarity = find(classes(down, x, y, radius), down)
    distance = np.hypot(x, y)
    assert trunk.distance - trunk.radius == pytest.approx(distance - radius, rel=0.05)
    assert trunk.radius == pytest.approx(radius, abs=0.06 + 0.05 * radius)
    assert abs(trunk.distance - distance) < 3.0 * trunk.sigma
    assert clarity == pytest.approx(1.0, abs=0.01)


def test_bare_ground_and_what_is_far_below_the_drone_are_no_obstacles():
    down = gravity()
    assert find(classes(down, -5.0, 0.0, 0.5), down)[0] == []
    assert find(classes(down, 3.0, 0.0, 0.5, top=1.3), down)[0] == []
    assert len(find(classes(down, 4.0, 0.0, 0.5, top=1.9), down)[0]) == 1


def behind(scene, low):
    """Both in one picture, the ground where both have it."""
    return np.stack([np.maximum(scene[0], low[0]), np.minimum(scene[1], low[1])])


def test_a_low_object_before_a_trunk_does_not_draw_it_nearer():
    down = gravity()
    trunk, bush = (7.0, 0.3, 0.3), (3.0, 0.0, 0.5)
    (seen,), _ = find(behind(classes(down, *trunk), classes(down, *bush, top=0.6)), down)
    assert not seen.assumed
    assert seen.distance - seen.radius == pytest.approx(np.hypot(7.0, 0.3) - 0.3, rel=0.05)
    # One that reaches the height of flight is what counts, and so is one with no trunk behind it.
    tall = find(behind(classes(down, *trunk), classes(down, *bush, top=1.9)), down)[0]
    assert tall[0].distance - tall[0].radius == pytest.approx(2.5, rel=0.05)
    (alone,), _ = find(classes(down, *bush, top=1.9), down)
    assert alone.distance - alone.radius == pytest.approx(2.5, rel=0.05)


def test_a_soft_foot_is_a_doubtful_distance():
    down = gravity()
    sharp = classes(down, 4.0, 0.0, 0.5)
    soft = sharp.copy()
    for row in range(1, SCENE[0] - 1):
        soft[:, row] = sharp[:, max(row - 2, 0) : row + 3].mean(axis=1)
    (sure,), (unsure,) = find(sharp, down)[0], find(soft, down)[0]
    assert unsure.sigma > 1.3 * sure.sigma
    assert unsure.distance == pytest.approx(sure.distance, rel=0.06)


def test_classes_that_cannot_be_told_apart_are_unclear_and_show_nothing():
    down = gravity()
    found, clarity = find(np.full((2, *SCENE), 1 / 3, np.float32), down)
    assert found == []
    assert clarity < 0.02


def test_no_altitude_or_attitude_shows_nothing():
    finder = FootFinder(CAMERA, FootSettings(), SCENE)
    scene = classes(gravity(), 4.0, 0.0, 0.5)
    assert finder.find(scene, gravity(), np.nan) == []
    assert finder.find(scene, np.full(3, np.nan), HEIGHT) == []


@pytest.mark.parametrize(("pitch", "distance"), [(0.0, 1.4), (-20.0, 2.2), (-20.0, 3.0)])
@pytest.mark.parametrize("radius", [0.12, 0.5])
def test_a_trunk_whose_foot_is_out_of_the_picture_is_near_and_its_distance_doubtful(
    pitch, distance, radius
):
    """Nothing is known of its radius: only the place where it leaves the picture bounds it."""
    down = gravity(pitch)
    (trunk,), _ = find(classes(down, distance, 0.2, radius), down)
    surface = np.hypot(distance, 0.2) - radius
    assert trunk.assumed
    assert abs(trunk.distance - trunk.radius - surface) < 2.5 * trunk.sigma
    assert 0.15 * surface < trunk.sigma < 0.6 * surface
    assert trunk.radius < 2.0 * radius + 0.1
