"""A level panorama cut from a fisheye frame: columns are azimuth, rows elevation.

In it the horizon is a straight row and every vertical edge of the world a straight column,
whatever the drone's attitude. Camera frame: x right, y down, z forward.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.camera import Camera
from companion.types import Image, Vector

KNOT = 8  # pixels of panorama between directions that are projected exactly


@dataclass(frozen=True)
class Level:
    """Axes of the levelled frame in camera axes: forward, right, down, each (3,) unit."""

    forward: Vector
    right: Vector
    down: Vector

    @staticmethod
    def of(gravity_c: Vector) -> Level:
        """Levelled frame whose forward is the camera's axis (its x when it looks along gravity)."""
        down = np.asarray(gravity_c, float) / np.linalg.norm(gravity_c)
        axis = np.array([0.0, 0.0, 1.0])
        if abs(down[2]) > 0.98:
            axis = np.array([0.0, -1.0, 0.0]) * np.sign(down[2])
        forward = axis - (axis @ down) * down
        forward /= np.linalg.norm(forward)
        return Level(forward, np.cross(down, forward), down)

    def direction(self, azimuth: float) -> Vector:
        """(3,) horizontal unit vector, azimuth [rad] positive to the right."""
        result: Vector = np.cos(azimuth) * self.forward + np.sin(azimuth) * self.right
        return result


class Panorama:
    """Resampling of frames of one camera onto a fixed grid of azimuth and elevation."""

    def __init__(
        self, camera: Camera, azimuth: float, top: float, bottom: float, step: float
    ) -> None:
        """Azimuths −azimuth…azimuth, elevations top…bottom, both about `step` apart [rad]."""
        self._camera = camera
        cols = int(np.ceil(2 * azimuth / step / KNOT)) * KNOT + 1
        rows = int(np.ceil((top - bottom) / step / KNOT)) * KNOT + 1
        self.azimuth = np.linspace(-azimuth, azimuth, cols)
        self.elevation = np.linspace(top, bottom, rows)
        az, el = np.meshgrid(self.azimuth[::KNOT], self.elevation[::KNOT])
        # Levelled components forward, right, down of the exactly projected directions.
        self._knots = np.stack(
            [np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), -np.sin(el)], axis=-1
        ).reshape(-1, 3)
        self._rows, self._cols = _linear(rows), _linear(cols)

    def look(self, image: Image, level: Level) -> tuple[Image, NDArray[np.bool_]]:
        """Panorama (rows, cols, 3) of a frame and where (rows, cols) the frame covers it."""
        axes = np.stack([level.forward, level.right, level.down])
        x, y, z = (self._knots @ axes).T
        rho = np.sqrt(x * x + y * y)
        # Beyond the lens the map only has to leave the image steadily.
        theta = np.minimum(np.arctan2(rho, z), self._camera.max_angle + 0.3)
        scale = self._camera.radius(theta) / np.maximum(rho, 1e-9)
        shape = (self._rows.shape[1], self._cols.shape[1])
        u = self._spread((self._camera.cx + self._camera.fx * scale * x).reshape(shape))
        v = self._spread((self._camera.cy + self._camera.fy * scale * y).reshape(shape))
        height, width = image.shape[:2]
        seen = (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
        cut = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return cut, seen  # type: ignore[return-value]

    def _spread(self, knots: Vector) -> NDArray[np.float32]:
        """Values at the knots → values at every pixel, bilinear."""
        result: NDArray[np.float32] = self._rows @ knots.astype(np.float32) @ self._cols.T
        return result


def _linear(n: int) -> NDArray[np.float32]:
    """(n, knots) weights of linear interpolation from every KNOT-th of n samples."""
    at = np.arange(n) / KNOT
    knots = np.arange((n - 1) // KNOT + 1)
    return np.maximum(1.0 - np.abs(at[:, None] - knots), 0.0).astype(np.float32)
