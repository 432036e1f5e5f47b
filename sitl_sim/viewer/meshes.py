"""Shapes of drones, trunks and fields of view: vertices (n,3) m and faces (m,3)."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

Mesh = tuple[NDArray[np.float32], NDArray[np.uint32]]
_SIDES = 20


def cylinder() -> Mesh:
    """Return a cylinder of radius 1 from z = 0 to 1, closed above."""
    angle = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    low = np.column_stack([ring, np.zeros(_SIDES)])
    points = np.vstack([low, low + np.array([0.0, 0.0, 1.0]), [[0.0, 0.0, 1.0]]])
    a = np.arange(_SIDES)
    b = (a + 1) % _SIDES
    wall = np.vstack(
        [np.column_stack([a, b, a + _SIDES]), np.column_stack([b, b + _SIDES, a + _SIDES])]
    )
    lid = np.column_stack([a + _SIDES, b + _SIDES, np.full(_SIDES, 2 * _SIDES)])
    return _mesh(points, np.vstack([wall, lid]))


def quadrotor(radius: float) -> Mesh:
    """Return a body with four propeller discs and a nose towards +x; radius: to a tip [m]."""
    disc, reach = 0.42 * radius, 0.58 * radius / np.sqrt(2)
    parts = [_box([0, 0, 0], [0.6 * radius, 0.4 * radius, 0.3 * radius])]
    parts.append(_box([0.6 * radius, 0, 0], [0.7 * radius, 0.12 * radius, 0.12 * radius]))
    rotor, faces = cylinder()
    for x, y in itertools.product((-reach, reach), repeat=2):
        rim = rotor * np.array([disc, disc, 0.12 * radius]) + np.array([x, y, 0.1 * radius])
        parts.append((rim, faces.astype(int)))
    return _joined(parts)


def view_fan(half_angle: float, reach: float) -> Mesh:
    """Return a horizontal slice of a field of view around +x."""
    angle = np.linspace(-half_angle, half_angle, _SIDES)
    rim = reach * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(_SIDES)])
    faces = [[0, 1 + k, 2 + k] for k in range(_SIDES - 1)]
    return _mesh(np.vstack([[0.0, 0.0, 0.0], rim]), np.array(faces))


def _box(centre: list[float], size: list[float]) -> tuple[NDArray[np.float64], NDArray[np.int_]]:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([f for a, b, c, d in quads for f in ([a, b, c], [a, c, d])])
    return corners * size + centre, faces


def _joined(parts: list[tuple[NDArray[np.float64], NDArray[np.int_]]]) -> Mesh:
    points, faces, start = [], [], 0
    for p, f in parts:
        points.append(p)
        faces.append(f + start)
        start += len(p)
    return _mesh(np.vstack(points), np.vstack(faces))


def _mesh(points: NDArray[np.float64], faces: NDArray[np.int_]) -> Mesh:
    return points.astype(np.float32), faces.astype(np.uint32)
