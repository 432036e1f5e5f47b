"""Tree trunks in one frame, from pixels: where bark meets the ground says how far it is.

The frame is levelled (`panorama`). Each of its columns is split into bark above and ground below;
the foot's elevation and the altitude above ground give a distance per column, much as a lidar
would. Neighbouring columns of like distance form a trunk; its two edges give the radius:

    t(Δ) = d (cos Δ − √(sin² β − sin² Δ)),   sin β = r / d

with d the distance to the axis, β half the angular width, Δ the azimuth from the axis, t the
distance to the surface.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.camera import Camera
from companion.panorama import Level, Panorama
from companion.types import Image, Trunk, Vector

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class TrunkSettings:
    """What trunks and ground look like, and how far to look.

    radius: m, assumed where only one edge of a trunk shows. max_range: m, to the surface.
    step: rad, of the panorama. min_width: rad. ground_share: of the ground's own saturation that a
    pixel needs to count as ground. attitude_sigma: rad, error of gravity_c.
    min_radius, max_radius: m, wider or thinner things are no trunks.
    """

    radius: float = 1.0
    max_range: float = 12.0
    step: float = math.radians(0.45)
    min_width: float = math.radians(2.5)
    ground_share: float = 0.62
    attitude_sigma: float = 0.006
    min_radius: float = 0.08
    max_radius: float = 2.5


@dataclass(frozen=True)
class _Columns:
    """Per column of the panorama: t: m to the foot (inf: open); foot: whether the foot is seen
    (else t is an upper bound); seen: whether the frame covers the column at all.
    """  # noqa: D205

    azimuth: Vector
    t: Vector
    foot: Mask
    seen: Mask


class TrunkDetector:
    """Finds vertical trunks by their ground contact and edges."""

    def __init__(self, camera: Camera, settings: TrunkSettings | None = None) -> None:
        self.settings = settings or TrunkSettings()
        top, bottom = math.radians(14.0), math.radians(-76.0)
        side = min(camera.max_angle, math.radians(92.0))
        self._panorama = Panorama(camera, side, top, bottom, self.settings.step)
        elevation = self._panorama.elevation
        self._horizon = int(np.searchsorted(-elevation, 0.0))
        # Above the far tree line and below the nearest crowns a trunk stands before the sky.
        above = (elevation > math.radians(6.0)) & (elevation < math.radians(13.0))
        self._above = slice(int(np.argmax(above)), int(np.argmax(above) + above.sum()))

    def detect(self, image: Image, gravity_c: Vector, altitude: float) -> list[Trunk]:
        """Trunks in image (H,W,3) uint8 BGR, nearest first.

        gravity_c: (3,) unit vector down, camera frame. altitude: m, camera above the ground.
        """
        if not altitude > 0.1 or not np.isfinite(gravity_c).all():
            return []
        level = Level.of(gravity_c)
        view, seen = self._panorama.look(image, level)
        columns = self._scan(view, seen, altitude)
        trunks = [
            trunk
            for first, last in _runs(columns, self.settings.max_range)
            if (trunk := self._fit(columns, first, last, altitude, level)) is not None
        ]
        return sorted(trunks, key=lambda trunk: trunk.distance - trunk.radius)

    def _scan(self, view: Image, seen: Mask, altitude: float) -> _Columns:
        """Split each column of the panorama at the foot of what stands in it."""
        s, h = self.settings, self._horizon
        blue, green, red = cv2.split(cv2.blur(view, (3, 3)))
        high: Image = cv2.max(red, green)  # type: ignore[assignment]
        warmth = cv2.subtract(high, blue).astype(np.float32) / np.maximum(high, 1)
        # A neighbour's marker is neither bark nor ground; what it hides stays unknown.
        known = seen & (cv2.subtract(cv2.min(red, blue), green) < 28)
        below, known_below = warmth[h:], known[h:]
        rows = below.shape[0]
        sample = below[rows // 3 :: 3, ::4][known_below[rows // 3 :: 3, ::4]]
        typical = float(np.median(sample)) if sample.size > 50 else 0.5
        threshold = min(max(s.ground_share * typical, 0.26), 0.42)
        vote = np.where(known_below, np.where(below > threshold, 1, -1), 0).astype(np.int32)
        # Foot at row k: all above bark, all below ground. Mistakes(k) − const = cumulated votes.
        running = np.zeros((rows + 1, vote.shape[1]), np.int32)
        np.cumsum(vote, axis=0, out=running[1:])
        foot_row = np.argmin(running, axis=0)
        ground_below = (vote > 0).sum(axis=0) - np.take_along_axis(
            np.cumsum(vote > 0, axis=0), np.maximum(foot_row - 1, 0)[None], axis=0
        )[0]
        e = self._panorama.elevation[h:]
        edge = self._sub_row(below, foot_row, threshold)
        slope = np.tan(-(e[0] + (edge - 0.5) * (e[1] - e[0])))
        t = altitude / np.maximum(slope, 1e-3)
        t[foot_row == 0] = np.inf
        return _Columns(
            self._panorama.azimuth,
            np.where(self._stands(high, known), t, np.inf),
            ground_below >= 3,
            known_below.sum(axis=0) > 8,
        )

    @staticmethod
    def _sub_row(below: Vector, foot_row: NDArray[np.intp], threshold: float) -> Vector:
        """Foot between rows, from where the colour passes the threshold."""
        k = np.clip(foot_row, 1, below.shape[0] - 1)
        cols = np.arange(below.shape[1])
        a, b = below[k - 1, cols], below[k, cols]
        rise = np.maximum(b - a, 0.02)
        return np.clip((threshold - a) / rise, 0.0, 1.0) + k - 0.5

    def _stands(self, high: Image, known: Mask) -> Mask:
        """Columns whose content rises above the horizon, dark against the sky."""
        band, ok = high[self._above], known[self._above]
        if ok.sum() < 50:
            return np.ones(band.shape[1], bool)
        sky = float(np.percentile(band[::2, ::4], 90))
        dark = (band < 0.72 * sky) & ok
        covered = ok.sum(axis=0)
        result: Mask = (dark.sum(axis=0) >= 0.5 * covered) | (covered < 4)
        return result

    def _fit(
        self, columns: _Columns, first: int, last: int, altitude: float, level: Level
    ) -> Trunk | None:
        """One run of columns [first, last] → trunk."""
        s = self.settings
        step = float(columns.azimuth[1] - columns.azimuth[0])
        low, high = columns.azimuth[first] - step / 2, columns.azimuth[last] + step / 2
        t, az = columns.t[first : last + 1], columns.azimuth[first : last + 1]
        foot = columns.foot[first : last + 1]
        if high - low < s.min_width:
            return None
        free_low = _free(columns, first, -1, float(t[0]))
        free_high = _free(columns, last, 1, float(t[-1]))
        radius: float | None = None
        if free_low and free_high:
            axis, sine = (low + high) / 2, math.sin(min((high - low) / 2, 1.45))
        else:
            axis, sine = _one_edge(t, az, low, high, free_low, free_high, s.radius)
        delta = np.sin(az - axis)
        inner = np.abs(delta) < 0.8 * sine
        use = inner & foot
        if use.sum() >= max(2, 0.25 * inner.sum()):
            shape = np.cos(az[use] - axis) - np.sqrt(sine * sine - delta[use] ** 2)
            distance = float(np.median(t[use] / np.maximum(shape, 0.02)))
            radius = distance * sine
            surface = distance - radius
            tilt = (surface * surface + altitude * altitude) / altitude
            noise = math.hypot(s.attitude_sigma, step / math.sqrt(use.sum()))
            sigma = math.hypot(0.02 * distance, tilt * noise)
        else:
            # The foot is out of the picture: the width of a trunk of the assumed radius.
            distance = s.radius / max(sine, 1e-3)
            radius, sigma = s.radius, 0.1 * distance + 0.1
        if not s.min_radius <= radius <= s.max_radius or distance - radius > s.max_range:
            return None
        return Trunk(level.direction(float(axis)), distance, radius, sigma)


def _runs(columns: _Columns, max_range: float) -> list[tuple[int, int]]:
    """Stretches of neighbouring columns [first, last] with like distances."""
    near = columns.seen & (columns.t < max_range)
    t = np.where(near, columns.t, np.inf)
    with np.errstate(invalid="ignore"):
        jump = np.abs(np.diff(t)) > 0.35 + 0.12 * np.minimum(t[1:], t[:-1])
    # Where the foot is out of the picture, distances are only bounds and do not separate.
    jump &= columns.foot[1:] & columns.foot[:-1]
    cut = near[1:] != near[:-1]
    bounds = np.flatnonzero(cut | (jump & near[1:] & near[:-1])) + 1
    edges = [0, *bounds.tolist(), len(t)]
    return [(a, b - 1) for a, b in itertools.pairwise(edges) if near[a]]


def _free(columns: _Columns, index: int, side: int, t: float) -> bool:
    """Whether the edge at a run's end is the trunk's own: what lies beyond is farther."""
    beyond = index + side
    if not 0 <= beyond < len(columns.t) or not columns.seen[beyond]:
        return False
    return bool(columns.t[beyond] > t)


def _one_edge(
    t: Vector, az: Vector, low: float, high: float, free_low: bool, free_high: bool, radius: float
) -> tuple[float, float]:
    """Azimuth of the axis and sin β of a trunk of assumed radius that is partly hidden.

    Tries distances and keeps the one whose profile fits t(az) best.
    """
    distance = np.linspace(0.7, 1.4, 29) * (float(np.median(t)) + 0.6 * radius)
    sine = np.minimum(radius / np.maximum(distance, radius * 1.02), 0.99)
    beta = np.arcsin(sine)
    if free_low:
        axis = low + beta
    elif free_high:
        axis = high - beta
    else:
        axis = np.full_like(beta, (low + high) / 2)
    delta = az[None] - axis[:, None]
    root = np.sqrt(np.maximum(sine[:, None] ** 2 - np.sin(delta) ** 2, 0.0))
    model = distance[:, None] * (np.cos(delta) - root)
    best = int(np.argmin(np.median(np.abs(model - t[None]), axis=1)))
    return float(axis[best]), float(sine[best])
