"""A level panorama of a fisheye frame: columns are azimuth, rows elevation.

The horizon is a straight row and every vertical edge of the world a straight column, at any
attitude of the drone. The camera frame is x right, y down, z forward.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.perception.camera import Camera
from companion.types import Image
from mavlink_bridge.shared.arrays import Vector, norm

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
        return LevelFrame(forward, np.cross(down, forward), down)

    def direction(self, azimuth: float) -> Vector:
        """Return the horizontal unit vector (3,) at `azimuth` [rad], positive to the right."""
        result: Vector = np.cos(azimuth) * self.forward + np.sin(azimuth) * self.right
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
        az, el = np.meshgrid(
            -azimuth + np.arange(cols // KNOT + 1) * pitch, top + np.arange(rows // KNOT + 1) * drop
        )
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

    def resample(self, image: Image, level: LevelFrame) -> tuple[Image, NDArray[np.bool_]]:
        """Return the panorama of a frame (H,W,3), and the mask (rows,cols) that it covers.

        It is (rows,cols,4), its fourth channel of no meaning: four are resampled in half the time.
        """
        f, r, d = self._knots
        # Written out: a matrix product would wake the threads of BLAS for very little work.
        x, y, z = (level.forward[i] * f + level.right[i] * r + level.down[i] * d for i in range(3))
        rho = np.sqrt(x * x + y * y)
        # Beyond the lens the map only has to leave the image steadily.
        theta = np.minimum(np.arctan2(rho, z), self._camera.max_angle + 0.3)
        scale = self._camera.radius(theta) / np.maximum(rho, 1e-9)
        u = _enlarge(self._camera.cx + self._camera.fx * scale * x)
        v = _enlarge(self._camera.cy + self._camera.fy * scale * y)
        height, width = image.shape[:2]
        seen = (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
        four = cv2.cvtColor(image, cv2.COLOR_BGR2BGRA)
        cut = cv2.remap(four, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return cut, seen  # type: ignore[return-value]


def _enlarge(knots: Vector) -> NDArray[np.float32]:
    """Return values at every pixel from those at the knots, bilinear."""
    half = KNOT // 2
    size = (knots.shape[1] * KNOT, knots.shape[0] * KNOT)
    big = cv2.resize(knots.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(big, np.float32)[half:-half, half:-half]
