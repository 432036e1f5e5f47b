"""How finds move against what is round them, and what that says of each.

What is taken for a drone and is none belongs to what is round it: a patch of light moves from
picture to picture as the ground does. A drone is before its surroundings: while it flies, or the
own drone does, it moves against them, by more the nearer it is. So by Bayes' rule a find that moves
with its surroundings, though at its range it should not, is likelier none, and one that moves
against them likelier a drone. This is parallax, and needs neither colours nor shapes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.perception.camera import Camera
from companion.types import Image
from mavlink_bridge.shared.arrays import Vector, lengths

Mask = NDArray[np.bool_]

_ASKED = 7.0  # px of a find's radius in the reduced picture in which it is followed
_LEVELS = 4  # halves of the picture
# Places in radii: five of a find, and twelve round it, opposite ones six apart.
_CORE = 0.35 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
_ROUND = 2.2 * np.array([[math.cos(a), math.sin(a)] for a in np.arange(12) * math.pi / 6])
_PLACES = np.vstack([_CORE, _ROUND])
_WINDOW, _HALVES = (11, 11), 1
_TEXTURE = 1e-3  # least eigenvalue of a window that can be followed
_STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 0.01)
_EDGE = 2.0  # px from the picture's edge
_FEWEST = 2  # places of core, and pairs round it, that were followed
_OFF = 0.5  # px, 1 σ of how far off a find's motion is, besides what they differ by
_BEHIND = 2.0  # m from a drone to what is round it; with more, far ones before a near wood are lost
_SPEED = 0.2  # m/s, 1 σ of a drone's own motion across
# Shares of drones: those that happen to move as their surroundings do, that hold still, that fly.
_ALONG, _STILL, _FLYING = np.log([0.2, 0.3, 0.5]).tolist()
MOST = 2.0  # log odds that one pair of pictures brings


@dataclass(frozen=True)
class Moved:
    """How a camera moved since the picture before.

    turn: (3,3), camera now → camera then. way: (3,) m, camera frame now. time: s.
    """

    turn: Vector
    way: Vector
    time: float


class Background:
    """Compares each picture of a camera with the one before."""

    def __init__(self, camera: Camera) -> None:
        """camera: as the pictures show it."""
        self._camera = camera
        self._now: list[NDArray[np.uint8]] = []
        self._then: list[NDArray[np.uint8]] = []

    def follow(self, image: Image) -> None:
        """Take in the next picture (H,W,3) uint8 BGR."""
        grey = [np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)]
        for _ in range(_LEVELS):
            h, w = grey[-1].shape
            half = cv2.resize(grey[-1], (w // 2, h // 2), interpolation=cv2.INTER_AREA)
            grey.append(np.asarray(half, np.uint8))
        self._then, self._now = self._now, grey

    def evidence(
        self, places: Vector, sizes: Vector, ranges: Vector, pixels: Vector, moved: Moved
    ) -> Vector:
        """Return the log odds (n,) that finds gain by how they moved.

        places: (n,2) u, v [px], of radii sizes (n,) px, at ranges (n,) m. pixels: (n,) rad each.
        """
        if not len(places) or not self._then:
            return np.zeros(len(places))
        points = places[:, None] + _PLACES * sizes[:, None, None]
        flow, valid = self._flow(points, sizes, moved.turn)
        inner, half = len(_CORE), len(_CORE) + len(_ROUND) // 2
        core, own_spread = _middle(flow[:, :inner], valid[:, :inner])
        # The mean of two opposite places is the motion between them, on any even surface.
        pairs = 0.5 * (flow[:, inner:half] + flow[:, half:])
        paired = valid[:, inner:half] & valid[:, half:]
        surroundings, spread = _middle(pairs, paired)
        rays = self._camera.unproject(places)
        across = lengths(moved.way - rays * (rays @ moved.way)[:, None])
        parallax = across * _BEHIND / (ranges + _BEHIND) / (ranges * pixels)
        own = _SPEED * moved.time / (ranges * pixels)
        off = (_OFF + own_spread + spread) ** 2
        squared = ((core - surroundings) ** 2).sum(axis=1)

        def gained(variance: Vector) -> Vector:
            better = squared * (1.0 / off - 1.0 / variance)
            return np.asarray(np.log(off / variance) + 0.5 * better)

        still = off + parallax**2
        odds = np.logaddexp(_ALONG, _STILL + gained(still))
        odds = np.logaddexp(odds, _FLYING + gained(still + own**2))
        told = (valid[:, :inner].sum(axis=1) >= _FEWEST) & (paired.sum(axis=1) >= _FEWEST)
        return np.where(told, np.minimum(odds, MOST), 0.0)

    def _flow(self, points: Vector, sizes: Vector, turn: Vector) -> tuple[Vector, Mask]:
        """Return by how much points (n,k,2) moved besides by the turn [px], and where it is told.

        They are followed back into the picture before, in one that is reduced to their size.
        """
        n, k = points.shape[:2]
        flat = points.reshape(-1, 2)
        height, width = self._now[0].shape
        guess = self._camera.project(self._camera.unproject(flat) @ turn.T)
        inside = (flat > _EDGE) & (flat < np.array([width, height]) - 1 - _EDGE)
        valid: Mask = np.asarray(inside.all(axis=1) & np.isfinite(guess).all(axis=1))
        flow = np.zeros_like(flat)
        levels = np.round(np.log2(np.maximum(sizes, 1.0) / _ASKED)).clip(0, _LEVELS).astype(int)
        for level in set(levels.tolist()):
            rows = np.flatnonzero(np.repeat(levels == level, k) & valid)
            if not len(rows):
                continue
            scale = 2.0**level
            at, expected = (((p[rows] + 0.5) / scale - 0.5)[:, None] for p in (flat, guess))
            there, found, _ = cv2.calcOpticalFlowPyrLK(
                self._now[level],
                self._then[level],
                np.ascontiguousarray(at, np.float32),
                np.ascontiguousarray(expected, np.float32),
                winSize=_WINDOW,
                maxLevel=_HALVES,
                criteria=_STOP,
                flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
                minEigThreshold=_TEXTURE,
            )
            flow[rows] = (np.asarray(there, float)[:, 0] - expected[:, 0]) * scale
            valid[rows] &= np.asarray(found)[:, 0] == 1
        return flow.reshape(n, k, 2), valid.reshape(n, k)


def _middle(flow: Vector, valid: Mask) -> tuple[Vector, Vector]:
    """Return the medians (n,2) of the valid flows (n,k,2), and how far they are off it (n,)."""
    middle = np.stack([_median(flow[..., axis], valid) for axis in (0, 1)], axis=1)
    off = np.abs(flow - middle[:, None]).sum(axis=2)
    return middle, _median(off, valid)


def _median(values: Vector, valid: Mask) -> Vector:
    """Return the medians (n,) of the valid ones of values (n,k); 0 where there are none."""
    ordered = np.sort(np.where(valid, values, np.inf), axis=1)
    count, rows = valid.sum(axis=1), np.arange(len(values))
    both = ordered[rows, np.maximum(count - 1, 0) // 2] + ordered[rows, count // 2]
    return np.where(count > 0, 0.5 * both, 0.0)
