"""Drones of any colour by a small network: a heat map of their centres (detector: cnn).

Each cell of the output stands for 8×8 pixels: heat 0…1, the centre's offset in the cell, the log of
the drone's radius in pixels, and the log of that log's uncertainty. The range follows from the
radius and the lens: a fisheye images the same angle on more pixels off its axis. Source: Zhou et
al., "Objects as Points", 2019.
"""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
from pydantic import Field

from companion.perception.camera import Camera
from companion.perception.networks import ModelError, OnnxNetwork, Tensor, check_scores
from companion.types import Detection, Image
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import StrictModel

WIDTH, HEIGHT, STRIDE, CHANNELS = 640, 400, 8, 5
PACKAGED = Path(__file__).with_name("models") / "drones.onnx"
_HEAT, _DU, _DV, _LOG_SIZE, _LOG_SCALE = range(CHANNELS)
_BRIGHTNESS = 0.4  # mean of a picture, 0…1
_LAPLACE = math.sqrt(2.0)  # σ of a Laplace distribution over its scale


def exposure_gain(image: Image) -> float:
    """Return the gain of a picture (H,W,3) uint8 to the brightness of training, 0.5…3."""
    mean = float(image[::8, ::8].mean()) / 255
    return min(max(_BRIGHTNESS / max(mean, 1e-3), 0.5), 3.0)


class CnnConfig(StrictModel):
    """How the network's output becomes detections."""

    threshold: float = Field(0.5, gt=0, lt=1, description="Least heat of a detection.")
    radius: float = Field(0.2, gt=0, description="m, centre to propeller tip of the neighbours.")
    max_range: float = Field(
        14.0, gt=0, description="Detections farther than this [m] are dropped."
    )
    sigma_pixel: float = Field(0.35, gt=0, description="1 σ [px] of a centre, of a small drone.")


class CnnDetector:
    """Runs the network on a camera's frames.

    Raises:
        ModelError: a file that is missing or not such a network.
    """

    def __init__(self, camera: Camera, config: CnnConfig, model: Path = PACKAGED) -> None:
        self._config = config
        self._camera = camera.scaled(WIDTH, HEIGHT)
        self.network = OnnxNetwork(model, WIDTH, HEIGHT)
        wanted = (1, CHANNELS, HEIGHT // STRIDE, WIDTH // STRIDE)
        if self.network.shape != wanted:
            raise ModelError(
                f"{model}: gives {self.network.shape}, a heat map is {wanted}; "
                "detector: yolo reads models of the YOLO family"
            )

    def detect(self, image: Image) -> list[Detection]:
        """Return the drones in image (H,W,3) uint8 BGR, nearest first."""
        if image.shape[:2] != (HEIGHT, WIDTH):
            image = cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
        return self.read(self.network.run(image, gain=exposure_gain(image))[0])

    def read(self, cells: Tensor) -> list[Detection]:
        """Return the detections of an output (CHANNELS,h,w): its local maxima, each drone once."""
        c = self._config
        heat = cells[_HEAT]
        check_scores(heat)
        highest = cv2.dilate(heat, np.ones((3, 3), np.uint8))
        row, column = np.nonzero((heat >= c.threshold) & (heat >= highest))
        if not len(row):
            return []
        found = cells[:, row, column].astype(float)
        pixels = (np.stack([column + found[_DU], row + found[_DV]], axis=1) + 0.5) * STRIDE - 0.5
        rays = self._camera.unproject(pixels)
        u = np.clip(np.round(pixels[:, 0]), 0, WIDTH - 1).astype(int)
        v = np.clip(np.round(pixels[:, 1]), 0, HEIGHT - 1).astype(int)
        pixel = np.sqrt(self._camera.solid_angle[v, u].astype(float))  # rad per pixel
        ranges = c.radius / (np.exp(found[_LOG_SIZE]) * pixel)
        detections: list[Detection] = []
        for n in np.argsort(-found[_HEAT]).tolist():
            if ranges[n] <= c.max_range and not _known(rays[n], detections, pixel[n], c.radius):
                scale = math.exp(min(max(float(found[_LOG_SCALE, n]), -5.0), 1.0))
                # A near drone's centre is known to a share of its size.
                sigma = pixel[n] * math.hypot(c.sigma_pixel, 0.03 * math.exp(found[_LOG_SIZE, n]))
                sigma_range = ranges[n] * math.hypot(_LAPLACE * scale, 0.01)
                heat_here = float(found[_HEAT, n])
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
