"""The input of a velocity rule: an instance seen from the drone, in the horizontal plane."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from companion.control.nmpc import Instance, NmpcConfig
from mavlink_bridge.shared.arrays import Vector

_WALL = 0.5  # |n_z| of a plane below which it stands like a wall
_NEAREST = 0.02  # m; nearer surfaces count as this far


@dataclass(frozen=True)
class Surroundings:
    """Horizontal positions relative to the drone, and velocities, in world axes; m, m/s.

    v (2,): own velocity. migration (2,): velocity towards the goal, slower near it and where the
    view or the crowd demands. fastest: largest speed that may be flown, as for the NMPC. neighbours
    (k,2); velocities (k,2) and cohesion (k,) 0…1: theirs. trunks (c,3): x, y, radius. walls (h,3):
    n_x, n_y, b; free while n·d <= b. surfaces (c+h,2): nearest point of each of them.
    """

    v: Vector
    migration: Vector
    fastest: float
    neighbours: Vector
    velocities: Vector
    cohesion: Vector
    trunks: Vector
    walls: Vector
    surfaces: Vector

    @classmethod
    def of(cls, instance: Instance, config: NmpcConfig, level: float) -> Self:
        """Return the surroundings in an instance, without neighbours `level` [m] above or below.

        A rule in the plane would flee from a drone that has landed.
        """
        p, v = instance.x0[:2], instance.x0[3:5]
        there = instance.neighbour_active > 0.5
        there &= np.abs(instance.neighbour_p[:, 2] - instance.x0[2]) < level
        e = instance.goal[:2] - p
        trunks = instance.cylinders[instance.cylinder_active > 0.5].copy()
        trunks[:, :2] -= p
        planes = instance.planes[instance.plane_active > 0.5]
        upright = planes[np.abs(planes[:, 2]) < _WALL]
        length = np.linalg.norm(upright[:, :2], axis=1)
        room = (upright[:, 3] - upright[:, :3] @ instance.x0[:3]) / length
        walls = np.column_stack([upright[:, :2] / length[:, None], room])
        return cls(
            v=v,
            migration=instance.speed * e / np.sqrt(e @ e + config.goal_smoothing**2),
            fastest=instance.v_max,
            neighbours=instance.neighbour_p[there, :2] - p,
            velocities=instance.neighbour_v[there, :2],
            cohesion=instance.neighbour_cohesion[there],
            trunks=trunks,
            walls=walls,
            surfaces=np.vstack([_nearest_of_trunks(trunks), _scaled(walls[:, :2], walls[:, 2])]),
        )


def turned_right(v: Vector, angle: float) -> Vector:
    """Return v (2,) turned right by `angle` [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * v[0] + s * v[1], c * v[1] - s * v[0]])


def _nearest_of_trunks(trunks: Vector) -> Vector:
    """Return the nearest surface point (c,2) m of each trunk (c,3)."""
    distance = np.linalg.norm(trunks[:, :2], axis=1)
    return _scaled(trunks[:, :2] / np.maximum(distance, 1e-6)[:, None], distance - trunks[:, 2])


def _scaled(directions: Vector, lengths: Vector) -> Vector:
    """Return the points (k,2) m at lengths (k,), at least _NEAREST, along directions (k,2)."""
    points: Vector = directions * np.maximum(lengths, _NEAREST)[:, None]
    return points
