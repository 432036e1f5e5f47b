"""Tree trunks from the pixels of one frame: where bark meets the ground gives the distance.

The frame is levelled (`panorama`). Each of its columns is split into bark above and ground below.
The elevation of this foot and the altitude above ground give a distance per column, much as a lidar
does. Neighbouring columns of like distance form a trunk; its two edges give the radius:

    t(Δ) = d (cos Δ − √(sin² β − sin² Δ)),   sin β = r / d

with d the distance to the axis, β half the angular width, Δ the azimuth from the axis, t the
distance to the surface.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from companion.perception.camera import Camera
from companion.perception.panorama import LevelFrame, Panorama
from companion.types import Image, Trunk
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import Contradiction, StrictModel

Mask = NDArray[np.bool_]
CUT_WIDTH = 1.35  # typical true over visible width of a trunk cut by the picture's edge
TRIED = np.geomspace(16.0, 1.02, 48)  # distances to the axis, in radii
EDGE = 9.0  # grey levels, contrast of an upright edge that parts two trunks


class TrunkSettings(StrictModel):
    """The look of trunks and ground, and how far trunks are sought."""

    radius: float = Field(1.0, gt=0, description="Assumed [m] where one edge of a trunk shows.")
    max_range: float = Field(12.0, gt=0, description="Farther surfaces [m] are not used.")
    step_deg: float = Field(0.6, ge=0.2, le=3, description="Pixel of the level panorama.")
    min_width_deg: float = Field(2.5, gt=0, description="Narrower objects are no trunks.")
    ground_share: float = Field(
        0.55, gt=0, lt=1, description="Least share of the ground's saturation in a ground pixel."
    )
    attitude_sigma: float = Field(0.006, ge=0, description="1 σ [rad] of the own attitude.")
    min_radius: float = Field(0.08, gt=0, description="Thinner objects [m] are no trunks.")
    max_radius: float = Field(2.5, gt=0, description="Thicker objects [m] are no trunks.")

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if not self.min_radius <= self.radius <= self.max_radius:
            raise Contradiction(
                ("radius", "min_radius", "max_radius"),
                f"radius, {self.radius:g}, must lie between min_radius, {self.min_radius:g}, and "
                f"max_radius, {self.max_radius:g}",
            )
        return self


@dataclass(frozen=True)
class _Columns:
    """The panorama, column by column.

    azimuth: rad. t: m to the foot of the object there; inf where there is none. foot: whether the
    foot is in the picture; if not, t is an upper bound. seen: whether the frame covers the column.
    edge: grey levels, upright contrast towards the next column.
    """

    azimuth: Vector
    t: Vector
    foot: Mask
    seen: Mask
    edge: Vector


class TrunkDetector:
    """Finds vertical trunks by their ground contact and edges."""

    def __init__(self, camera: Camera, settings: TrunkSettings | None = None) -> None:
        self.settings = settings or TrunkSettings()
        top, bottom = math.radians(14.0), math.radians(-76.0)
        side = min(camera.max_angle, math.radians(92.0))
        step = math.radians(self.settings.step_deg)
        self._panorama = Panorama(camera, side, top, bottom, step)
        elevation = self._panorama.elevation
        self._horizon = int(np.searchsorted(-elevation, 0.0))
        # Above the far tree line and below the nearest crowns the background of a trunk is the sky.
        above = (elevation > math.radians(6.0)) & (elevation < math.radians(13.0))
        self._above = slice(int(np.argmax(above)), int(np.argmax(above) + above.sum()))

    def detect(self, image: Image, gravity_c: Vector, altitude: float) -> list[Trunk]:
        """Return the trunks in image (H,W,3) uint8 BGR, nearest first.

        gravity_c: (3,) unit vector down, camera frame. altitude: m, camera above the ground.
        """
        if not altitude > 0.1 or not np.isfinite(gravity_c).all():
            return []
        level = LevelFrame.along(gravity_c)
        view, seen = self._panorama.resample(image, level)
        columns = self._scan(view, seen, altitude)
        trunks = [
            trunk
            for first, last in _runs(columns, self.settings.max_range)
            if (trunk := self._fit(columns, first, last, altitude, level)) is not None
        ]
        return sorted(trunks, key=lambda trunk: trunk.distance - trunk.radius)

    def _scan(self, view: Image, seen: Mask, altitude: float) -> _Columns:
        """Return the panorama's columns, each split at the foot of the object in it."""
        h = self._horizon
        # Columns become rows: sums down a column then run over adjacent memory.
        blue, green, red = (cv2.transpose(plane) for plane in cv2.split(cv2.blur(view, (3, 3))))
        high = np.asarray(cv2.max(red, green), np.uint8)
        # A neighbour's marker is neither bark nor ground; the pixels behind it stay unknown.
        known = seen.T & (cv2.subtract(cv2.min(red, blue), green) < 28)
        warmth = np.asarray(cv2.divide(cv2.subtract(high, blue), high, scale=255.0), np.uint8)
        below, known_below = np.ascontiguousarray(warmth[:, h:]), known[:, h:]
        stands, above = self._stands(high, warmth, known)
        threshold = self._threshold(below, known_below, warmth, known, above)
        ground = (below > threshold[:, None]) & known_below
        vote = 2 * ground.view(np.int8) - known_below.astype(np.int8)
        # Misfits of a foot at row k, bark above and ground below: cumulated votes and a constant.
        running = np.zeros((vote.shape[0], vote.shape[1] + 1), np.int16)
        np.cumsum(vote, axis=1, dtype=np.int16, out=running[:, 1:])
        foot_row = np.argmin(running, axis=1)
        rows = np.arange(vote.shape[1])
        after = rows >= foot_row[:, None]
        ground_below = np.count_nonzero(ground & after, axis=1)
        known_after = np.count_nonzero(known_below & after, axis=1)
        e = self._panorama.elevation[h:]
        edge_row = self._sub_row(below, foot_row, threshold)
        slope = np.tan(-(e[0] + edge_row * (e[1] - e[0])))
        t = altitude / np.maximum(slope, 1e-3)
        t[foot_row == 0] = np.inf
        blind = np.count_nonzero(known_below, axis=1) < 6
        # Without ground in view, an object before the sky may be near.
        t = np.where(blind & above, 2.0 * self.settings.max_range, t)
        return _Columns(
            self._panorama.azimuth,
            np.where(stands, t, np.inf),
            (ground_below >= 5) & (ground_below > 0.7 * known_after) & ~blind,
            ~blind | above,
            self._edges(high, known),
        )

    def _threshold(
        self, below: Image, known_below: Mask, warmth: Image, known: Mask, above: Mask
    ) -> Vector:
        """Return per column the saturation (of 255) that tells ground from bark.

        It follows from the ground of this frame, and from the bark before the sky in the column.
        """
        sample = below[::4, below.shape[1] // 3 :: 3][known_below[::4, below.shape[1] // 3 :: 3]]
        # A high percentile: a near trunk may fill more than half of the lower picture.
        typical = float(np.percentile(sample, 75)) if sample.size > 50 else 128.0
        common = min(max(self.settings.ground_share * typical, 78.0), 96.0)
        ok = known[:, self._above]
        bark = np.where(ok, warmth[:, self._above], 0).sum(axis=1) / np.maximum(ok.sum(axis=1), 1)
        own = np.minimum(bark + 0.35 * (typical - bark), 0.85 * typical)
        return np.where(above, np.maximum(own, common), common)

    def _edges(self, high: Image, known: Mask) -> Vector:
        """Return the mean upright contrast of neighbouring columns around the horizon; last: 0."""
        band = slice(0, self._horizon + 30)
        grey, ok = high[:, band].astype(np.int16), known[:, band]
        both = ok[1:] & ok[:-1]
        step = np.where(both, grey[1:] - grey[:-1], 0).sum(axis=1)
        contrast = np.abs(step) / np.maximum(np.count_nonzero(both, axis=1), 8)
        return np.append(contrast, 0.0)

    @staticmethod
    def _sub_row(below: Image, foot_row: NDArray[np.intp], threshold: Vector) -> Vector:
        """Return the foot's row, between pixels, where the colour passes the threshold."""
        k = np.clip(foot_row, 1, below.shape[1] - 1)
        cols = np.arange(below.shape[0])
        a, b = below[cols, k - 1].astype(float), below[cols, k].astype(float)
        part: Vector = np.clip((threshold - a) / np.maximum(b - a, 5.0), 0.0, 1.0)
        return part + k - 1.0

    def _stands(self, high: Image, warmth: Image, known: Mask) -> tuple[Mask, Mask]:
        """Return the columns whose object may rise above the horizon, and those where it does."""
        band, ok = high[:, self._above], known[:, self._above]
        covered = np.count_nonzero(ok, axis=1)
        if covered.sum() < 50:
            return np.ones(len(band), bool), np.zeros(len(band), bool)
        sky = float(np.percentile(band[::4, ::2], 90))
        # Sky and cloud are bright and never warmer than neutral.
        dark = np.count_nonzero(((band < 0.72 * sky) | (warmth[:, self._above] > 30)) & ok, axis=1)
        tall: Mask = dark >= 0.5 * covered
        return tall | (covered < 4), tall & (covered >= 4)

    def _fit(
        self, columns: _Columns, first: int, last: int, altitude: float, level: LevelFrame
    ) -> Trunk | None:
        """Return the trunk in a run of columns first…last; None where it is none."""
        s = self.settings
        step = float(columns.azimuth[1] - columns.azimuth[0])
        low, high = columns.azimuth[first] - step / 2, columns.azimuth[last] + step / 2
        t, az = columns.t[first : last + 1], columns.azimuth[first : last + 1]
        foot = columns.foot[first : last + 1]
        if high - low < math.radians(s.min_width_deg):
            return None
        free_low, free_high = _free(columns, first, -1), _free(columns, last, 1)
        free = (free_low, free_high)
        if all(free) and foot.any():
            axis, sine = (low + high) / 2, math.sin(min((high - low) / 2, 1.45))
        else:
            axis, sine = _assumed(t, az, foot, (low, high), free, s.radius)
        delta = np.sin(az - axis)
        inner = np.abs(delta) < 0.8 * sine
        use = inner & foot
        assumed = use.sum() < max(2, 0.25 * inner.sum())
        if not assumed:
            shape = np.cos(az[use] - axis) - np.sqrt(sine * sine - delta[use] ** 2)
            distance = float(np.sort(t[use] / np.maximum(shape, 0.02))[np.count_nonzero(use) // 2])
            radius = distance * sine
            surface = distance - radius
            tilt = (surface * surface + altitude * altitude) / altitude
            noise = math.hypot(s.attitude_sigma, step / math.sqrt(use.sum()))
            sigma = math.hypot(0.02 * distance, tilt * noise)
        else:
            # The foot is out of the picture: the width and the assumed radius give the distance.
            distance = s.radius / max(sine, 1e-3)
            radius, sigma = s.radius, (0.1 if all(free) else 0.2) * distance + 0.1
            # Only near trunks are wide enough to be measured by width alone.
            if distance - radius > 0.6 * s.max_range:
                return None
        if not s.min_radius <= radius <= s.max_radius or distance - radius > s.max_range:
            return None
        return Trunk(level.direction(float(axis)), distance, radius, sigma, assumed)


def _runs(columns: _Columns, max_range: float) -> list[tuple[int, int]]:
    """Return the runs first…last of neighbouring columns with like distances."""
    # The margin keeps the limbs of a trunk at the limit.
    near = columns.seen & (columns.t < 1.3 * max_range)
    near |= columns.seen & ~columns.foot & np.isfinite(columns.t)
    # A single column lost to noise does not part a trunk.
    near[1:-1] |= near[:-2] & near[2:]
    t = np.where(near, np.minimum(columns.t, 2.0 * max_range), np.inf)
    both = columns.foot[1:] & columns.foot[:-1]
    with np.errstate(invalid="ignore"):
        rise = np.diff(t)
        jump = np.abs(rise) > 0.35 + 0.12 * np.minimum(t[1:], t[:-1])
    # Without a foot, t is only an upper bound: a foot beyond it parts two trunks, as an upright
    # edge does.
    farther = jump & np.where(rise > 0, columns.foot[1:], columns.foot[:-1])
    edge = columns.edge[:-1]
    crest = (edge > EDGE) & (edge >= np.roll(edge, 1)) & (edge >= np.roll(edge, -1))
    part = np.where(both, jump, crest | farther) & near[1:] & near[:-1]
    bounds = np.flatnonzero((near[1:] != near[:-1]) | part) + 1
    return [(a, b - 1) for a, b in itertools.pairwise([0, *bounds.tolist(), len(t)]) if near[a]]


def _free(columns: _Columns, index: int, side: int) -> bool:
    """Return whether the edge at a run's end is the trunk's own: its background is farther."""
    beyond = index + side
    if not 0 <= beyond + side < len(columns.t) or not columns.seen[[beyond, beyond + side]].all():
        return False
    if not (columns.foot[index] and columns.foot[beyond]):
        return True
    return bool(columns.t[beyond] > columns.t[index])


def _assumed(
    t: Vector,
    az: Vector,
    foot: Mask,
    ends: tuple[float, float],
    free: tuple[bool, bool],
    radius: float,
) -> tuple[float, float]:
    """Return the axis' azimuth and sin β of a trunk of assumed radius, only partly in view.

    Of the distances tried, largest first, the best profile fits t(az): equal where the foot is
    seen, not beyond t where it is not, and wide enough for the columns covered.
    """
    distance = radius * TRIED
    sine = radius / distance
    beta = np.arcsin(sine)
    low, high = ends
    axis = np.full_like(beta, (low + high) / 2)
    if free[0] and not free[1]:
        axis = low + beta
    elif free[1] and not free[0]:
        axis = high - beta
    # Columns outside the profile cost as much as a wrong distance. A cut trunk is wider.
    width = (high - low) * (1.0 if foot.any() else CUT_WIDTH)
    short = np.maximum(width - 2.0 * beta, 0.0)
    if all(free):
        short = np.abs((high - low) / 2 - beta)
    delta = az[None] - axis[:, None]
    root = np.sqrt(np.maximum(sine[:, None] ** 2 - np.sin(delta) ** 2, 0.0))
    model = distance[:, None] * (np.cos(delta) - root)
    error = np.where(foot, np.minimum(np.abs(model - t), 0.5), np.clip(model - 1.03 * t, 0.0, 0.5))
    cost = error.mean(axis=1) + distance * short
    best = int(np.argmax(cost <= cost.min() + 0.01))
    return float(axis[best]), float(sine[best])
