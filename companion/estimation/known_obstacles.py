"""Obstacles that the drone knows: trunks and other surfaces, seen or remembered."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from companion.estimation.obstacle_map import ObstacleConfig, ObstacleMap
from companion.estimation.own_doubt import OwnDoubt
from companion.estimation.parallax_map import ParallaxMap, doubted, with_others
from companion.estimation.surface_map import SurfaceConfig, SurfaceMap
from companion.perception.frontend import Detections
from companion.perception.ground_plane import LEVEL, GroundPlane
from companion.perception.view import View
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.distance import to_ways
from mavlink_bridge.wire.messages import VehicleState


@dataclass(frozen=True)
class KnownObstacles:
    """What stands in the drone's own ENU frame.

    cylinders: (K,3) x, y, radius [m] of confirmed trunks, nearest first; sigmas: (K,) m, 1 σ of
    their places. points: (P,3) m, surface points of other shapes. occluders: (J,3) x, y, radius [m]
    of all trunks, unconfirmed ones too. blank: whether the eyes show none where one is known.
    upsets: how many known trunks have moved or vanished in the last 20 s, see `map_upsets.py`.
    """

    cylinders: Vector = field(default_factory=lambda: np.zeros((0, 3)))
    points: Vector = field(default_factory=lambda: np.zeros((0, 3)))
    occluders: Vector = field(default_factory=lambda: np.zeros((0, 3)))
    sigmas: Vector = field(default_factory=lambda: np.zeros(0))
    blank: bool = False
    upsets: int = 0

    @property
    def widest(self) -> Vector:
        """(K,3) x, y, radius [m] of the trunks with all that may be theirs: radii 2 σ larger."""
        widened = self.cylinders.copy()
        widened[:, 2] += 2.0 * self.sigmas
        return widened

    def hidden(self, viewpoint: Vector, places: Vector, beside: float = 0.0) -> list[bool]:
        """Return whether a trunk stands between viewpoint (3,) and each place (n,3) m; eq. (6).

        beside: m from a trunk's bark at which it counts as hiding what is behind.
        """
        if not len(self.occluders) or not len(places):
            return [False] * len(places)
        gaps = to_ways(self.occluders[:, :2], viewpoint[:2], places[:, :2])
        behind = np.asarray((gaps < self.occluders[:, 2] + beside).any(axis=1))
        found: list[bool] = behind.tolist()
        return found


class ObstacleEstimator:
    """Remembers the trunks and surfaces of every frame."""

    def __init__(self, view: View, trunks: ObstacleConfig, surfaces: SurfaceConfig) -> None:
        self._view = view
        self._configs = trunks, surfaces
        self.reset()

    def reset(self) -> None:
        """Forget all obstacles: the vehicle's frame has begun anew."""
        trunks, surfaces = self._configs
        self._map = ObstacleMap(trunks)
        self._looked: float | None = None  # s, when trunks were looked for last
        self._pictured: float | None = None  # s, when the last picture was taken
        self._surfaces = SurfaceMap(self._view.camera, surfaces)
        self._parallax = ParallaxMap()

    def turn(self, p: Vector, angle: float) -> None:
        """Turn all that is remembered left about p (3,) m by a small `angle` [rad].

        A depth camera's surfaces are left: each frame shows them anew.
        """
        self._map.turn(p, angle)
        self._parallax.turn(p, angle)

    def update(
        self,
        seen: Detections,
        own: VehicleState | None,
        doubt: OwnDoubt,
        ground: GroundPlane = LEVEL,
    ) -> KnownObstacles:
        """Take in one frame's detections; return what is known around the own state now.

        doubt: of the own state.
        """
        if seen.own is not None:
            if seen.searched:
                at_capture, ranges = seen.own, seen.ranges
                since = 0.0 if self._looked is None else seen.time - self._looked
                self._looked = seen.time
                self._map.update(
                    seen.trunks,
                    at_capture,
                    self._view.mount,
                    self._view.half_view,
                    visibility=lambda places: self._view.visibility(at_capture, places, ranges),
                    drift=doubt.drift(since),
                    ground=ground,
                    depth=ranges is not None,
                )
            if seen.ranges is not None:
                self._surfaces.update(seen.ranges, seen.own)
            fixed = doubted(seen.fixed, seen.own.p, doubt.drift(1.0))
            self._map.see_through(seen.own.p, fixed, ground)
            pictured = 0.0 if self._pictured is None else seen.own.time - self._pictured
            self._pictured = seen.own.time
            drift = doubt.drift(pictured)
            self._parallax.update(fixed, seen.own.p, seen.own.time, ground, drift)
        occluders, blank = self._map.occluders(), self._map.blank
        upsets = self._map.upsets(seen.time)
        if own is None:
            return KnownObstacles(occluders=occluders, blank=blank, upsets=upsets)
        standing = self._parallax.standing()
        known = with_others(self._map.doubted_cylinders(own.p), standing.cylinders, own.p)
        points = np.concatenate([self._surfaces.points(known[:, :3]), standing.points])
        return KnownObstacles(known[:, :3], points, occluders, known[:, 3], blank, upsets)
