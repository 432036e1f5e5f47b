"""A level panorama of a fisheye frame: columns are azimuth, rows elevation.

The horizon is a straight row and every vertical edge of the world a straight column, at any
attitude of the drone. Arrays have the column first, so that sums down a column run over adjacent
memory. The camera frame is x right, y down, z forward.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.perception.camera import Camera
from companion.types import Image
from mavlink_bridge.shared.arrays import Vector, cross, norm

LEVEL_GROUND = np.zeros(3)  # m/m, its rise
KNOT = 8  # pixels of panorama between directions that are projected exactly


@dataclass(frozen=True)
class LevelFrame:
    """Axes of the levelled frame, each a (3,) unit vector in camera axes."""

    forward: Vector
    right: Vector
    down: Vector

    @staticmethod
    def along(gravity_c: Vector) -> LevelFrame:
        """Return the frame whose down is gravity_c (3,), camera frame.

        Its forward is the camera's axis; the camera's −y where the camera looks along gravity.
        """
        down = np.asarray(gravity_c, float) / norm(gravity_c)
        axis = np.array([0.0, 0.0, 1.0])
        if abs(down[2]) > 0.98:
            axis = np.array([0.0, -1.0, 0.0]) * np.sign(down[2])
        forward = axis - (axis @ down) * down
        forward /= norm(forward)
        return LevelFrame(forward, cross(down, forward), down)

    def direction(self, azimuth: float) -> Vector:
        """Return the horizontal unit vector (3,) at `azimuth` [rad], positive to the right."""
        result: Vector = math.cos(azimuth) * self.forward + math.sin(azimuth) * self.right
        return result


class Panorama:
    """Resamples frames of one camera onto a fixed grid of azimuth and elevation."""

    def __init__(
        self, camera: Camera, azimuth: float, top: float, bottom: float, step: float
    ) -> None:
        """Span −azimuth…azimuth and top…bottom of elevation, both about `step` apart [rad]."""
        self._camera = camera
        cols = int(np.ceil(2 * azimuth / step / KNOT)) * KNOT
        rows = int(np.ceil((top - bottom) / step / KNOT)) * KNOT
        # Enlarging by KNOT puts pixel i at knot (i + ½)/KNOT − ½; half a knot is cut off all round.
        at = (np.arange(KNOT // 2, cols + KNOT // 2) + 0.5) / KNOT - 0.5
        down = (np.arange(KNOT // 2, rows + KNOT // 2) + 0.5) / KNOT - 0.5
        pitch, drop = 2 * azimuth * KNOT / cols, (bottom - top) * KNOT / rows
        self.azimuth, self.elevation = -azimuth + at * pitch, top + down * drop
        el, az = np.meshgrid(
            top + np.arange(rows // KNOT + 1) * drop, -azimuth + np.arange(cols // KNOT + 1) * pitch
        )
        # Rows that a panorama has whatever the frame covers: some way below the horizon.
        self._least = int(np.searchsorted(-self.elevation, 0.0)) + 2 * KNOT
        # Levelled components forward, right, down of the exactly projected directions.
        self._knots = np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), -np.sin(el)])

    @staticmethod
    def around_feet(camera: Camera, step: float) -> Panorama:
        """Return the panorama in which the feet of obstacles are sought, `step` [rad] a pixel."""
        side = min(camera.max_angle, np.radians(92.0))
        return Panorama(camera, side, np.radians(14.0), np.radians(-76.0), step)

    def along(self, gradient_c: Vector, level: LevelFrame) -> Vector:
        """Return how much a quantity grows per metre along each column (n,).

        gradient_c: (3,), horizontal, camera frame. level: the panorama's axes.
        """
        ahead, aside = float(level.forward @ gradient_c), float(level.right @ gradient_c)
        return np.cos(self.azimuth) * ahead + np.sin(self.azimuth) * aside

    def resample(
        self, image: Image, level: LevelFrame, interpolation: int = cv2.INTER_LINEAR
    ) -> tuple[Image, NDArray[np.bool_]]:
        """Return the panorama of a frame (H,W,4), and the mask (cols,rows) that it covers.

        It is (cols,rows,4), without the lowest rows where the frame covers nothing of them. Four
        channels are resampled in half the time of three. interpolation: OpenCV's.
        """
        f, r, d = self._knots
        # Written out: a matrix product would wake the threads of BLAS for very little work.
        x, y, z = (level.forward[i] * f + level.right[i] * r + level.down[i] * d for i in range(3))
        rho = np.sqrt(x * x + y * y)
        # Beyond the lens the map only has to leave the image steadily.
        theta = np.minimum(np.arctan2(rho, z), self._camera.max_angle + 0.3)
        scale = self._camera.radius(theta) / np.maximum(rho, 1e-9)
        height, width = image.shape[:2]
        at = np.empty((*rho.shape, 2), np.float32)
        at[..., 0] = self._camera.cx + self._camera.fx * scale * x
        at[..., 1] = self._camera.cy + self._camera.fy * scale * y
        covered = (at[..., 1] <= height - 1).any(axis=0).nonzero()[0]
        knots = max(int(covered[-1]) + 2 if len(covered) else 0, self._least // KNOT + 1)
        pixels = _enlarge(at[:, :knots])
        seen = cv2.inRange(pixels, (0, 0, 0, 0), (width - 1, height - 1, 0, 0)) > 0
        cut = cv2.remap(image, pixels, None, interpolation, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
        return np.asarray(cut, np.uint8), seen


def _enlarge(knots: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return pairs of values (cols,rows,2) at every pixel from those at the knots, bilinear."""
    half = KNOT // 2
    size = (knots.shape[1] * KNOT, knots.shape[0] * KNOT)
    big = cv2.resize(knots, size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(big, np.float32)[half:-half, half:-half]
