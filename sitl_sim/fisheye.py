"""The simulator's own camera model: one ray per pixel of an equidistant fisheye.

Camera frame C: x right, y down, z forward. Body B: FLU. World W: ENU, z up.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

# Camera → body of a camera that looks along +x_B: the columns are x_C, y_C, z_C in body axes.
R_BC = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def rotation(q: Float64) -> Float64:
    """Unit quaternion (4,) w, x, y, z, body → world, to its matrix (3,3)."""
    w, x, y, z = np.asarray(q, float) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@dataclass(frozen=True)
class Lens:
    """Equidistant fisheye, r = f θ, whose field of view spans the image's width."""

    width: int
    height: int
    fov_deg: float = 160.0

    @property
    def f(self) -> float:
        """Focal length [px/rad]."""
        return float(self.width / np.radians(self.fov_deg))

    @cached_property
    def rays(self) -> Float32:
        """(3, height, width) unit direction of each pixel's centre, camera frame (planes: SIMD)."""
        x = (np.arange(self.width) - (self.width - 1) / 2) / self.f
        y = (np.arange(self.height) - (self.height - 1) / 2) / self.f
        mx, my = np.meshgrid(x, y)
        theta = np.hypot(mx, my)
        scale = np.sinc(theta / np.pi)
        return np.stack([scale * mx, scale * my, np.cos(theta)]).astype(np.float32)
