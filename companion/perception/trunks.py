"""Tree trunks from the pixels of one frame: where bark meets the ground gives the distance.

The frame is levelled (`panorama`). Each of its columns is split into bark above and ground below.
The elevation of this foot and the altitude above ground give a distance per column, much as a lidar
does; `trunk_fit` makes trunks of the columns.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.perception.camera import Camera
from companion.perception.panorama import LEVEL_GROUND, LevelFrame, Panorama
from companion.perception.pixels import percentile, row_sums
from companion.perception.reduced import Reduced
from companion.perception.separation import Feet, Separation, score
from companion.perception.trunk_fit import Columns, Mask, TrunkSettings, find_trunks
from companion.types import Image, Trunk
from mavlink_bridge.shared.arrays import Vector, finite

_NOTHING: Vector = np.zeros(1)
_LOW = 0.8  # m; from lower, while it takes off or lands, a drone sees too little of the ground


class TrunkDetector:
    """Finds vertical trunks by their ground contact and edges.

    clarity: 0…1, how well bark and ground separate by colour in the last pictures (`separation`).
    """

    def __init__(self, camera: Camera, settings: TrunkSettings | None = None) -> None:
        self.settings = settings or TrunkSettings()
        # Half the picture's size is as fine as the panorama.
        self._size = (camera.width + 1) // 2, (camera.height + 1) // 2
        self._panorama = Panorama.around_feet(
            camera.scaled(*self._size), math.radians(self.settings.step_deg)
        )
        self._separation = Separation()
        elevation = self._panorama.elevation
        self._horizon = int(np.searchsorted(-elevation, 0.0))
        self._step = float(self._panorama.azimuth[1] - self._panorama.azimuth[0])
        # Above the far tree line and below the nearest crowns the background of a trunk is the sky.
        above = (elevation > math.radians(6.0)) & (elevation < math.radians(13.0))
        self._above = slice(int(np.argmax(above)), int(np.argmax(above) + above.sum()))

    @property
    def clarity(self) -> float:
        """Return the clarity."""
        return self._separation.clarity

    def detect(
        self, image: Image, gravity_c: Vector, altitude: float, rise_c: Vector = LEVEL_GROUND
    ) -> list[Trunk]:
        """Return the trunks in image (H,W,3) uint8 BGR, nearest first.

        gravity_c: (3,) unit vector down, camera frame. altitude: m, camera above the ground.
        rise_c: (3,) m/m, how steeply the ground rises, along the steepest way, camera frame.
        """
        return self.search(Reduced(image), gravity_c, altitude, rise_c)

    def search(
        self, picture: Reduced, gravity_c: Vector, altitude: float, rise_c: Vector = LEVEL_GROUND
    ) -> list[Trunk]:
        """Return the trunks in a picture, whose half size others may have made, too."""
        if not altitude > 0.1 or not finite(gravity_c):
            return []
        level = LevelFrame.along(gravity_c)
        four = cv2.cvtColor(picture.colour(*self._size), cv2.COLOR_BGR2BGRA)
        # The nearest pixel is exact enough: the scan takes the mean of 3×3 of them.
        view, seen = self._panorama.resample(np.asarray(four, np.uint8), level, cv2.INTER_NEAREST)
        columns = self._scan(view, seen, altitude, self._panorama.along(rise_c, level))
        return find_trunks(columns, self.settings, altitude, level)

    def _scan(self, view: Image, seen: Mask, altitude: float, rise: Vector) -> Columns:
        """Return the panorama's columns, each split at the foot of the object in it.

        rise: (columns,) m/m, of the ground.
        """
        h = self._horizon
        blue, green, red, _ = cv2.split(cv2.blur(view, (3, 3)))
        high = np.asarray(cv2.max(red, green), np.uint8)
        # A neighbour's marker is neither bark nor ground; the pixels behind it stay unknown.
        known = seen & (cv2.subtract(cv2.min(red, blue), green) < 28)
        warmth = np.asarray(cv2.divide(cv2.subtract(high, blue), high, scale=255.0), np.uint8)
        below, known_below = np.ascontiguousarray(warmth[:, h:]), known[:, h:]
        stands, above = self._stands(high, warmth, known)
        typical, bark, tall = self._typical(below, known_below), *self._bark(warmth, known, above)
        threshold = self._threshold(typical, bark, above)
        ground = (below > threshold[:, None]) & known_below
        feet = self._feet(ground, known_below)
        if altitude > _LOW:
            self._separation.follow(score(typical, feet, bark, tall, self._step))
        e = self._panorama.elevation[h:]
        edge_row = self._sub_row(below, feet.row, threshold)
        slope = np.tan(-(e[0] + edge_row * (e[1] - e[0])))
        t = altitude / np.maximum(slope + rise, 1e-3)
        t[feet.row == 0] = np.inf
        blind = feet.known < 6
        # Without ground in view, an object before the sky may be near.
        t = np.where(blind & above, 2.0 * self.settings.max_range, t)
        return Columns(
            self._panorama.azimuth,
            np.where(stands, t, np.inf),
            (feet.ground_below >= 5) & (feet.ground_below > 0.7 * feet.known_below) & ~blind,
            ~blind | above,
            self._edges(high, known),
        )

    @staticmethod
    def _feet(ground: Mask, known: Mask) -> Feet:
        """Return the foot in each column: bark above it and ground below, with least misfits.

        ground, known: (columns,rows) below the horizon.
        """
        vote = 2 * ground.view(np.int8) - known.view(np.int8)
        # Misfits of a foot at row k: cumulated votes and a constant. Cumulated over all columns
        # before, too, they are whole numbers, which single precision holds.
        sums = cv2.integral(vote.astype(np.float32), sdepth=cv2.CV_32F)
        row = np.argmin(sums[1:] - sums[:-1], axis=1)
        after = np.arange(ground.shape[1]) >= row[:, None]
        return Feet(
            row,
            row_sums(known),
            row_sums(ground),
            row_sums(known & after),
            row_sums(ground & after),
            row_sums(known[:, :12]) >= 8,
        )

    def _typical(self, below: Image, known_below: Mask) -> float | None:
        """Return the saturation (of 255) of this frame's ground; None where too little shows."""
        part = np.s_[::4, (len(self._panorama.elevation) - self._horizon) // 3 :: 3]
        sample = below[part][known_below[part]]
        # A high percentile: a near trunk may fill more than half of the lower picture.
        return percentile(sample, 75) if sample.size > 50 else None

    def _bark(self, warmth: Image, known: Mask, above: Mask) -> tuple[Vector, Mask]:
        """Return the saturation of what stands before the sky, by column, and where it is known."""
        ok = known[:, self._above]
        rows = row_sums(ok)
        bark: Vector = row_sums(warmth[:, self._above] * ok) / np.maximum(rows, 1)
        return bark, above & (rows >= 8)

    def _threshold(self, typical: float | None, bark: Vector, above: Mask) -> Vector:
        """Return per column the saturation (of 255) that tells ground from bark.

        It follows from the ground of this frame, and from the bark before the sky in the column.
        """
        typical = 128.0 if typical is None else typical
        common = min(max(self.settings.ground_share * typical, 78.0), 96.0)
        own = np.minimum(bark + 0.35 * (typical - bark), 0.85 * typical)
        return np.where(above, np.maximum(own, common), common)

    def _edges(self, high: Image, known: Mask) -> Vector:
        """Return the mean upright contrast of neighbouring columns around the horizon; last: 0."""
        band = slice(0, self._horizon + 30)
        grey, ok = high[:, band], known[:, band]
        both = ok[1:] & ok[:-1]
        step = row_sums(grey[1:] * both) - row_sums(grey[:-1] * both)
        contrast = np.abs(step) / np.maximum(row_sums(both), 8)
        return np.concatenate([contrast, _NOTHING])

    @staticmethod
    def _sub_row(below: Image, foot_row: NDArray[np.intp], threshold: Vector) -> Vector:
        """Return the foot's row, between pixels, where the colour passes the threshold."""
        k = np.minimum(np.maximum(foot_row, 1), below.shape[1] - 1)
        cols = np.arange(below.shape[0])
        a, b = below[cols, k - 1].astype(float), below[cols, k].astype(float)
        part = (threshold - a) / np.maximum(b - a, 5.0)
        row: Vector = np.minimum(np.maximum(part, 0.0), 1.0) + k - 1.0
        return row

    def _stands(self, high: Image, warmth: Image, known: Mask) -> tuple[Mask, Mask]:
        """Return the columns whose object may rise above the horizon, and those where it does."""
        band, ok = high[:, self._above], known[:, self._above]
        covered = row_sums(ok)
        if covered.sum() < 50:
            return np.ones(len(band), bool), np.zeros(len(band), bool)
        sky = percentile(band[::4, ::2], 90)
        # Sky and cloud are bright and never warmer than neutral.
        dark = row_sums(((band < 0.72 * sky) | (warmth[:, self._above] > 30)) & ok)
        tall: Mask = dark >= 0.5 * covered
        return tall | (covered < 4), tall & (covered >= 4)
