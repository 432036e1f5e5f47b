"""Pictures made strange: other ground, bark and sky, other light, other sensors.

What a class looks like is drawn anew for each crop: one colour, a mottled texture or part of a
photograph replaces it, while the render's light and shade stay. Colours then tell nothing, and the
network has to use outlines and places.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from training.data import DRONE, FAR, GROUND, OBSTACLE, OTHER

Picture = NDArray[np.uint8]
_SIDE = 512  # px of a mottled texture
_NOISE = 1 << 21
# Of gain, gamma and tint (σ of the logarithm). The rendered looks vary already: what is then made
# much brighter, harder or noisier shows drones that nobody can see, and teaches to guess.
_LIGHT = 0.15
_GROUPS = (GROUND,), (OBSTACLE, FAR), (OTHER,), (DRONE,)
_MEMBERS = {  # 255 where a class is of the group
    group: np.where(np.isin(np.arange(256), group), 255, 0).astype(np.uint8) for group in _GROUPS
}


class Strange:
    """Random looks and light; photographs: (n,h,w,3) BGR that give backgrounds and textures."""

    def __init__(self, photographs: NDArray[np.uint8] | None, seed: int) -> None:
        rng = np.random.default_rng([seed, 82])
        self._photographs = photographs
        self._mottled = [_mottled(rng) for _ in range(40)]
        self._noise = rng.standard_normal(_NOISE, np.float32)

    def repaint(self, rng: np.random.Generator, image: Picture, classes: Picture) -> Picture:
        """Return the picture with each class of its pixels, some of the time, made another."""
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        out = image.copy()
        for group in _GROUPS:
            mask = _MEMBERS[group][classes]
            if not mask.any() or rng.random() < (0.5 if group == (DRONE,) else 0.25):
                continue
            level = cv2.mean(grey, mask)[0]
            power = float(rng.uniform(0.2, 1.5))
            shade = (((np.arange(256) + 8.0) / (level + 8.0)) ** power).astype(np.float32)
            lit = cv2.multiply(
                self._texture(rng, image.shape[:2]),
                cv2.cvtColor(cv2.LUT(grey, shade), cv2.COLOR_GRAY2BGR),
            )
            share = float(rng.uniform(0.5, 1.0))
            painted = np.clip(lit, 0, 255).astype(np.uint8)
            new = cv2.addWeighted(image, 1 - share, painted, share, 0)
            cv2.copyTo(new, mask, out)
        return out

    def light(self, rng: np.random.Generator, image: Picture) -> Picture:
        """Return the picture in other light, through another lens and sensor."""
        values = np.arange(256, dtype=np.float32) / 255
        table = np.empty((1, 256, 3), np.uint8)
        gamma, gain = np.exp(rng.normal(0, _LIGHT)), np.exp(rng.normal(0, _LIGHT))
        tint = np.exp(rng.normal(0, rng.choice([0.03, _LIGHT]), 3))
        low = float(rng.uniform(-0.1, 0.2)) if rng.random() < 0.15 else 0.0  # haze, black level
        for c in range(3):
            table[0, :, c] = np.clip(
                255 * (low + (1 - max(low, 0)) * gain * tint[c] * values**gamma), 0, 255
            )
        image = cv2.LUT(image, table)  # type: ignore[assignment]
        if rng.random() < 0.1:
            image = _rotated_hue(rng, image)
        if rng.random() < 0.05:
            image = np.ascontiguousarray(image[..., rng.permutation(3)])
        if rng.random() < 0.05:
            image = cv2.cvtColor(  # type: ignore[assignment]
                cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR
            )
        chance = rng.random()
        if chance < 0.15:
            image = cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.3, 0.9)))  # type: ignore[assignment]
        elif chance < 0.2:
            image = cv2.filter2D(image, -1, _smear(rng))  # type: ignore[assignment]
        if rng.random() < 0.4:
            size = image.size
            at = int(rng.integers(_NOISE - size))
            sigma = float(rng.exponential(3.0))
            noise = self._noise[at : at + size].reshape(image.shape)
            image = np.clip(image + sigma * noise, 0, 255).astype(np.uint8)
        if rng.random() < 0.1:
            quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(25, 90))]
            packed = cv2.imencode(".jpg", image, quality)[1]
            image = cv2.imdecode(packed, cv2.IMREAD_COLOR)  # type: ignore[assignment]
        return image

    def _texture(self, rng: np.random.Generator, shape: tuple[int, int]) -> NDArray[np.float32]:
        """Return a texture (h,w,3) for one class."""
        h, w = shape
        chance = rng.random()
        colour = np.clip(rng.uniform(20, 230) + rng.normal(0, rng.choice([5, 40]), 3), 5, 250)
        if chance < 0.25:
            return np.broadcast_to(colour, (h, w, 3)).astype(np.float32)
        if chance < 0.5 and self._photographs is not None:
            photo = self._photographs[rng.integers(len(self._photographs))]
            y, x = rng.integers(photo.shape[0] - h + 1), rng.integers(photo.shape[1] - w + 1)
            return np.asarray(photo[y : y + h, x : x + w], np.float32)
        mottled = self._mottled[rng.integers(len(self._mottled))]
        y, x = rng.integers(_SIDE - h + 1), rng.integers(_SIDE - w + 1)
        contrast = float(rng.uniform(5, 60))
        other = rng.normal(0, 12, 3)
        part = mottled[y : y + h, x : x + w, None]
        result: NDArray[np.float32] = (colour + part * (contrast + other)).astype(np.float32)
        return result


def _mottled(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return noise (_SIDE,_SIDE) of unit variance with a random spectrum and grain."""
    out = np.zeros((_SIDE, _SIDE), np.float32)
    slope = float(rng.uniform(0.3, 1.5))
    stretch = float(np.exp(rng.normal(0, 0.8)))
    for octave in range(2, 10):
        n = 2**octave
        across = max(2, min(_SIDE, int(n * stretch)))
        coarse = rng.standard_normal((n, across)).astype(np.float32)
        out += cv2.resize(coarse, (_SIDE, _SIDE), interpolation=cv2.INTER_CUBIC) * n**-slope
    return out / out.std()


def _rotated_hue(rng: np.random.Generator, image: Picture) -> Picture:
    """Return the picture with all hues turned by one angle, and another saturation."""
    angle, k = float(rng.uniform(0, 2 * np.pi)), float(rng.uniform(0.2, 1.5))
    axis = np.full(3, 1 / np.sqrt(3))
    cross = np.cross(np.eye(3), axis)
    along = np.outer(axis, axis)
    turn = along + k * (np.cos(angle) * (np.eye(3) - along) + np.sin(angle) * cross)
    return cv2.transform(image, turn.astype(np.float32))  # type: ignore[return-value]


def _smear(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return the kernel of motion in a random direction during the exposure."""
    n = int(rng.integers(1, 4)) * 2 + 1
    kernel = np.zeros((n, n), np.float32)
    t = float(rng.uniform(0, np.pi))
    half = n // 2
    du, dv = round(half * np.cos(t)), round(half * np.sin(t))
    cv2.line(kernel, (half - du, half - dv), (half + du, half + dv), 1.0)
    return kernel / kernel.sum()
