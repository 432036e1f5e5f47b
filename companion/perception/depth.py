"""Trunks, and ranges to all other surfaces, from a depth image.

The image shows the camera's own view, at any resolution. Around the drone's height it is read as a
level scan, much as a lidar's. Stretches of the scan that are round and nearer than their background
are trunks. All other surfaces stay ranges, which `estimation.surface_map` remembers.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from companion.perception.camera import Camera
from companion.perception.ground_plane import LEVEL, GroundPlane
from companion.types import Detection, Ranges, Trunk
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import StrictModel

_STEP = math.radians(1.5)  # of the level scan: no coarser depth image has gaps in it
_BINS = round(2.0 * math.pi / _STEP)


class DepthConfig(StrictModel):
    """How a depth image becomes trunks and ranges."""

    range: float = Field(8.0, gt=0, description="Farther ranges [m] are not used.")
    ground: float = Field(0.35, ge=0, description="Surfaces lower than this [m] are ground.")
    band: float = Field(0.5, gt=0, description="Height [m] of the scan above and below the drone.")
    tall: float = Field(
        0.5,
        ge=0,
        description="Least height [m] that a trunk shows in the scan; less near the ground.",
    )
    jump: float = Field(
        0.3, gt=0, description="Step [m] that parts two objects; 5 % of the range is added."
    )
    roundness: float = Field(0.06, gt=0, description="Largest mean misfit [m] of a trunk.")
    max_radius: float = Field(2.5, gt=0, description="Larger radii [m] count as walls.")
    neighbour: float = Field(
        0.45, gt=0, description="Surfaces this near [m] to a detection are the drone."
    )
    checks_drones: bool = Field(
        True,
        description="Whether a find counts only where the depth image shows something of a "
        "drone's size, whose range it takes over. Not for `color`; off for a depth camera too "
        "coarse for that.",
    )


class DepthReader:
    """Reads the depth images of one camera."""

    def __init__(self, camera: Camera, config: DepthConfig) -> None:
        self._camera = camera
        self._config = config
        self._rays: NDArray[np.float32] = np.zeros((0, 0, 3), np.float32)

    def read(
        self,
        depth: NDArray[np.float32],
        r_wc: Vector,
        altitude: float,
        drones: Sequence[Detection],
        ground: GroundPlane = LEVEL,
    ) -> tuple[list[Trunk], Ranges]:
        """Return the trunks, nearest first, and the ranges (h/2,w/2) m to all surfaces.

        depth: (h,w) m along each pixel's ray; inf where the view is free; NaN or ≤ 0 where the
        camera cannot tell. r_wc: (3,3) camera → world. altitude: m above ground. drones: detected
        in the same frame. ground: its slope is used. Ranges are inf where the view is free up to
        `range`, and NaN where that is unknown, as behind a drone.
        """
        if self._rays.shape[:2] != depth.shape:
            self._rays = self._camera.scaled(depth.shape[1], depth.shape[0]).directions
        c = self._config
        far = depth > c.range
        ranges = np.where(far, np.inf, np.where(depth > 0.0, depth, np.nan)).astype(np.float64)
        self._hide(ranges, drones)
        with np.errstate(invalid="ignore"):
            offsets = (self._rays @ r_wc.T) * np.where(far, 0.0, ranges)[..., None]
        ranges[altitude - ground.drop(offsets) < c.ground] = np.inf
        trunks = self._trunks(offsets[np.isfinite(ranges)], r_wc, altitude)
        return trunks, _halved(ranges).astype(np.float16)

    def _hide(self, ranges: Vector, drones: Sequence[Detection]) -> None:
        """Set to NaN, in place, the ranges (h,w) that a neighbour may cover."""
        c = self._config
        for drone in drones:
            cosine = math.cos(math.atan2(c.neighbour, drone.range))
            near = np.abs(ranges - drone.range) < c.neighbour + 0.15 * drone.range
            ranges[near & (self._rays @ drone.direction > cosine)] = np.nan

    def _trunks(self, offsets: Vector, r_wc: Vector, altitude: float) -> list[Trunk]:
        """Return the round, tall objects in the level scan of surface points.

        offsets: (n,3) m, world axes, from the camera. A round object that is not tall is an
        undetected neighbour, most often at the edge of the picture.
        """
        c = self._config
        x, y, z = offsets[np.abs(offsets[:, 2]) < c.band].T
        scan = np.full(_BINS, np.inf)
        bins = ((np.arctan2(y, x) + math.pi) / _STEP).astype(int) % _BINS
        far = np.hypot(x, y)
        np.minimum.at(scan, bins, far)
        first = far < scan[bins] + c.jump  # without the background
        top, foot = np.full(_BINS, -np.inf), np.full(_BINS, np.inf)
        np.maximum.at(top, bins[first], z[first])
        np.minimum.at(foot, bins[first], z[first])
        shown = c.band + min(c.band, altitude - c.ground)
        tall = min(c.tall, 0.8 * shown)
        runs = [run for run in self._runs(scan) if top[run].max() - foot[run].min() >= tall]
        found = [t for run in runs if (t := self._fit(scan, run, r_wc)) is not None]
        return sorted(found, key=lambda t: t.distance - t.radius)

    def _runs(self, scan: Vector) -> list[NDArray[np.int_]]:
        """Return the bins of each object in the scan, cut where it jumps; around the seam, too."""
        following = np.roll(scan, -1)
        near = np.minimum(scan, following)
        with np.errstate(invalid="ignore"):
            cut = ~(np.abs(following - scan) < self._config.jump + 0.05 * near)
        ends = np.flatnonzero(cut)
        pairs = itertools.pairwise([*ends.tolist(), *(ends[:1] + _BINS).tolist()])
        runs = [np.arange(a + 1, b + 1) % _BINS for a, b in pairs]
        return [run for run in runs if np.isfinite(scan[run[0]])]

    def _fit(self, scan: Vector, run: NDArray[np.int_], r_wc: Vector) -> Trunk | None:
        """Return the trunk that a run of bins shows, if it is round and hides its background."""
        t = scan[run]
        beyond = scan[[run[0] - 1, (run[-1] + 1) % _BINS]]
        if len(run) < 3 or (beyond < t[[0, -1]]).any():
            return None
        half = len(run) * _STEP / 2
        sine = math.sin(min(half, 1.45))
        delta = (np.arange(len(run)) - (len(run) - 1) / 2) * _STEP
        root = np.sqrt(np.maximum(sine * sine - np.sin(delta) ** 2, 0.0))
        inner = np.abs(delta) < 0.9 * half
        shape = np.maximum(np.cos(delta) - root, 0.02)[inner]
        distance = float(np.median(t[inner] / shape))
        misfit = float(np.abs(t[inner] - distance * shape).mean())
        radius = distance * sine
        if radius > self._config.max_radius or misfit > self._config.roundness + 0.015 * distance:
            return None
        azimuth = (run[0] + len(run) / 2) * _STEP - math.pi
        level = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        sigma = 0.03 + distance * (0.01 + 0.5 * _STEP)
        return Trunk(level @ r_wc, distance, radius, sigma)


def _halved(ranges: Vector) -> Vector:
    """Return (h/2,w/2): the mean of each four ranges; the nearest where they differ much."""
    h, w = ranges.shape[0] // 2, ranges.shape[1] // 2
    four = ranges[: 2 * h, : 2 * w].reshape(h, 2, w, 2)
    nearest = four.min(axis=(1, 3))
    with np.errstate(invalid="ignore"):
        alike = four.max(axis=(1, 3)) < 1.1 * nearest + 0.1
        halved: Vector = np.where(alike, four.mean(axis=(1, 3)), nearest)
    return halved
