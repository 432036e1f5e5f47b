"""Parallax map: what stands around, from points whose distance own motion has shown.

A point counts where another corner was found beside it; a wrong track stands alone. Points that
stand together become an upright cylinder round them where they fit into one, whatever they belong
to; a wider shape stays a set of points. Points that are no longer followed are kept for a while.

The distance comes from the own motion alone, so that it is as uncertain as that: what the own
velocity and attitude leave in doubt widens a point's σ, and a point whose σ is too large tells
nothing.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.estimation.landmark_places import Drift
from companion.estimation.turns import turn_about
from companion.perception.ground_plane import LEVEL, GroundPlane
from companion.perception.parallax import SURE, FixedPoints
from mavlink_bridge.shared.arrays import Vector

_STANDS = 0.4  # m over the ground, above which a point is in the way
_DOUBTS = 2.0  # σ of its distance that leave it there: the ground of a picture errs all alike
_LEVELS = 2.0  # m above and below the drone; what is farther up or down is not in the way
_RANGE = 8.0  # m, of points that are taken in; farther ones are poor
_MEMORY = 12.0  # s that a point which is no longer followed is kept
_MOST = 250  # points kept, the newest
_ANEW = 3  # updates: what stands does not move
_BESIDE = 0.4  # m, level, between points that confirm one another
_TOGETHER = 0.7  # m, level, between points of one thing
_WIDEST = 1.7  # m, radius of a thing that is a cylinder
_SLIMMEST = 0.12  # m, of a cylinder
_SIGMA = 0.1  # m, least 1 σ of the place of a thing that parallax alone shows
_POOR = 0.4  # m, 1 σ of a point that tells nothing any more
_EXPLAINED = 0.5  # m from a trunk's surface, within which points are the trunk's


_STILL = Drift()
# Columns of the points remembered: place [m], its 1 σ [m], the corner's name, last seen [s].
_PLACE, _DOUBT, _NAME, _SEEN = slice(0, 3), 3, 4, 5


@dataclass(frozen=True)
class StandingThings:
    """What parallax shows, in m.

    cylinders: (k,4) x, y, radius, 1 σ of the place. points: (n,3), of wider shapes.
    """

    cylinders: Vector
    points: Vector


class ParallaxMap:
    """Remembers standing points in the drone's own ENU frame."""

    def __init__(self) -> None:
        self._points: Vector = np.zeros((0, 6))  # see the columns above
        self._updates = 0
        self._standing = StandingThings(np.zeros((0, 4)), np.zeros((0, 3)))

    def update(
        self,
        fixed: FixedPoints,
        p: Vector,
        time: float,
        ground: GroundPlane = LEVEL,
        drift: Drift = _STILL,
    ) -> None:
        """Take in the points of one picture, taken at p (3,) m and `time` [s].

        drift: of the own pose since the last picture.
        """
        self._updates += 1
        if len(self._points):
            self._forget(fixed, p, time, drift)
        if len(fixed.names):
            self._add(fixed, p, time, ground)

    def turn(self, p: Vector, angle: float) -> None:
        """Turn all points left about p (3,) m by `angle` [rad]."""
        turn_about(self._points, p, angle)
        self._updates = _ANEW  # what stands is grouped anew

    def _forget(self, fixed: FixedPoints, p: Vector, time: float, drift: Drift) -> None:
        """Let the points drift; drop those that are old, or tell nothing any more.

        A corner whose place is refined replaces its older place, or leaves.
        """
        points = self._points
        arms = np.linalg.norm(points[:, _PLACE] - p, axis=1)
        sigmas = points[:, _DOUBT]
        sigmas[:] = np.sqrt(sigmas**2 + drift.position**2 + (drift.yaw * arms) ** 2)
        again = (points[:, _NAME, None] == fixed.names).any(axis=1)
        known = (time - points[:, _SEEN] < _MEMORY) & (sigmas < _POOR)
        self._points = points[known & ~again]

    def _add(self, fixed: FixedPoints, p: Vector, time: float, ground: GroundPlane) -> None:
        """Add the points of one picture that are near and in the way."""
        places = fixed.places
        lengths = np.linalg.norm(places - p, axis=1)
        near = lengths < _RANGE
        rise = np.abs(places[:, 2] - p[2]) / np.maximum(lengths, 1e-6)
        height = places[:, 2] - ground.below(places) - _DOUBTS * fixed.sigmas * rise
        stands = height > _STANDS
        stands &= np.abs(places[:, 2] - p[2]) < _LEVELS
        seen = np.full(len(places), time)
        rows = np.column_stack([places, fixed.sigmas, fixed.names, seen])[near & stands]
        self._points = np.concatenate([self._points, rows])[-_MOST:]

    def standing(self) -> StandingThings:
        """Return what stands around, by all points remembered; made anew every few updates."""
        if self._updates >= _ANEW:
            self._updates, self._standing = 0, self._grouped()
        return self._standing

    def _grouped(self) -> StandingThings:
        east, north = self._points[:, 0], self._points[:, 1]
        squares = (east[:, None] - east) ** 2 + (north[:, None] - north) ** 2  # of level gaps
        sure = (squares < _BESIDE**2).sum(axis=1) > 1  # itself and another
        points = self._points[sure]
        cylinders: list[list[float]] = []
        rest: list[Vector] = []
        for members in _groups(squares[sure][:, sure] < _TOGETHER**2):
            group = points[members, _PLACE]
            (x, y), radius = cv2.minEnclosingCircle(group[:, None, :2].astype(np.float32))
            if radius <= _WIDEST:
                sigma = statistics.median(points[members, _DOUBT].tolist())
                cylinders.append([x, y, max(radius, _SLIMMEST), max(sigma, _SIGMA)])
            else:
                rest.append(group)
        return StandingThings(
            np.array(cylinders).reshape(-1, 4),
            np.concatenate(rest) if rest else np.zeros((0, 3)),
        )


def doubted(fixed: FixedPoints, p: Vector, second: Drift) -> FixedPoints:
    """Return the points seen from p (3,) m with the doubt of the own motion, without poor ones.

    second: how far the pose may drift within a second. It drifts as a random walk does.
    """
    if not len(fixed.names):
        return fixed
    lengths = np.linalg.norm(fixed.places - p, axis=1)
    turn = second.yaw**2 + second.tilt**2 * (1.0 - second.tilt_kept**2)
    moved = (second.position**2 + turn * lengths**2) * fixed.since
    sigmas = np.sqrt(fixed.sigmas**2 + moved * (lengths / np.maximum(fixed.bases, 1e-3)) ** 2)
    return replace(fixed, sigmas=sigmas)[sigmas < SURE * lengths]


def with_others(cylinders: Vector, others: Vector, p: Vector) -> Vector:
    """Return cylinders (k,4), nearest first, and those of others (n,4) that none of them explains.

    Rows of the result: x, y, radius and 1 σ of the place [m], sorted by the distance of the
    surface from p (3,) m.
    """
    if not len(others):
        return cylinders
    gaps = np.linalg.norm(others[:, None, :2] - cylinders[None, :, :2], axis=2) - cylinders[:, 2]
    new = others[(gaps > _EXPLAINED).all(axis=1)]
    if not len(new):
        return cylinders
    both = np.concatenate([cylinders, new])
    surface = np.linalg.norm(both[:, :2] - p[:2], axis=1) - both[:, 2]
    return np.asarray(both[np.argsort(surface, kind="stable")])


def _groups(linked: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Return the connected groups of indices of a symmetric matrix (n,n)."""
    left = np.ones(len(linked), bool)
    groups = []
    while left.any():
        member = np.zeros(len(linked), bool)
        edge = np.zeros(len(linked), bool)
        edge[int(np.argmax(left))] = True
        while edge.any():
            member |= edge
            edge = linked[edge].any(axis=0) & ~member
        left &= ~member
        groups.append(np.flatnonzero(member))
    return groups
