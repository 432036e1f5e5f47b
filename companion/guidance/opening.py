"""Openings: the way through a wall, found where it is seen and not where a coordinate says.

A map that is one metre wrong leads into the wall beside an opening of two. Seen along the way, the
surface points between the drone and its goal leave a gap: its middle corrects the goal.
"""

from __future__ import annotations

import cv2
import numpy as np

from mavlink_bridge.shared.arrays import Vector

_CELL = 0.1  # m, of the picture of the wall across the way
_ASIDE, _UP = 3.0, 1.6  # m to each side of the goal, and up and down, within which a gap is sought
_PAST = 1.0  # m behind the goal, up to which points belong to the wall
_POINTS = 30  # in that picture that make a wall
_NARROWEST = 0.5  # m from the middle of an opening to its edge, at least
_ROOM = 1.2  # m of it that make an opening no better
_FAR = 0.15  # m of such room that a metre from the goal is worth
_TRUST = 0.25  # share of each look in the correction


class OpeningFinder:
    """Follows the opening that is nearest to a goal; shift: (3,) m from the goal to its middle."""

    def __init__(self) -> None:
        self.shift: Vector = np.zeros(3)
        self._found = False

    def update(self, p: Vector, goal: Vector, way: Vector, points: Vector) -> Vector:
        """Return the shift (3,) m of a goal (3,) m, seen from p (3,) m.

        way: (2,) unit vector, level, along which the opening leads. points: (n,3) m, on surfaces.
        """
        seen = middle(p, goal, way, points)
        if seen is not None:
            share = _TRUST if self._found else 1.0
            self.shift = self.shift + share * (seen - self.shift)
            self._found = True
        return self.shift


def middle(p: Vector, goal: Vector, way: Vector, points: Vector) -> Vector | None:
    """Return the shift (3,) m from the goal to the middle of the opening; None: none is seen.

    Only a gap between points to its left and right at its height counts: where nothing has been
    seen there is no opening.
    """
    if not len(points):
        return None
    left = np.array([-way[1], way[0]])
    offsets = points - goal
    along = offsets[:, :2] @ way
    back = float((p[:2] - goal[:2]) @ way)
    aside, up = offsets[:, :2] @ left, offsets[:, 2]
    wall = (along > back) & (along < _PAST) & (np.abs(aside) < _ASIDE) & (np.abs(up) < _UP)
    if np.count_nonzero(wall) < _POINTS:
        return None
    shape = (round(2 * _UP / _CELL), round(2 * _ASIDE / _CELL))
    rows = np.clip(((up[wall] + _UP) / _CELL).astype(int), 0, shape[0] - 1)
    columns = np.clip(((aside[wall] + _ASIDE) / _CELL).astype(int), 0, shape[1] - 1)
    free = np.full(shape, 255, np.uint8)
    free[rows, columns] = 0
    room = _CELL * cv2.distanceTransform(free, cv2.DIST_L2, 5)
    # Points of a coarse map leave holes: those within a step of a row stand beside all of it.
    stands = cv2.dilate(255 - free, np.ones((5, 1), np.uint8)) > 0
    between = (
        np.maximum.accumulate(stands, axis=1)
        & (np.maximum.accumulate(stands[:, ::-1], axis=1)[:, ::-1])
    )
    z, y = (
        (np.arange(n) + 0.5) * _CELL - half for n, half in zip(shape, (_UP, _ASIDE), strict=True)
    )
    score = np.minimum(room, _ROOM) - _FAR * np.hypot(z[:, None], y[None, :])
    score[~between | (room < _NARROWEST)] = -np.inf
    if not np.isfinite(score).any():
        return None
    # The middle of all places that are nearly as good: room is measured in whole cells.
    good = score > score.max() - _CELL
    weights = good / good.sum()
    a, u = float((weights * y[None, :]).sum()), float((weights * z[:, None]).sum())
    return np.array([a * left[0], a * left[1], u])
