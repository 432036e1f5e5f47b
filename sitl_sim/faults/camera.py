"""Faults of one drone's camera, and of a perfect detector's reports."""

from __future__ import annotations

from collections import deque
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sitl_sim.faults.catalogue import Fault, Schedule

Picture = NDArray[np.uint8]
Arrays = dict[str, NDArray[Any]]
_KEPT = 60  # frames, six seconds: the longest delay
# Axes, camera frame (x right, y down, z forward), of a turn by a positive amount.
_TURNS = {
    "camera_rolled": np.array([0.0, 0.0, 1.0]),
    "camera_pitched": np.array([1.0, 0.0, 0.0]),
    "camera_yawed": np.array([0.0, -1.0, 0.0]),
}
_OLD = ("camera_late", "camera_frozen")  # kinds that show what was seen before
_FOV = np.radians(160.0)  # over the width of an ideal fisheye
_GHOST_RANGE = (1.5, 8.0)  # m
_NOISE = 2.0  # of 255, of the sensor behind a fogged lens


class FaultyCamera:
    """Alters the frames of drone i; one call for each frame, in order."""

    def __init__(self, schedule: Schedule, i: int) -> None:
        self._schedule, self._i = schedule, i
        # A picture that is kept cannot be written over: only faults that show old ones pay for it.
        kept = _KEPT if schedule.has(i, *_OLD) else 0
        self._taken: deque[tuple[float, Arrays]] = deque(maxlen=kept)
        self._frozen: Arrays | None = None

    def alter(self, now: float, stamp: float, arrays: Arrays) -> tuple[float, Arrays]:
        """Return capture time and arrays of the frame that is sent at `now` [s of the flight].

        stamp: now on the vehicle's clock [s].
        """
        arrays = self._report(now, arrays)
        self._taken.append((stamp, arrays))
        if self._at(now, "camera_dead"):
            return stamp, {}
        if late := self._at(now, "camera_late"):
            due = [t for t in self._taken if t[0] <= stamp - late[0].value]
            stamp, arrays = due[-1] if due else self._taken[0]
        if self._at(now, "camera_frozen"):
            before = self._taken[-2][1] if len(self._taken) > 1 else arrays
            self._frozen = self._frozen or before
            arrays = self._frozen
        else:
            self._frozen = None
        for kind, level in (("camera_black", 0), ("camera_saturated", 255)):
            if self._at(now, kind) and "image" in arrays:
                arrays = arrays | {"image": np.full_like(arrays["image"], level)}
        if "image" in arrays:
            image = self._mismounted(now, arrays["image"])
            for fault in self._at(now, "camera_vibration"):
                image = _seen_by(image, _shaken(fault.value, fault.rng), 1.0)
            for fault in self._at(now, "camera_fog"):
                image = _fogged(image, fault.value, fault.rng)
            arrays = arrays | {"image": image}
        for fault in self._at(now, "camera_misdated"):
            stamp += fault.value
        return stamp, arrays

    def _mismounted(self, now: float, image: Picture) -> Picture:
        """Return the picture of a camera whose mount or lens is not as configured."""
        if self._at(now, "camera_mirrored"):
            image = np.ascontiguousarray(image[:, ::-1])
        if self._at(now, "camera_upside_down"):
            image = np.ascontiguousarray(image[::-1, ::-1])
        for kind, axis in _TURNS.items():
            for fault in self._at(now, kind):
                image = _seen_by(image, axis * np.radians(fault.value), 1.0)
        for fault in self._at(now, "camera_scaled"):
            image = _seen_by(image, np.zeros(3), fault.value)
        return image

    def _report(self, now: float, arrays: Arrays) -> Arrays:
        """Alter a perfect detector's report."""
        rows = arrays.get("neighbours")
        if rows is None:
            return arrays
        for fault in self._at(now, "range_bias"):
            rows = rows * np.array([1, 1, 1, fault.value, 1, 1])
        for fault in self._at(now, "missed"):
            rows = rows[[not fault.strikes() for _ in rows]]
        for fault in self._at(now, "swaps"):
            rows = fault.rng.permutation(rows) if fault.strikes() else rows
        for fault in self._at(now, "ghosts"):
            rows = np.vstack([rows, _ghost(fault.rng)]) if fault.strikes() else rows
        return arrays | {"neighbours": rows}

    def _at(self, now: float, kind: str) -> list[Fault]:
        return self._schedule.at(self._i, now, kind)


def _ghost(rng: np.random.Generator) -> NDArray[np.float64]:
    """Return a report (6,) of a neighbour ahead that does not exist."""
    angle = rng.uniform(-1.0, 1.0)
    ray = [np.sin(angle), 0.0, np.cos(angle)]
    return np.array([*ray, rng.uniform(*_GHOST_RANGE), 0.005, 0.03])


def _fogged(image: Picture, lost: float, rng: np.random.Generator) -> Picture:
    """Return the picture (h,w,3) behind a lens fogged up: a share `lost` of its contrast is gone.

    The sensor's own noise stays.
    """
    grey = image.mean(axis=(0, 1))
    noise = rng.normal(0.0, _NOISE, image.shape)
    fogged = grey + (1.0 - lost) * (image - grey) + noise
    return np.asarray(np.clip(fogged, 0, 255), np.uint8)


def _shaken(peak: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the turn (3,) [rad; C] at one picture of a camera that shakes by `peak` degrees.

    Motors shake a camera at 40 to 200 Hz, and at a rate that changes with their speed: pictures
    that come at 10 Hz catch each axis at any phase. Blur is left out, as of a short exposure.
    """
    turn: NDArray[np.float64] = np.radians(peak) * np.sin(rng.uniform(0.0, 2.0 * np.pi, 3))
    return turn


def _seen_by(image: Picture, turn: NDArray[np.float64], focal: float) -> Picture:
    """Return the picture (h,w,3) of an equidistant camera, turned by `turn` (3,) [rad; C].

    focal: factor on the focal length. The picture's edge goes on where nothing was rendered.
    """
    h, w = image.shape[:2]
    u, v = np.meshgrid(np.arange(w) - (w - 1) / 2, np.arange(h) - (h - 1) / 2)
    radius = np.hypot(u, v)
    theta = radius * _FOV / w / focal
    side = np.sin(theta) / np.maximum(radius, 1e-9)
    rays = np.stack([side * u, side * v, np.cos(theta)], axis=-1) @ cv2.Rodrigues(turn)[0].T
    rho = np.hypot(rays[..., 0], rays[..., 1])
    scale = np.arctan2(rho, rays[..., 2]) / np.maximum(rho, 1e-9) * w / _FOV
    x, y = (scale * rays[..., k] + (n - 1) / 2 for k, n in ((0, w), (1, h)))
    new = cv2.remap(
        image,
        x.astype(np.float32),
        y.astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(new, np.uint8)
