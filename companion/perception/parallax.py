"""Parallax: the distance of corners of the picture, from the drone's own known motion alone.

Corners are followed from picture to picture (Lucas and Kanade), the search beginning where pose and
depth predict them. Each has a filter of its inverse distance from where it was first seen: metric
scale comes from the own motion, nothing from colour, shape or size (Forster et al., "SVO",
ICRA 2014; Civera et al., "Inverse depth parametrization for monocular SLAM", 2008). A corner that
moves across its epipolar line is no fixed point, and is dropped.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.perception.ground_flow import STEEP, GroundFlow, hidden_by, way_over_ground
from companion.perception.ground_plane import LEVEL, GroundPlane
from companion.perception.inverse_distance import NEAREST, refined
from companion.perception.reduced import Reduced
from companion.perception.view import View
from companion.types import Detection
from mavlink_bridge.shared.arrays import Vector, cross, lengths
from mavlink_bridge.wire.messages import VehicleState

_WIDTH = 320  # px of the reduced picture
_CORNERS = 120
_QUALITY, _APART = 0.01, 6  # of a corner against the best one; px between corners
_AROUND = np.ones((2 * _APART + 1, 2 * _APART + 1), np.uint8)
_SOUGHT = 500  # corners, of which those are taken that stand in the way
_LEVEL = 0.4  # sine of the angle from the horizon, within which things stand in the way
# New corners are sought where no more than these are followed, in every second picture: in those in
# which trunks are not, by default, so that no tick has both to do.
_FEW, _REFILL = 96, 2
_LONGEST = 0.35  # s between two pictures in which corners are followed
_WINDOW = (9, 9)  # px around a corner; with more, an edge of the background moves along
_ENOUGH = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 10, 0.03)  # steps; px, of the last one
_MARGIN = 3.0  # px from the picture's edge
_PIXEL = 0.35  # px, 1 σ of a followed corner
_ATTITUDE = 0.004  # rad, 1 σ of the own attitude from picture to picture
_PRIOR = (0.15, 0.15)  # 1/m, inverse distance of a new corner and its 1 σ
_LOST = 20.0  # grey levels by which a corner may change
_LEAST_PARALLAX = 0.035  # rad, seen from first to now: less is attitude noise
SURE = 0.15  # 1 σ over distance of a point that counts
_DRONE = 0.4  # m, radius within which corners belong to a detected neighbour
_NEAR_TRUNKS = 5  # known trunks that may hide the ground
_NO_TRUNKS: Vector = np.zeros((0, 3))


@dataclass(frozen=True)
class FixedPoints:
    """Points of the world whose distance is known by parallax.

    places: (n,3) m, own ENU frame. sigmas: (n,) m, along the line of sight, were the own motion
    known without error. names: (n,) the corner that each is; a corner lost and found again has a
    new name. bases: (n,) m that the drone has moved across the line of sight since the first look.
    since: (n,) s, since then.
    """

    places: Vector
    sigmas: Vector
    names: NDArray[np.int64]
    bases: Vector
    since: Vector

    def __getitem__(self, kept: NDArray[np.bool_]) -> FixedPoints:
        which = kept.nonzero()[0]
        return FixedPoints(
            self.places.take(which, axis=0),
            self.sigmas.take(which),
            self.names.take(which),
            self.bases.take(which),
            self.since.take(which),
        )

    @property
    def rows(self) -> Vector:
        """(n,7) x, y, z, sigma, name, base, since."""
        return np.column_stack([self.places, self.sigmas, self.names, self.bases, self.since])

    @staticmethod
    def from_rows(rows: Vector | None) -> FixedPoints:
        """Return the points of rows (n,7); None: no points.

        Older logs have rows (n,5): their own motion counts as known.
        """
        if rows is None:
            return FixedPoints.none()
        if rows.shape[1] == 5:
            rows = np.hstack([rows, np.tile([1.0, 0.0], (len(rows), 1))])
        names = rows[:, 4].astype(np.int64)
        return FixedPoints(rows[:, :3], rows[:, 3], names, rows[:, 5], rows[:, 6])

    @staticmethod
    def none() -> FixedPoints:
        """Return no points."""
        return _NO_POINTS


_NO_POINTS = FixedPoints.from_rows(np.zeros((0, 7)))


@dataclass(frozen=True)
class _Corners:
    """The corners that are followed.

    pixels (n,2), sights (n,3): where they are in the newest picture, and their rays there, camera
    frame. origins (n,3) m, rays (n,3): first look, own ENU frame. inverse (n,) 1/m, and its
    variance (n,). names (n,). first (n,): s, time of the first look.
    """

    pixels: NDArray[np.float32]
    sights: Vector
    origins: Vector
    rays: Vector
    inverse: Vector
    variance: Vector
    names: NDArray[np.int64]
    first: Vector

    def __getitem__(self, kept: NDArray[np.bool_]) -> _Corners:
        which = kept.nonzero()[0]
        if len(which) == len(kept):
            return self
        return _Corners(
            self.pixels.take(which, axis=0),
            self.sights.take(which, axis=0),
            self.origins.take(which, axis=0),
            self.rays.take(which, axis=0),
            self.inverse.take(which),
            self.variance.take(which),
            self.names.take(which),
            self.first.take(which),
        )

    def __len__(self) -> int:
        return len(self.inverse)

    @cached_property
    def places(self) -> Vector:
        """(n,3) m, own ENU frame."""
        return self.origins + self.rays / self.inverse[:, None]


def _no_corners() -> _Corners:
    none = np.zeros((0, 3))
    return _Corners(
        np.zeros((0, 2), np.float32),
        none,
        none,
        none,
        np.zeros(0),
        np.zeros(0),
        np.zeros(0, np.int64),
        np.zeros(0),
    )


class Parallax:
    """Follows corners through the pictures of one camera."""

    def __init__(self, view: View) -> None:
        self._view = view
        height = max(round(view.camera.height * _WIDTH / view.camera.width), 1)
        self._camera = view.camera.scaled(_WIDTH, height)
        self._last = np.array([_WIDTH, height]) - 1  # pixel
        self._rays = self._camera.directions  # made here, and not in the first tick
        self._sigma = float(np.hypot(_PIXEL / self._camera.fx, _ATTITUDE))
        self._corners = _no_corners()
        self._before: NDArray[np.uint8] | None = None
        self._pictures = self._named = 0
        self._time = -np.inf
        self._turned: tuple[Vector, float] | None = None  # rotation and height of the last picture
        self.flow: GroundFlow | None = None  # of the last two pictures

    def update(
        self,
        picture: Reduced,
        own: VehicleState,
        drones: list[Detection],
        ground: GroundPlane = LEVEL,
        trunks: Vector = _NO_TRUNKS,
    ) -> FixedPoints:
        """Return the points known after `picture`, taken in `own`.

        drones: the neighbours in the picture; what moves with them is no fixed point. trunks (k,3):
        known ones, x, y, radius, nearest first.
        """
        grey = picture.grey(self._camera.width, self._camera.height)
        rotation = self._view.rotation(own)
        if own.time - self._time > _LONGEST:
            self._corners, self._before = _no_corners(), None
        then, self._time, self.flow = self._time, own.time, None
        height = ground.under(own.p)
        if self._before is not None and len(self._corners):
            self._follow(grey, own.p, rotation, then, height, ground, trunks[:_NEAR_TRUNKS])
            self._drop_drones(drones)
        if self._pictures % _REFILL == 0 and len(self._corners) <= _FEW:
            self._refill(grey, own.p, rotation)
        self._pictures += 1
        self._before, self._turned = grey, (rotation, height)
        return self._known(own.p)

    def _follow(
        self,
        grey: NDArray[np.uint8],
        p: Vector,
        rotation: Vector,
        then: float,
        height: float,
        ground: GroundPlane,
        trunks: Vector,
    ) -> None:
        """Find the corners in the next picture, and refine their distances.

        then: s, time of the last picture. height: m, over the ground.
        """
        guess = self._camera.project((self._corners.places - p) @ rotation)
        u, v = ((guess > _MARGIN) & (guess < self._last - _MARGIN)).T
        inside = u & v
        c, guess = self._corners[inside], guess[inside].astype(np.float32)
        if not len(c) or self._before is None:
            self._corners = c
            return
        found, status, change = cv2.calcOpticalFlowPyrLK(
            self._before,
            grey,
            c.pixels[:, None],
            guess[:, None].copy(),
            winSize=_WINDOW,
            maxLevel=2,  # a near corner, new, is far from where it is expected
            criteria=_ENOUGH,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        pixels = np.asarray(found, np.float32)[:, 0]
        kept = (status[:, 0] == 1) & (change[:, 0] < _LOST)
        sights = self._camera.unproject(pixels.astype(float))
        rays = sights @ rotation.T
        if self._turned is not None:
            turned, height_then = self._turned
            low = kept & (ground.drop(rays) > STEEP)
            low[low] = ~hidden_by(trunks, p[:2], rays[low], height, ground)
            before = c.sights[low] @ turned.T
            way = way_over_ground(before, rays[low], height_then, height, ground)
            if way is not None:
                self.flow = GroundFlow(then, self._time, way, height)
        inverse, variance, fits = refined(
            c.origins - p, c.rays, rays, c.inverse, c.variance, self._sigma
        )
        now = _Corners(pixels, sights, c.origins, c.rays, inverse, variance, c.names, c.first)
        self._corners = now[kept & fits]

    def _drop_drones(self, drones: list[Detection]) -> None:
        for drone in drones:
            apart = math.cos(min(_DRONE / max(drone.range, 0.1), 1.0))
            self._corners = self._corners[self._corners.sights @ drone.direction < apart]

    def _refill(self, grey: NDArray[np.uint8], p: Vector, rotation: Vector) -> None:
        """Add corners where none is followed."""
        wanted = _CORNERS - len(self._corners)
        free = np.full(grey.shape, 255, np.uint8)
        # A corner may have been followed a little beyond the picture's edge.
        at = np.minimum(np.maximum(self._corners.pixels.round(), 0), self._last).astype(np.intp)
        free[at[:, 1], at[:, 0]] = 0
        free = np.asarray(cv2.erode(free, _AROUND), np.uint8)
        new = cv2.goodFeaturesToTrack(grey, _SOUGHT, _QUALITY, _APART, mask=free)
        if new is None:
            return
        found = np.asarray(new, np.float32)[:, 0]  # the best first
        u, v = found.astype(np.intp).T
        # What stands in the way shows around the horizon; other corners tell of the ground.
        level = np.abs(self._rays[v, u] @ rotation[2].astype(np.float32)) < _LEVEL
        pixels = np.concatenate(
            [found[level][:wanted], found[~level][: min(wanted, _CORNERS // 4)]]
        )
        n, c, sights = len(pixels), self._corners, self._camera.unproject(pixels)
        self._corners = _Corners(
            np.concatenate([c.pixels, pixels]),
            np.concatenate([c.sights, sights]),
            np.concatenate([c.origins, np.tile(p, (n, 1))]),
            np.concatenate([c.rays, sights @ rotation.T]),
            np.concatenate([c.inverse, np.full(n, _PRIOR[0])]),
            np.concatenate([c.variance, np.full(n, _PRIOR[1] ** 2)]),
            np.concatenate([c.names, self._named + np.arange(n)]),
            np.concatenate([c.first, np.full(n, self._time)]),
        )
        self._named += n

    def _known(self, p: Vector) -> FixedPoints:
        """Return the points whose distance is sure, seen from p (3,) m."""
        c = self._corners
        if not len(c):
            return FixedPoints.none()
        places = c.places
        away = lengths(places - p)
        moved = c.origins - p
        across = lengths(cross(moved, c.rays))
        parallax = across / np.maximum(away, NEAREST)
        sigmas = np.sqrt(c.variance) / c.inverse**2
        sure = (sigmas < SURE * away) & (parallax > _LEAST_PARALLAX)
        return FixedPoints(places, sigmas, c.names, across, self._time - c.first)[sure]
