"""Trunks and ranges from depth images."""

import numpy as np
import pytest

from companion.types import Detection
from mavlink_bridge.shared.frames import rotation_matrix
from tests.companion.depth_images import CAMERA, rays, read, to_cylinder, to_planes


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
def test_an_undetected_drone_is_no_trunk(x, y):
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


def test_a_wall_is_no_trunk_and_the_ground_has_no_range():
    p = np.array([0.0, 0.0, 2.0])
    trunks, ranges = read(to_planes(p, rays(), [((1, 0, 0), 3.0), ((0, 0, -1), 0.0)]), p)
    assert trunks == []
    directions = CAMERA.scaled(80, 50).directions @ rotation_matrix(CAMERA.mount).T
    met = ranges < 5.0  # as far as surfaces are remembered
    x = (p + directions[met] * ranges[met, None])[:, 0]
    assert x == pytest.approx(3.0, abs=0.05)  # half a pixel off where one of four shows the ground
    assert np.median(x) == pytest.approx(3.0, abs=0.005)
    assert np.isinf(ranges[-1, 40])


def test_a_detected_neighbour_is_neither_wall_nor_free():
    p = np.array([0.0, 0.0, 2.0])
    depth = np.full((100, 160), 7.0)
    depth[48:52, 76:84] = 2.0
    _, ranges = read(depth, p, drones=[Detection(np.array([0, 0, 1.0]), 2.1)])
    assert np.isnan(ranges[24:26, 38:42]).all()
    assert (ranges[:, :30] == 7.0).any()
