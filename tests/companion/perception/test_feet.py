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


def leaning(down, x, y, radius, lean_deg):
    """Probabilities (2,h,w) of a trunk that leans to the right by lean_deg, its foot at x, y."""
    rays = CAMERA.scaled(SCENE[1], SCENE[0]).directions.astype(float)
    slope = np.tan(np.radians(lean_deg))
    axis = np.array([0.0, 0.0, 1.0]) - down[2] * down
    forward = axis / np.linalg.norm(axis)
    f, r, d = rays @ forward, rays @ np.cross(down, forward), rays @ down
    flat = np.hypot(f, r)
    drop = d / flat * np.hypot(x, y)
    for _ in range(3):  # the height at which a ray meets it moves the axis, and this the height
        aside = y + slope * (HEIGHT - drop)
        along, off = (f * x + r * aside) / flat, (f * aside - r * x) / flat
        t = along - np.sqrt(np.maximum(radius**2 - off**2, 0.0))
        drop = np.clip(t * d / flat, -3.0, HEIGHT)
    obstacle = (np.abs(off) < radius) & (along > 0) & (t * d / flat < HEIGHT)
    return np.stack([obstacle, (d > 0) & ~obstacle]).astype(np.float32)


@pytest.mark.parametrize("lean_deg", [-12.0, -6.0, 6.0, 12.0])
def test_a_leaning_trunk_is_one_and_stands_where_it_passes_the_height_of_the_camera(lean_deg):
    down = gravity()
    found, _ = find(leaning(down, 4.0, 0.5, 0.25, lean_deg), down)
    (trunk,) = found
    aside = 0.5 + HEIGHT * np.tan(np.radians(lean_deg))
    azimuth = np.arctan2(trunk.direction[0], trunk.direction[2])
    assert azimuth == pytest.approx(np.arctan2(aside, 4.0), abs=np.radians(1.5))
    assert trunk.distance - trunk.radius == pytest.approx(3.78, rel=0.12)
    assert trunk.radius == pytest.approx(0.25, abs=0.1)


def test_a_foot_just_above_the_picture_s_edge_is_measured():
    down = gravity()
    seen = {}
    for distance in np.arange(1.7, 2.4, 0.05):
        (trunk,), _ = find(classes(down, distance + 0.2, 0.0, 0.2), down)
        seen[distance] = trunk
    measured = [distance for distance, trunk in seen.items() if not trunk.assumed]
    assert min(measured) < 1.95  # 1.7 m is at the edge; two rows of the panorama are 1.5°
    for distance in measured:
        trunk = seen[distance]
        assert trunk.distance - trunk.radius == pytest.approx(distance, rel=0.06)


@pytest.mark.parametrize("radius", [0.15, 0.4])
def test_a_trunk_without_a_foot_is_as_thick_as_those_beside_it(radius):
    down = gravity()
    near = classes(down, 1.3, 0.3, radius)
    alone = find(near, down)[0][0]
    scene = near
    for place in ((5.0, -3.0), (6.0, 3.5)):
        scene = behind(scene, classes(down, *place, radius))
    beside = find(scene, down)[0][0]
    surface = np.hypot(1.3, 0.3) - radius
    assert beside.assumed
    assert alone.assumed
    assert abs(beside.distance - beside.radius - surface) < 0.25 * surface
    assert beside.radius == pytest.approx(radius, rel=0.3)
    assert beside.sigma < alone.sigma


def test_a_trunk_that_the_picture_s_side_cuts_may_be_wider_than_it_shows():
    down = gravity()
    azimuth = np.radians(79.0)  # the picture ends at 80°
    x, y = 2.0 * np.cos(azimuth), 2.0 * np.sin(azimuth)
    scene = classes(down, x, y, 0.4)
    for place in ((5.0, -3.0), (6.0, 3.5)):
        scene = behind(scene, classes(down, *place, 0.4))
    trunk = find(scene, down)[0][0]
    assert trunk.assumed
    assert trunk.half_width == 0.0
    found = np.arctan2(trunk.direction[0], trunk.direction[2])
    shown = (azimuth - np.arcsin(0.2) + np.radians(80.0)) / 2  # the middle of what shows
    assert found > shown + np.radians(1.0)
    assert abs(found - azimuth) < 0.5 * np.arcsin(0.2)


def test_a_trunk_right_behind_a_low_object_is_farther_than_its_foot():
    down = gravity()
    bush = classes(down, 2.7, 0.0, 0.5, top=0.9)
    # Its foot, at 3.6 m, is hidden: over the bush the ground shows from 4 m.
    (trunk,), _ = find(behind(classes(down, 3.8, 0.0, 0.2), bush), down)
    assert trunk.assumed
    assert 2.4 < trunk.distance - trunk.radius < 4.2
    assert abs(trunk.distance - trunk.radius - 3.6) < 2.5 * trunk.sigma
    # The bush alone is none.
    assert find(bush, down)[0] == []


def test_an_obstacle_that_is_broken_in_the_middle_is_one():
    down = gravity()
    scene = classes(down, 4.0, 0.0, 1.0)
    middle = np.s_[:, :50, 78:82]  # down to the horizon and somewhat below: neither
    scene[middle] = 0.0
    (trunk,), _ = find(scene, down)
    assert trunk.distance - trunk.radius == pytest.approx(3.0, rel=0.06)
    assert trunk.radius == pytest.approx(1.0, rel=0.15)
