"""One problem as data: the numbers of one tick, padded to the sizes of the config."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from companion.control.nmpc.config import NmpcConfig
from mavlink_bridge.shared.arrays import Vector

_SLOW = 0.1  # m/s, below which a relative velocity has no direction


class Neighbour(NamedTuple):
    """A neighbour to keep away from and, by `cohesion` 0…1, to stay with.

    p (3,) m, v (3,) m/s: world ENU. sigma: 1σ of p [m] and v [m/s] along one axis.
    """

    p: ArrayLike
    v: ArrayLike
    sigma: tuple[float, float] = (0.0, 0.0)
    cohesion: float = 1.0


@dataclass(frozen=True)
class Instance:
    """One problem, world ENU, SI. `active` flags are 0 or 1; inactive rows have no effect.

    x0 (10,): p, v, q when the input takes effect. u_last (4,): c, omega, the last sent. goal (3,)
    m. speed: m/s, C of (18). v_max: m/s, of (32). yaw: rad, line of sight (7). neighbour_p,
    neighbour_v (J,3), neighbour_sigma (J,2), neighbour_cohesion (J,): as `Neighbour`. cylinders
    (K,3) m: x, y, radius. planes (H,4): n, b; free where n·p <= b, |n| = 1. disturbance (3,) m/s²:
    acceleration that the model lacks (wind, drag). J, K, H are sizes of the config.
    """

    x0: Vector
    u_last: Vector
    goal: Vector
    speed: float
    v_max: float
    yaw: float
    neighbour_p: Vector
    neighbour_v: Vector
    neighbour_sigma: Vector
    neighbour_cohesion: Vector
    neighbour_active: Vector
    cylinders: Vector
    cylinder_active: Vector
    planes: Vector
    plane_active: Vector
    disturbance: Vector = field(default_factory=lambda: np.zeros(3))

    def finite(self) -> bool:
        """Return whether every number is finite, inactive rows included."""
        return all(bool(np.all(np.isfinite(getattr(self, f.name)))) for f in fields(self))

    def past_other_side(self, j: int, p: Vector, time: float, by: float) -> Instance:
        """Return the instance with room past the other side of neighbour j than at p (3,) m.

        p: of a plan at `time` [s]. There the neighbour is moved by `by` [m] to the side on which
        the plan passes it, across its velocity relative to the drone's, or across its bearing.
        """
        way = self.neighbour_v[j] - self.x0[3:6]
        if math.hypot(way[0], way[1]) < _SLOW:
            way = self.neighbour_p[j] - self.x0[:3]
        across = np.array([-way[1], way[0], 0.0]) / max(math.hypot(way[0], way[1]), 1e-6)
        passed = across @ (p - self.neighbour_p[j] - time * self.neighbour_v[j])
        moved = self.neighbour_p.copy()
        moved[j] += math.copysign(by, passed) * across
        return replace(self, neighbour_p=moved)


def make_instance(
    config: NmpcConfig,
    *,
    x0: ArrayLike,
    u_last: ArrayLike,
    goal: ArrayLike,
    yaw: float,
    speed: float | None = None,
    v_max: float | None = None,
    neighbours: Sequence[Neighbour] = (),
    cylinders: ArrayLike = (),
    planes: ArrayLike = (),
    disturbance: ArrayLike = (0.0, 0.0, 0.0),
) -> Instance:
    """Return an instance from lists of any length: the first rows of each, the rest inactive.

    The most critical neighbour and the nearest obstacle come first. speed, v_max: m/s, by default
    those of the config.
    """
    near = list(neighbours)[: config.neighbours]
    p, v = (
        _rows(np.array([n[i] for n in near], dtype=float), config.neighbours, 3)[0] for i in (0, 1)
    )
    sigma, active = _rows([n.sigma for n in near], config.neighbours, 2)
    cohesion, _ = _rows([[n.cohesion] for n in near], config.neighbours, 1)
    padded_cylinders, cylinder_active = _rows(cylinders, config.cylinders, 3)
    padded_planes, plane_active = _rows(planes, config.planes, 4)
    return Instance(
        x0=np.array(x0, dtype=float),
        u_last=np.array(u_last, dtype=float),
        goal=np.array(goal, dtype=float),
        speed=float(config.speed if speed is None else speed),
        v_max=float(config.v_max if v_max is None else v_max),
        yaw=float(yaw),
        neighbour_p=p,
        neighbour_v=v,
        neighbour_sigma=sigma,
        neighbour_cohesion=cohesion[:, 0],
        neighbour_active=active,
        cylinders=padded_cylinders,
        cylinder_active=cylinder_active,
        planes=padded_planes,
        plane_active=plane_active,
        disturbance=np.array(disturbance, dtype=float),
    )


def _rows(values: ArrayLike, count: int, width: int) -> tuple[Vector, Vector]:
    """Return the first `count` rows of `values`, zero-padded, and the flags of given rows."""
    given = np.asarray(values, dtype=float).reshape(-1, width)[:count]
    padded = np.zeros((count, width))
    padded[: len(given)] = given
    active = np.zeros(count)
    active[: len(given)] = 1.0
    return padded, active
