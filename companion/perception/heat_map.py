"""Drones in the output of a network: local maxima of a heat map of their centres.

Each cell stands for 8×8 pixels: heat 0…1, the centre's offset in the cell, the log of the drone's
radius in pixels, and the log of that log's uncertainty. The range follows from the radius and the
lens: a fisheye images the same angle on more pixels off its axis. Source: Zhou et al., "Objects as
Points", 2019.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

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
SCALES = (-5.0, 1.0)  # of the logarithm of a log size's scale
_UNSURE = 1e-9  # scores are taken to be this far from 0 and 1
# 1 σ of a centre, as a share of the radius: of finds on recorded flights in 13 looks, half are off
# by more than 0.08 of it, in all directions.
_OFF_CENTRE = 0.07
_LAPLACE = math.sqrt(2.0)  # σ of a Laplace distribution over its scale


@dataclass(frozen=True)
class Peaks:
    """n places that could be drones.

    places: (n,2) px, u and v. sizes: (n,) px, radii. scales: (n,) of the sizes' logarithms, as of a
    Laplace distribution. scores: (n,) 0…1.
    """

    places: Vector
    sizes: Vector
    scales: Vector
    scores: Vector

    def __len__(self) -> int:
        return len(self.sizes)

    def and_beside(self, others: Peaks) -> Peaks:
        """Return these, and those of `others` that are farther from all than half their size."""
        apart = np.linalg.norm(others.places[:, None] - self.places[None], axis=2)
        new = (apart > 0.5 * others.sizes[:, None]).all(axis=1)
        return Peaks(
            np.concatenate([self.places, others.places[new]]),
            np.concatenate([self.sizes, others.sizes[new]]),
            np.concatenate([self.scales, others.scales[new]]),
            np.concatenate([self.scores, others.scores[new]]),
        )

    def weighed(self, evidence: Vector) -> Peaks:
        """Return these with other scores, the likeliest first: odds that gain `evidence` (n,)."""
        odds = evidence + self.odds()
        order = np.argsort(-odds, kind="stable")
        scores = 1.0 / (1.0 + np.exp(-odds[order]))
        return Peaks(self.places[order], self.sizes[order], self.scales[order], scores)

    def odds(self) -> Vector:
        """Return the logarithms (n,) of the odds that they are drones."""
        scores = np.clip(self.scores, _UNSURE, 1.0 - _UNSURE)
        return np.asarray(np.log(scores / (1.0 - scores)))

    def rows(self, rows: NDArray[np.intp] | slice) -> Peaks:
        """Return some of them."""
        return Peaks(self.places[rows], self.sizes[rows], self.scales[rows], self.scores[rows])

    def first(self, count: int) -> Peaks:
        """Return the first so many."""
        return self.rows(slice(count))


class HeatMapConfig(StrictModel):
    """How a heat map becomes detections."""

    threshold: float = Field(0.5, gt=0, lt=1, description="Least heat of a detection.")
    radius: float = Field(0.2, gt=0, description="m, centre to propeller tip of the neighbours.")
    max_range: float = Field(
        14.0, gt=0, description="Detections farther than this [m] are dropped."
    )
    sigma_pixel: float = Field(0.35, gt=0, description="1 σ [px] of a centre, of a small drone.")


class NetworkConfig(HeatMapConfig):
    """The same for the packaged network, and what is looked at more closely."""

    threshold: float = Field(
        0.65,
        gt=0,
        lt=1,
        description="Least probability of a detection, after the closer look; with a `model` of "
        "your own there is none, and this is the least heat.",
    )
    looks: int = Field(
        12, ge=1, le=64, description="Places of one picture that are looked at closely, at most."
    )
    every: int = Field(
        1,
        ge=1,
        le=5,
        description="Pictures from one search to the next; in those between it looks closely at "
        "known drones alone. At 2 pictures take 0.8 of the time in the mean, the longest one as "
        "long; 2 % fewer drones to 6 m are tracked, and 8 % more tracks are wrong.",
    )
    least_heat: float = Field(
        0.1, gt=0, lt=1, description="Least heat of a place that is looked at closely."
    )
    level: float = Field(
        0.3,
        ge=0,
        description="Std [m] of the neighbours' heights over the own, until they are seen to fly "
        "otherwise: a find far above or below is likelier something else. 0: heights say nothing.",
    )


class HeatMap:
    """Reads the heat maps (CHANNELS, HEIGHT/STRIDE, WIDTH/STRIDE) of one camera's pictures."""

    def __init__(self, camera: Camera, config: HeatMapConfig) -> None:
        """camera: as the network's pictures show it, at any size."""
        self._config = config
        self._camera = camera.scaled(WIDTH, HEIGHT)

    def peaks(self, cells: Cells) -> Peaks:
        """Return the maxima of a network's output, hottest first.

        Raises:
            SenselessOutput: heat above 1.
        """
        return peaks(cells, self._config.threshold)

    def read(self, cells: Cells) -> list[Detection]:
        """Return the detections of an output, nearest first; each drone once."""
        return self.detections(self.peaks(cells))

    def places(self, offsets_c: Vector) -> Vector:
        """Return where drones at offsets (n,3) m, camera frame, show: (n,2) u, v [px]."""
        return self._camera.project(offsets_c)

    def expected(self, offsets_c: Vector, scales: Vector) -> tuple[Peaks, NDArray[np.bool_]]:
        """Return where drones at offsets (n,3) m, camera frame, must show: those in the picture.

        And which (n,) these are. scales: (n,) of their sizes over the configured one. Nothing
        speaks for them: their scores are 0.
        """
        places = self.places(offsets_c)
        inside = (places >= 0.0) & (places <= [WIDTH - 1, HEIGHT - 1])
        shown = np.asarray(inside.all(axis=1))
        places = places[shown]
        u, v = np.round(places).astype(int).T
        pixel = np.sqrt(self._camera.solid_angle[v, u].astype(float))
        ranges = np.maximum(np.linalg.norm(offsets_c[shown], axis=1), self._config.radius)
        sizes = self._config.radius * scales[shown] / (ranges * pixel)
        return Peaks(places, sizes, np.ones(len(sizes)), np.zeros(len(sizes))), shown

    def detections(self, found: Peaks) -> list[Detection]:
        """Return drones at these places, nearest first; of two at one place the likelier."""
        c = self._config
        if not len(found):
            return []
        rays, ranges, pixel = self.lines(found)
        sigmas = ranges * _range_share(found)
        detections: list[Detection] = []
        for n in range(len(found)):
            if ranges[n] <= c.max_range and not _known(rays[n], detections, pixel[n], c.radius):
                # A near drone's centre is known to a share of its size.
                sigma = pixel[n] * math.hypot(c.sigma_pixel, _OFF_CENTRE * found.sizes[n])
                score = float(found.scores[n])
                detections.append(
                    Detection(rays[n], float(ranges[n]), float(sigma), float(sigmas[n]), score)
                )
        return sorted(detections, key=lambda d: d.range)

    def heights(self, found: Peaks, up_c: Vector) -> tuple[Vector, Vector]:
        """Return how far (n,) m drones at these places are above the camera, and the std (n,) m.

        up_c: (3,) unit, camera frame.
        """
        rays, ranges, _ = self.lines(found)
        up = rays @ up_c
        return ranges * up, ranges * _range_share(found) * np.abs(up)

    def lines(self, found: Peaks) -> tuple[Vector, Vector, Vector]:
        """Return rays (n,3), ranges (n,) m and rad per pixel (n,) of drones at these places."""
        rays = self._camera.unproject(found.places)
        u, v = found.places.T
        u = np.clip(np.round(u), 0, WIDTH - 1).astype(int)
        v = np.clip(np.round(v), 0, HEIGHT - 1).astype(int)
        pixel = np.sqrt(self._camera.solid_angle[v, u].astype(float))
        return rays, self._config.radius / (found.sizes * pixel), pixel


def peaks(cells: Cells, least: float) -> Peaks:
    """Return the maxima of heat from `least` on, in cells (CHANNELS,h,w), hottest first.

    Raises:
        SenselessOutput: heat above 1.
    """
    heat = cells[_HEAT]
    check_scores(heat)
    highest = cv2.dilate(heat, np.ones((3, 3), np.uint8))
    row, column = np.nonzero((heat >= least) & (heat >= highest))
    order = np.argsort(-heat[row, column], kind="stable")
    row, column = row[order], column[order]
    found: Vector = cells[:, row, column].T.astype(float)
    at = np.stack([column + found[:, _DU], row + found[:, _DV]], axis=1)
    return Peaks(
        (at + 0.5) * STRIDE - 0.5,
        np.exp(found[:, _LOG_SIZE]),
        scale_of(found[:, _LOG_SCALE]),
        found[:, _HEAT],
    )


def _range_share(found: Peaks) -> Vector:
    """Return the std (n,) of the ranges, as shares of them."""
    return np.asarray(np.hypot(_LAPLACE * found.scales, 0.01))


def scale_of(logarithms: Vector) -> Vector:
    """Return scales of log sizes from a network's logarithms of them, within what is trained."""
    return np.asarray(np.exp(np.clip(logarithms, *SCALES)))


def _known(ray: Vector, others: list[Detection], pixel: float, radius: float) -> bool:
    """Return whether one of `others` is at `ray` (3,): within half its own size, or a cell."""
    return any(
        float(ray @ d.direction) > math.cos(max(0.5 * radius / d.range, STRIDE * pixel))
        for d in others
    )
