"""Obstacles by the network's classes: where each column of the picture meets the ground.

The probabilities of obstacle and ground are levelled (`panorama`). In each column the foot is the
row that best parts obstacle above from ground below; its elevation and the altitude give the
distance, and how softly one class turns into the other gives the foot's doubt. Ground may show
again between what stands there and a low object nearer by, such as a bush: then the foot is that of
the farther one, unless the low one reaches the height of flight. `object_fit` makes obstacles of
the columns. Source: Levi et al., "StixelNet", 2015.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.perception.camera import Camera
from companion.perception.column_runs import Feet
from companion.perception.heat_map import Cells
from companion.perception.object_fit import FootSettings, find_obstacles
from companion.perception.panorama import LEVEL_GROUND, LevelFrame, Panorama
from companion.perception.pixels import row_sums
from companion.perception.trunk_fit import Mask
from companion.types import Image, Trunk
from mavlink_bridge.shared.arrays import Vector

Votes = NDArray[np.int16]
_SURE = 255
_LOW = 0.4  # m below the camera that an obstacle's top may be, and still count
_HIGH_ROWS = 5  # of the panorama above the horizon: an obstacle there stands in the way
_SOLID = 0.4  # of the rows between these two that an obstacle has to fill
_GROUND = 2  # rows of ground below a foot that show it
_AT = 2  # rows on either side of the horizon
_SOFT = 3  # rows above a foot in which the classes change
_PARTS = 1.2  # rows of sure ground between two obstacles in one column
_BLUR = 0.5  # σ of the foot over the stretch in which the classes are not clear


class FootFinder:
    """Finds obstacles that stand on the ground, in the network's classes.

    clarity: 0…1, mean certainty of the newest picture's classes below the horizon: 1 where each
    pixel is surely ground, obstacle or neither, 0 where nothing can be told apart.
    """

    def __init__(self, camera: Camera, settings: FootSettings, shape: tuple[int, int]) -> None:
        """shape: h, w of the classes."""
        self._settings = settings
        step = math.radians(settings.step_deg)
        self._panorama = Panorama.around_feet(camera.scaled(shape[1], shape[0]), step)
        elevation = self._panorama.elevation
        self._horizon = int(np.searchsorted(-elevation, 0.0))
        self._drop = np.tan(-elevation[self._horizon :])
        self._above = slice(0, int(np.searchsorted(-elevation, -math.radians(3.0))))
        self.clarity = 1.0

    def find(
        self, scene: Cells, gravity_c: Vector, altitude: float, rise_c: Vector = LEVEL_GROUND
    ) -> list[Trunk]:
        """Return the obstacles in classes (2,h,w), nearest first, and set `clarity`.

        gravity_c: (3,) unit vector down, camera frame. altitude: m, camera above the ground.
        rise_c: (3,) m/m, how steeply the ground rises, along the steepest way, camera frame.
        """
        if not altitude > 0.1 or not np.isfinite(gravity_c).all():
            return []
        level = LevelFrame.along(gravity_c)
        cells = np.zeros((*scene.shape[1:], 4), np.uint8)
        np.multiply(scene[0], _SURE, out=cells[..., 0], casting="unsafe")
        np.multiply(scene[1], _SURE, out=cells[..., 1], casting="unsafe")
        view, seen = self._panorama.resample(cells, level)
        self.clarity = self._clearness(view, seen)
        rise = self._panorama.along(rise_c, level)
        feet = self._feet(_votes(view, seen), seen, altitude, rise)
        return find_obstacles(feet, self._settings, altitude, level)

    def _clearness(self, view: Image, seen: Mask) -> float:
        part = np.s_[::2, self._horizon :: 2]
        pair, known = view[part][..., :2].astype(np.int16), seen[part]
        a, b = pair[..., 0], pair[..., 1]
        likeliest = np.maximum(np.maximum(a, b), _SURE - a - b)[known]
        if not len(likeliest):
            return 1.0
        return max(0.0, float(1.5 * likeliest.mean() / _SURE - 0.5))

    def _feet(self, vote: Votes, known: Mask, altitude: float, rise: Vector) -> Feet:
        """Return the columns, each split at the foot of the obstacle in it.

        vote: (columns, rows), > 0: ground. rise: (columns,) m/m, of the ground.
        """
        h = self._horizon
        below, known_below = vote[:, h:], known[:, h:]
        rows = np.arange(below.shape[1])
        far, near, top, mass = _split(below)
        nearest = altitude / np.maximum(self._slope(below, near) + rise, 1e-3)
        beyond = (far < near) & (top > self._reach(nearest))
        foot_row = np.where(beyond, far, near)
        after = (rows >= foot_row[:, None]) & known_below
        known_after = row_sums(after)
        ground_after = row_sums(after & (below > 0))
        t = altitude / np.maximum(self._slope(below, foot_row) + rise, 1e-3)
        t[foot_row == 0] = np.inf
        high = vote[:, self._above]
        above = row_sums(high < -_SURE // 2) > 0.5 * np.maximum(row_sums(known[:, self._above]), 4)
        blind = row_sums(known_below) < 6
        # Without ground in view, an object before the sky may be near.
        t = np.where(blind & above, 2.0 * self._settings.max_range, t)
        soft = (np.abs(below) < _SURE // 2) & self._near(rows, foot_row)
        step = float(self._panorama.elevation[0] - self._panorama.elevation[1])
        lowest = altitude / np.maximum(self._slope(below, mass) + rise, 1e-3)
        return Feet(
            self._panorama.azimuth,
            np.where(self._stands(vote, known, foot_row, t), t, np.inf),
            (beyond | (ground_after >= _GROUND) & (ground_after > 0.7 * known_after)) & ~blind,
            ~blind | above,
            np.asarray(known[:, h - _HIGH_ROWS : h + _HIGH_ROWS].all(axis=1), bool),
            vote[:, h - _AT : h + _AT].sum(axis=1) < 0,
            np.asarray(_BLUR * step * row_sums(soft), float),
            lowest,
            self._tops(vote, mass + h, lowest) + step / 2,
            rise,
        )

    def _tops(self, vote: Votes, foot_row: NDArray[np.intp], t: Vector) -> Vector:
        """Return the elevation [rad] up to which there is no gap above the feet, t [m] away."""
        row = np.zeros(len(t), np.intp)
        close = np.flatnonzero(t < 1.5 * self._settings.max_range)
        row[close] = _top(vote[close], foot_row[close])
        tops: Vector = self._panorama.elevation[row]
        return tops

    def _slope(self, below: Votes, foot_row: NDArray[np.intp]) -> Vector:
        """Return the tangent of the foot's angle below the horizon, between the rows' centres."""
        k = np.clip(foot_row, 1, below.shape[1] - 1)
        columns = np.arange(len(below))
        a, b = below[columns, k - 1].astype(float), below[columns, k].astype(float)
        part = np.clip(-a / np.maximum(b - a, 1.0), 0.0, 1.0)
        e = self._panorama.elevation[self._horizon :]
        slope: Vector = np.tan(-(e[0] + (part + k - 1.0) * (e[1] - e[0])))
        return slope

    def _stands(self, vote: Votes, known: Mask, foot_row: NDArray[np.intp], t: Vector) -> Mask:
        """Return the columns whose obstacle reaches the height of flight."""
        h = self._horizon
        rows = np.arange(vote.shape[1] - h)
        band = (rows < np.minimum(self._reach(t), foot_row)[:, None]) & known[:, h:]
        solid = row_sums(band & (vote[:, h:] < 0))
        solid += row_sums(vote[:, h - _HIGH_ROWS : h] < 0)
        tall: Mask = solid > _SOLID * np.maximum(row_sums(band), 2)
        return tall

    def _reach(self, t: Vector) -> NDArray[np.intp]:
        """Return the row that an obstacle's top at t [m] reaches, at least, where it counts."""
        rows: NDArray[np.intp] = np.searchsorted(self._drop, _LOW / np.maximum(t, 0.3))
        return rows

    @staticmethod
    def _near(rows: NDArray[np.intp], foot_row: NDArray[np.intp]) -> Mask:
        """Return the rows (columns, rows) around each foot in which its doubt is counted."""
        near: Mask = np.abs(rows - foot_row[:, None]) <= 6
        return near


def _votes(view: Image, known: Mask) -> Votes:
    """Return the probability of ground less that of an obstacle, of 255, 0 where not known."""
    obstacle, ground, _, _ = cv2.split(view)
    mask = known.view(np.uint8)
    return np.asarray(cv2.subtract(ground, obstacle, mask=mask, dtype=cv2.CV_16S), np.int16)


def _top(vote: Votes, foot_row: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the highest row (columns,) of what stands on each foot without a gap."""
    rows = np.arange(vote.shape[1])
    clear = (vote > -_SURE // 4) & (rows < foot_row[:, None] - _SOFT)
    clear[:, :-1] &= clear[:, 1:]
    gaps: NDArray[np.intp] = np.where(clear, rows + 2, 0).max(axis=1)
    highest: NDArray[np.intp] = np.minimum(gaps, vote.shape[1] - 1)
    return highest


def _split(below: Votes) -> tuple[NDArray[np.intp], ...]:
    """Return of each column the foot of the upper obstacle, that of the lower one, and its top.

    below: (columns, rows) from the horizon down, > 0: ground. Rows (columns,); the feet are equal
    where there is one obstacle. The last of the four is the foot of what fills most rows in one
    piece, also of a low object over which more ground shows.
    """
    # Misfits of a foot at row k, obstacle above and ground below: cumulated votes.
    running = np.zeros((len(below), below.shape[1] + 1), np.int32)
    np.cumsum(below, axis=1, dtype=np.int32, out=running[:, 1:])
    near = np.argmin(running, axis=1)
    ground = running - np.minimum.accumulate(running, axis=1) > _PARTS * _SURE
    rows = np.arange(running.shape[1])
    end = np.where(ground.any(axis=1), ground.argmax(axis=1), len(rows))
    far, top = near.copy(), near.copy()
    two = np.flatnonzero(end <= near)
    if len(two):
        sums = running[two]
        far[two] = np.argmin(np.where(rows < end[two, None], sums, sums.max() + 1), axis=1)
        between = (rows >= far[two, None]) & (rows <= near[two, None])
        top[two] = np.argmax(np.where(between, sums, sums.min() - 1), axis=1)
    mass = np.argmin(running - np.maximum.accumulate(running, axis=1), axis=1)
    return far, near, top, mass
