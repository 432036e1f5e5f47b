"""The corridor: the way along walls, and the free room around the drone as half-spaces.

The free room is cut out plane by plane: the nearest surface point gives a half-space, which hides
all points beyond it, and so on. "Nearest" is stretched along the way to the goal, so that the room
reaches ahead (after Liu et al., "Planning dynamically feasible trajectories for quadrotors using
safe flight corridors", 2017).
"""

from __future__ import annotations

import math

import numpy as np

from companion.estimation.surface_map import SurfaceConfig
from mavlink_bridge.shared.arrays import Vector, norm

_PATCH = 0.6  # m around a point in which its surface may be flat
_FLAT = 0.05  # m, 1 σ from flat
_LIKE = 0.9  # cosine between a surface's own normal and the one that is asked for
_CREEP = 0.3  # m ahead, at least, of a place beside
# rad to the left: headings that are tried, the smallest turn first
_TURNS = [0.0, *(sign * 0.05 * n for n in range(1, 9) for sign in (-1.0, 1.0))]
_STEPS = [sign * 0.1 * n for n in range(1, 31) for sign in (-1.0, 1.0)]  # m to the left


def free_heading(p: Vector, goal: Vector, points: Vector, clearance: float, reach: float) -> Vector:
    """Return the goal (3,) m, or a place to fly to first where walls block the straight way.

    From p (3,), the nearest direction is taken in which surface points (n,3) leave `clearance` [m]
    to each side, as far as `reach` [m]. Where there is none, the drone first flies to a place
    beside p from which a way of the same direction is free. The corridor's planes say where
    nothing stands, not where to leave by: against a wall that the way meets squarely, a drone would
    never move towards the opening beside it.
    """
    x, y = (goal[:2] - p[:2]).tolist()
    length = math.hypot(x, y)
    level = points[np.abs(points[:, 2] - p[2]) < clearance] if len(points) else points
    if length < 1e-6 or not len(level):
        return goal
    offsets = level[:, :2] - p[:2]
    reach = min(length, reach)
    for turn in _TURNS:
        c, s = math.cos(turn), math.sin(turn)
        way = np.array([c * x - s * y, s * x + c * y]) / length
        along, aside = offsets @ way, offsets @ np.array([-way[1], way[0]])
        if not ((along > 0.0) & (along < reach) & (np.abs(aside) < clearance)).any():
            return np.array([*(p[:2] + length * way), goal[2]]) if turn else goal
    way, left = np.array([x, y]) / length, np.array([-y, x]) / length
    along, aside = offsets @ way, offsets @ left
    near = (along > -clearance) & (along < reach)
    along, aside = along[near], aside[near]
    ahead = along[(along > 0.0) & (np.abs(aside) < clearance)]
    for step in _STEPS:
        if not (np.abs(aside - step) < clearance).any():
            on = max(float(ahead.min()) - 2.0 * clearance, _CREEP)
            return np.array([*(p[:2] + step * left + on * way), goal[2]])
    return goal


def corridor_planes(p: Vector, goal: Vector, points: Vector, config: SurfaceConfig) -> Vector:
    """Return the free room around p (3,) m towards the goal (3,), cut by surface points (n,3).

    The room is (k,4) half-spaces n·x <= b, nearest first.
    """
    if not len(points):
        return np.zeros((0, 4))
    way = goal - p
    way = way / max(norm(way), 1e-6)
    left = points - p
    made: list[Vector] = []
    while len(left) and len(made) < config.planes:
        along = left @ way
        # Points of equal distance form an ellipsoid, long ahead, round behind.
        shorter = np.where(along > 0.0, 1.0 / config.stretch**2, 1.0) - 1.0
        nearest = int(np.argmin(_squares(left) + shorter * along**2))
        slope = left[nearest] + along[nearest] * shorter[nearest] * way
        length = norm(slope)
        if length < 1e-6:  # in the very place: no side to be on
            left = np.delete(left, nearest, axis=0)
            continue
        normal = _own_normal(left, left[nearest], slope / length)
        reach = float(normal @ left[nearest])
        made.append(np.array([*normal, normal @ p + reach]))
        left = left[left @ normal < reach - config.rough - 1e-9]
    made.sort(key=lambda row: float(row[3] - row[:3] @ p))
    return np.array(made).reshape(-1, 4)


def _squares(offsets: Vector) -> Vector:
    """Return the squared lengths (n,) of offsets (n,3)."""
    squares: Vector = np.einsum("nd,nd->n", offsets, offsets)
    return squares


def _own_normal(points: Vector, at: Vector, normal: Vector) -> Vector:
    """Return the normal of the flat surface around `at` where it is nearly `normal`."""
    around = points[_squares(points - at) < _PATCH**2]
    if len(around) < 4:
        return normal
    spread = around - around.mean(axis=0)
    values, axes = np.linalg.eigh(spread.T @ spread / len(around))
    own: Vector = axes[:, 0] * np.copysign(1.0, axes[:, 0] @ normal)
    flat = values[0] < _FLAT**2 and values[1] > 9.0 * _FLAT**2
    return own if flat and own @ normal > _LIKE else normal
