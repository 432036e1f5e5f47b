"""The fisheye camera: pixels ↔ directions, by the equidistant model of `cv2.fisheye`.

The camera frame C is x right, y down, z forward; the body frame B is FLU. Pixels are u right, v
down, with integers at pixel centres, as OpenCV counts. Source: Kannala and Brandt, "A generic
camera model and calibration method for conventional, wide-angle, and fish-eye lenses", 2006.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.shared.frames import multiply, quaternion_from_euler

# Camera → body for a camera that looks along +x_B: x_C = −y_B, y_C = −z_B, z_C = x_B.
FORWARD = (0.5, -0.5, 0.5, -0.5)
KEYS = ("width", "height", "fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
NEWTON_STEPS = 8
FOV_DEG = (40.0, 240.0)  # across the picture; outside, a focal length is mistaken
_TINY = 1e-300  # in place of 0, by which nothing is divided
_BAND = 16  # rows of all rays that are worked out at a time


class CalibrationError(ValueError):
    """A calibration that cannot be used; the text names the file, the key and the valid values."""


@dataclass(frozen=True, eq=False)
class Camera:
    """Intrinsics and mount of one camera.

    width, height: px. fx, fy: px/rad. cx, cy: px. k: (4,) `cv2.fisheye` distortion.
    max_angle: rad, largest angle from the axis that the lens images; 0: up to the corners.
    mount: (4,) quaternion w, x, y, z, camera → body.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    k: Vector = field(default_factory=lambda: np.zeros(4))
    max_angle: float = 0.0
    mount: Vector = field(default_factory=lambda: np.array(FORWARD))

    def __post_init__(self) -> None:
        object.__setattr__(self, "k", np.asarray(self.k, float))
        object.__setattr__(self, "mount", np.asarray(self.mount, float))
        if self.max_angle <= 0.0:
            u = np.array([-0.5, self.width - 0.5])
            v = np.array([-0.5, self.height - 0.5])
            corners = np.hypot((u - self.cx)[:, None] / self.fx, (v - self.cy)[None] / self.fy)
            object.__setattr__(self, "max_angle", float(self._angle(corners).max()))

    @staticmethod
    def equidistant(width: int, height: int, fov_deg: float = 160.0) -> Camera:
        """Return an ideal fisheye whose `fov_deg` spans the image's width."""
        f = width / np.radians(fov_deg)
        return Camera(width, height, f, f, (width - 1) / 2, (height - 1) / 2)

    @staticmethod
    def load(path: str | Path) -> Camera:
        """Return the camera of a YAML file: width, height, fx, fy, cx, cy, k1…k4, optional mount.

        Raises:
            CalibrationError: a missing file, not YAML, or a key missing, unknown or out of range.
        """
        try:
            data = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
        except (OSError, yaml.YAMLError, ValueError) as error:  # no text, or a 31st of June
            raise CalibrationError(f"{path}: cannot read calibration: {error}") from error
        return Camera.from_data(data, str(path))

    @staticmethod
    def from_data(data: object, path: str = "calibration") -> Camera:
        """Return the camera of the plain data of such a file; path: its name, for messages.

        Raises:
            CalibrationError: as `load`.
        """
        valid = f"valid keys: {', '.join(KEYS)}, mount"
        if not isinstance(data, dict):
            raise CalibrationError(f"{path}: expected a mapping; {valid}")
        if missing := [key for key in KEYS[:6] if key not in data]:
            raise CalibrationError(f"{path}: missing {', '.join(missing)}; {valid}")
        if unknown := [str(key) for key in data if key not in (*KEYS, "mount")]:
            raise CalibrationError(f"{path}: unknown {', '.join(unknown)}; {valid}")
        try:
            n = {key: float(data.get(key, 0.0)) for key in KEYS}
            mount = np.array(data.get("mount", FORWARD), float)
        except (TypeError, ValueError) as error:
            raise CalibrationError(f"{path}: every value is a number: {error}") from error
        if not np.isfinite([*n.values()]).all() or min(n[key] for key in KEYS[:4]) <= 0:
            raise CalibrationError(f"{path}: width, height, fx, fy must be positive and finite")
        if n["width"] % 1 or n["height"] % 1:
            raise CalibrationError(f"{path}: width and height must be whole numbers of pixels")
        # With NaN in the mount the comparison is false.
        if mount.shape != (4,) or not abs(norm(mount) - 1.0) <= 1e-3:
            raise CalibrationError(f"{path}: mount must be a unit quaternion w, x, y, z")
        k = np.array([n["k1"], n["k2"], n["k3"], n["k4"]])
        camera = Camera(
            int(n["width"]), int(n["height"]), n["fx"], n["fy"], n["cx"], n["cy"], k, mount=mount
        )
        if inhibit_reason := camera.inhibit_reason:
            raise CalibrationError(f"{path}: {inhibit_reason}")
        return camera

    @property
    def inhibit_reason(self) -> str:
        """Return why no drone should fly by this calibration, one line; empty where it can.

        A polynomial that was fitted to the middle alone bends back farther out. A neighbour at the
        side would then be placed behind the drone.
        """
        wide = math.degrees(self.width / self.fx)
        if not FOV_DEG[0] <= wide <= FOV_DEG[1] or not 0.5 < self.fx / self.fy < 2.0:
            return (
                f"fx {self.fx:g}, fy {self.fy:g} px/rad image {wide:.0f}° across {self.width} px: "
                f"{FOV_DEG[0]:g} to {FOV_DEG[1]:g}° are possible, and fx near fy"
            )
        across = [(-0.5 - self.cx) / self.fx, (self.width - 0.5 - self.cx) / self.fx]
        down = [(-0.5 - self.cy) / self.fy, (self.height - 0.5 - self.cy) / self.fy]
        if float(self.radius(np.array(self._peak))) > np.abs(across + down).max():
            return ""
        return (
            f"fx, fy, k1…k4 image nothing beyond {np.degrees(self._peak):.0f}° off the axis, which "
            "lies inside the picture: calibrate again, with the board near the edges, too"
        )

    def turned(self, mount_deg: Sequence[float]) -> Camera:
        """Return the same camera, turned on its mount by roll, pitch, yaw [°].

        Roll is clockwise as the camera sees, pitch up, yaw to the left; in the body frame (FLU)
        pitch up is a negative angle about the axis to the left.
        """
        if not any(mount_deg):
            return self
        roll, pitch, yaw = np.radians(mount_deg)
        turn = quaternion_from_euler(float(roll), float(-pitch), float(yaw))
        return replace(self, mount=multiply(turn, self.mount))

    def scaled(self, width: int, height: int) -> Camera:
        """Return the same view at another image size (width, height px)."""
        su, sv = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * su,
            fy=self.fy * sv,
            cx=(self.cx + 0.5) * su - 0.5,
            cy=(self.cy + 0.5) * sv - 0.5,
        )

    def as_data(self) -> dict[str, object]:
        """Return the calibration as plain data, by the keys that `load` reads."""
        numbers = (self.width, self.height, self.fx, self.fy, self.cx, self.cy, *self.k)
        data: dict[str, object] = {
            key: value if isinstance(value, int) else float(value)
            for key, value in zip(KEYS, numbers, strict=True)
        }
        return data | {"mount": [float(value) for value in self.mount]}

    def save(self, path: str | Path) -> None:
        """Write the calibration that `load` reads."""
        text = yaml.safe_dump(self.as_data(), sort_keys=False)
        Path(path).write_text(text, encoding="utf-8")

    def project(self, points_c: Vector) -> Vector:
        """Return the pixels (n,2) of points (n,3) m, camera frame; NaN beyond `max_angle`."""
        x, y, z = np.asarray(points_c, float).reshape(-1, 3).T
        rho = np.hypot(x, y)
        theta = np.arctan2(rho, z)
        # On the axis the image direction is undefined and its radius 0.
        scale = self.radius(theta) / np.maximum(rho, _TINY)
        scale[theta > self.max_angle + 1e-9] = np.nan
        pixels = np.empty((len(x), 2))
        pixels[:, 0] = self.cx + self.fx * scale * x
        pixels[:, 1] = self.cy + self.fy * scale * y
        return pixels

    def unproject(self, pixels: Vector) -> Vector:
        """Return the unit directions (n,3), camera frame, of pixels (n,2)."""
        u, v = np.asarray(pixels, float).reshape(-1, 2).T
        mx, my = (u - self.cx) / self.fx, (v - self.cy) / self.fy
        radius = np.hypot(mx, my)
        theta = self._angle(radius)
        scale = np.sin(theta) / np.maximum(radius, _TINY)
        rays = np.empty((len(mx), 3))
        rays[:, 0], rays[:, 1], rays[:, 2] = scale * mx, scale * my, np.cos(theta)
        return rays

    @cached_property
    def directions(self) -> NDArray[np.float32]:
        """Return the unit direction of every pixel, (height,width,3), camera frame."""
        rays = np.empty((self.height, self.width, 3), np.float32)
        for band in self._bands():
            u, v = np.meshgrid(np.arange(float(self.width)), np.arange(band.start, band.stop, 1.0))
            found = self.unproject(np.stack([u, v], axis=-1).reshape(-1, 2))
            rays[band] = found.reshape(*u.shape, 3)
        return rays

    @cached_property
    def solid_angle(self) -> NDArray[np.float32]:
        """Return the solid angle [sr] of every pixel, (height,width): dΩ = sin θ dθ dφ."""
        areas = np.empty((self.height, self.width), np.float32)
        for band in self._bands():
            u, v = np.meshgrid(np.arange(float(self.width)), np.arange(band.start, band.stop, 1.0))
            radius = np.hypot((u - self.cx) / self.fx, (v - self.cy) / self.fy).ravel()
            theta = np.maximum(self._angle(radius), 1e-6)
            slope = np.maximum(self._slope(theta), 1e-3)
            area = np.sin(theta) / (self.radius(theta) * slope * self.fx * self.fy)
            areas[band] = area.reshape(u.shape)
        return areas

    def _bands(self) -> Iterator[slice]:
        """Yield the rows, a few at a time: what is worked out on the way stays in the memory."""
        for first in range(0, self.height, _BAND):
            yield slice(first, min(first + _BAND, self.height))

    def radius(self, theta: Vector) -> Vector:
        """Return the normalised image radius of an angle from the axis [rad]: the polynomial."""
        if not self._distorts:
            return theta
        t2 = theta * theta
        k1, k2, k3, k4 = self.k
        result: Vector = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
        return result

    def _slope(self, theta: Vector) -> Vector:
        """Return the derivative of `radius`."""
        t2 = theta * theta
        k1, k2, k3, k4 = self.k
        result: Vector = 1.0 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))
        return result

    @cached_property
    def _distorts(self) -> bool:
        """Return whether the lens differs from the ideal equidistant one."""
        return bool(self.k.any())

    @cached_property
    def _peak(self) -> float:
        """Return the angle [rad] up to which `radius` grows; π where it always does."""
        theta = np.linspace(0.0, np.pi, 1000)
        falls = self._slope(theta) <= 0.0
        return float(theta[int(np.argmax(falls))]) if falls.any() else np.pi

    def _angle(self, radius: Vector) -> Vector:
        """Return the angle [rad] of an image radius, by Newton's method; exact without distortion.

        In corners that the lens does not image, this is the largest angle that it does.
        """
        theta = np.asarray(radius, float)
        if self._distorts:
            for _ in range(NEWTON_STEPS):
                step = (self.radius(theta) - radius) / np.maximum(self._slope(theta), 0.1)
                theta = np.clip(theta - step, 0.0, self._peak)
        result: Vector = np.minimum(theta, np.pi)
        return result
