"""The simulator's own camera model: one ray per pixel of an equidistant fisheye.

Camera frame C: x right, y down, z forward. Body B: FLU. World W: ENU, z up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import norm
from mavlink_bridge.shared.frames import rotation_matrix

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

# Camera → body of a camera that looks along +x_B: the columns are x_C, y_C, z_C in body axes.
R_BC = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def rotation(q: Float64) -> Float64:
    """Return the matrix (3,3), body → world, of a quaternion (4,) that need not have length 1."""
    return rotation_matrix(np.asarray(q, float) / norm(q))


@dataclass(frozen=True)
class Lens:
    """Fisheye of the `cv2.fisheye` model; equidistant, r = f θ, where no calibration is given.

    fov_deg: over the image's width. calibration: fx, fy, cx, cy [px], k1…k4.
    """

    width: int
    height: int
    fov_deg: float = 160.0
    calibration: tuple[float, ...] | None = None

    @staticmethod
    def load(path: str | Path) -> Lens:
        """Read the lens of a calibration file (width, height, fx, fy, cx, cy, k1…k4).

        Raises:
            ValueError: the file or a number in it is missing or wrong; the message names the file.
        """
        try:
            data = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
            width, height = int(data["width"]), int(data["height"])
            numbers = [float(data[key]) for key in ("fx", "fy", "cx", "cy")]
            numbers += [float(data.get(f"k{n}", 0.0)) for n in (1, 2, 3, 4)]
        except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path}: cannot be used as calibration: {error!r}") from error
        if not np.isfinite(numbers).all() or min(width, height, *numbers[:2]) <= 0:
            raise ValueError(f"{path}: width, height, fx, fy must be positive and finite")
        flat = Lens(width, height, 160.0, tuple(numbers))
        edge = flat.angle(np.array([width / 2 / numbers[0]]))[0]
        return replace(flat, fov_deg=float(np.degrees(2 * edge)))

    def scaled(self, width: int, height: int) -> Lens:
        """Return the lens with the same view at another image size [px]."""
        if self.calibration is None:
            return Lens(width, height, self.fov_deg)
        su, sv = width / self.width, height / self.height
        fx, fy, cx, cy, *k = self.calibration
        made = (fx * su, fy * sv, (cx + 0.5) * su - 0.5, (cy + 0.5) * sv - 0.5, *k)
        return Lens(width, height, self.fov_deg, made)

    def zoomed(self, factor: float) -> Lens:
        """Return the lens with `factor` times the focal length, and the picture's size."""
        if factor == 1.0:
            return self
        if self.calibration is None:
            return replace(self, fov_deg=self.fov_deg / factor)
        fx, fy, *rest = self.calibration
        made = (fx * factor, fy * factor, *rest)
        return replace(self, fov_deg=self.fov_deg / factor, calibration=made)

    @property
    def f(self) -> float:
        """Focal length [px/rad]; the largest anywhere in the picture where it varies."""
        if self.calibration is None:
            return float(self.width / np.radians(self.fov_deg))
        theta = np.linspace(0.0, np.radians(self.fov_deg) / 2, 50)
        slope = np.gradient(self._radius(theta), theta)
        return float(max(self.calibration[:2]) * max(1.0, slope.max()))

    @property
    def numbers(self) -> Float64:
        """(8,) fx, fy, cx, cy [px], k1…k4."""
        if self.calibration is not None:
            return np.array(self.calibration)
        return np.array([self.f, self.f, (self.width - 1) / 2, (self.height - 1) / 2, 0, 0, 0, 0])

    def angle(self, radius: Float64) -> Float64:
        """Return the angles from the axis [rad] of normalised image radii."""
        if self.calibration is None:
            return radius
        theta = np.linspace(0.0, 2.2, 20001)
        grown = np.maximum.accumulate(self._radius(theta))
        inverse: Float64 = np.interp(radius, grown, theta)
        return inverse

    def project(self, directions: Float64) -> Float64:
        """Return the pixels (n,2) of directions (n,3) in the camera frame."""
        x, y, z = np.asarray(directions, float).reshape(-1, 3).T
        across = np.hypot(x, y)
        theta = np.arctan2(across, z)
        radius = theta if self.calibration is None else self._radius(theta)
        fx, fy, cx, cy = self.numbers[:4]
        scale = radius / np.maximum(across, 1e-9)
        return np.stack([cx + fx * scale * x, cy + fy * scale * y], axis=1)

    def _radius(self, theta: Float64) -> Float64:
        k1, k2, k3, k4 = self.numbers[4:]
        t2 = theta * theta
        radius: Float64 = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
        return radius

    @cached_property
    def rays(self) -> Float32:
        """(3, height, width) unit direction of each pixel's centre, camera frame (planes: SIMD)."""
        fx, fy, cx, cy = self.numbers[:4]
        x, y = (np.arange(self.width) - cx) / fx, (np.arange(self.height) - cy) / fy
        mx, my = np.meshgrid(x, y)
        radius = np.hypot(mx, my)
        theta = self.angle(radius)
        scale = np.sinc(theta / np.pi)
        if self.calibration is not None:
            scale = scale * theta / np.maximum(radius, 1e-12)
        return np.stack([scale * mx, scale * my, np.cos(theta)]).astype(np.float32)
