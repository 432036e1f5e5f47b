"""Drones in the output of a network: local maxima of a heat map of their centres.

Each cell stands for 8×8 pixels: heat 0…1, the centre's offset in the cell, the log of the drone's
radius in pixels, and the log of that log's uncertainty. The range follows from the radius and the
lens: a fisheye images the same angle on more pixels off its axis. Source: Zhou et al., "Objects as
Points", 2019.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from companion.perception.camera import Camera
from companion.perception.networks import check_scores
from companion.types import Detection
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import StrictModel

Cells = NDArray[np.float32]
WIDTH, HEIGHT, STRIDE, CHANNELS = 640, 400, 8, 5
_HEAT, _DU, _DV, _LOG_SIZE, _LOG_SCALE = range(CHANNELS)
_LAPLACE = math.sqrt(2.0)  # σ of a Laplace distribution over its scale


class HeatMapConfig(StrictModel):
    """How a heat map becomes detections."""

    threshold: float = Field(0.5, gt=0, lt=1, description="Least heat of a detection.")
    radius: float = Field(0.2, gt=0, description="m, centre to propeller tip of the neighbours.")
    max_range: float = Field(
        14.0, gt=0, description="Detections farther than this [m] are dropped."
    )
    sigma_pixel: float = Field(0.35, gt=0, description="1 σ [px] of a centre, of a small drone.")


class NetworkConfig(HeatMapConfig):
    """The same for the packaged network."""

    threshold: float = Field(0.45, gt=0, lt=1, description="Least heat of a detection.")


class HeatMap:
    """Reads the heat maps (CHANNELS, HEIGHT/STRIDE, WIDTH/STRIDE) of one camera's pictures."""

    def __init__(self, camera: Camera, config: HeatMapConfig) -> None:
        """camera: as the network's pictures show it, at any size."""
        self._config = config
        self._camera = camera.scaled(WIDTH, HEIGHT)

    def peaks(self, cells: Cells) -> tuple[Vector, Vector]:
        """Return pixels (n,2) u, v and values (n,CHANNELS) of the maxima, hottest first.

        Raises:
            SenselessOutput: heat above 1.
        """
        heat = cells[_HEAT]
        check_scores(heat)
        highest = cv2.dilate(heat, np.ones((3, 3), np.uint8))
        row, column = np.nonzero((heat >= self._config.threshold) & (heat >= highest))
        order = np.argsort(-heat[row, column], kind="stable")
        row, column = row[order], column[order]
        found: Vector = cells[:, row, column].T.astype(float)
        at = np.stack([column + found[:, _DU], row + found[:, _DV]], axis=1)
        return (at + 0.5) * STRIDE - 0.5, found

    def read(self, cells: Cells) -> list[Detection]:
        """Return the detections of an output, nearest first; each drone once."""
        c = self._config
        pixels, found = self.peaks(cells)
        if not len(pixels):
            return []
        rays = self._camera.unproject(pixels)
        u = np.clip(np.round(pixels[:, 0]), 0, WIDTH - 1).astype(int)
        v = np.clip(np.round(pixels[:, 1]), 0, HEIGHT - 1).astype(int)
        pixel = np.sqrt(self._camera.solid_angle[v, u].astype(float))  # rad per pixel
        ranges = c.radius / (np.exp(found[:, _LOG_SIZE]) * pixel)
        detections: list[Detection] = []
        for n in range(len(found)):
            if ranges[n] <= c.max_range and not _known(rays[n], detections, pixel[n], c.radius):
                scale = math.exp(min(max(float(found[n, _LOG_SCALE]), -5.0), 1.0))
                # A near drone's centre is known to a share of its size.
                sigma = pixel[n] * math.hypot(c.sigma_pixel, 0.03 * math.exp(found[n, _LOG_SIZE]))
                sigma_range = ranges[n] * math.hypot(_LAPLACE * scale, 0.01)
                heat_here = float(found[n, _HEAT])
                detections.append(
                    Detection(
                        rays[n], float(ranges[n]), float(sigma), float(sigma_range), heat_here
                    )
                )
        return sorted(detections, key=lambda d: d.range)


def _known(ray: Vector, others: list[Detection], pixel: float, radius: float) -> bool:
    """Return whether one of `others` is at `ray` (3,): within half its own size, or a cell."""
    return any(
        float(ray @ d.direction) > math.cos(max(0.5 * radius / d.range, STRIDE * pixel))
        for d in others
    )
