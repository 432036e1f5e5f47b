"""Seen space: how far around the drone it is known to be free of drones, direction by direction."""

from __future__ import annotations

import numpy as np

from companion.estimation.known_obstacles import KnownObstacles
from companion.perception.view import View
from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.wire.messages import VehicleState

SECTORS = 36  # of 10°: a drone 2 m away is 0.4 m wide, the sector 0.35 m
_LOOK = 2.0  # m: a sector is in view where a point this far off is
_SIDEWAYS = 0.3  # of the way flown: what a sector loses by flying across it


class SeenSpace:
    """Remembers for each sector how far it was free when the camera looked there last."""

    def __init__(self, view: View, reach: float) -> None:
        """reach: m, up to which a look would have shown a drone."""
        self._view, self._reach = view, reach
        angles = 2.0 * np.pi / SECTORS * np.arange(SECTORS)
        self._rays: Vector = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(SECTORS)])
        self._along = self._rays[:, :2].T  # (2,s)
        self._aside = np.column_stack([-self._rays[:, 1], self._rays[:, 0]]).T
        self._looks = _LOOK * self._rays
        self.reset()

    def reset(self) -> None:
        """Forget every look."""
        self._free: Vector = np.zeros(SECTORS)
        self._place: Vector | None = None
        self._time = 0.0

    def update(
        self,
        own: VehicleState,
        looked: VehicleState | None,
        known: KnownObstacles,
        speed: float,
    ) -> Vector:
        """Return how far (s,) m it is free around `own`, in sectors of azimuth from east on.

        looked: the state in which a sound frame was taken; None: there is none. speed: m/s, at
        which a drone that is not seen may come nearer.
        """
        if self._place is not None:
            way, dt = own.p - self._place, max(own.time - self._time, 0.0)
            nearer = np.maximum(self._rays @ way, 0.0) + _SIDEWAYS * norm(way)
            self._free = np.maximum(self._free - nearer - speed * dt, 0.0)
        self._place, self._time = own.p, own.time
        if looked is not None:
            shown = self._view.shows(looked, looked.p + self._looks, margin=0.0)
            far = np.minimum(self._reach, self._to_obstacles(own.p, known))
            self._free = np.where(shown, far, self._free)
        return self._free.copy()

    def _to_obstacles(self, p: Vector, known: KnownObstacles) -> Vector:
        """Return the distance (s,) m from p (3,) to the first obstacle, which hides what follows.

        That a drone behind its edge is not seen does not count where the edge itself is nearer
        than the way: the way keeps clear of the obstacle.
        """
        rows = np.concatenate([known.cylinders, known.occluders])
        if not len(rows):
            return np.full(SECTORS, np.inf)
        off = rows[:, :2] - p[:2]
        along = off @ self._along  # (k,s)
        beside = off @ self._aside
        inside = rows[:, 2:3] ** 2 - beside * beside
        edges = along - np.sqrt(np.maximum(inside, 0.0))
        hit = np.where((inside > 0.0) & (along > 0.0), edges, np.inf)
        nearest: Vector = np.maximum(hit.min(axis=0), 0.0)
        return nearest
