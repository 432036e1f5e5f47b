"""Random crops of rendered and real pictures, as the network takes them in training."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.perception.exposure import exposure_gain
from training.augment import Strange
from training.data import DRONE, MOST, OPEN, SIZE, SMALLEST, UNCLEAR, WANTED, Shard, U, V
from training.shapes import drawn_drone
from training.videos import CutOut

CROP = (256, 320)  # px, height and width
_REAL = 0.2  # share of crops that are photographs
_PASTED = (0, 0, 0, 0, 1, 1, 2)  # objects added to a crop, each as likely
_REPAINTED = 0.3  # share of rendered crops


class Batch(NamedTuple):
    """Pictures (n,h,w,3) BGR, gains (n,) to 0…1, labels (n,m,4) in crop pixels, classes (n,h,w)."""

    pictures: NDArray[np.uint8]
    gains: NDArray[np.float32]
    labels: NDArray[np.float32]
    classes: NDArray[np.uint8]


@dataclass
class Crops:
    """Crops by seed and step: the same numbers give the same batch.

    real: photographs with labels; None where there are none.
    """

    rendered: list[Shard]
    real: Shard | None
    cut_outs: list[CutOut]
    seed: int
    _strange: Strange = field(init=False)

    def __post_init__(self) -> None:
        photographs = None if self.real is None else self.real.pictures
        self._strange = Strange(photographs, self.seed)

    def batch(self, step: int, size: int) -> Batch:
        """Return the batch of a step."""
        rng = np.random.default_rng([self.seed, 81, step])
        made = [self._one(rng) for _ in range(size)]
        return Batch(*(np.stack(part) for part in zip(*made, strict=True)))

    def _one(
        self, rng: np.random.Generator
    ) -> tuple[NDArray[np.uint8], np.float32, NDArray[np.float32], NDArray[np.uint8]]:
        if self.real is not None and rng.random() < _REAL:
            shard, real = self.real, True
        else:
            shard, real = self.rendered[rng.integers(len(self.rendered))], False
        image, rows, classes = _cut(rng, shard)
        unclear = bool(classes[0, 0] == UNCLEAR)
        if not real and not unclear and rng.random() < _REPAINTED:
            image = self._strange.repaint(rng, image, classes)
        for _ in range(0 if unclear else int(rng.choice(_PASTED))):
            self._paste(rng, image, rows, classes)
        image = self._strange.light(rng, image)
        gain = exposure_gain(image) * float(np.exp(rng.normal(0, 0.12))) / 255
        return image, np.float32(gain), rows, classes

    def _paste(
        self,
        rng: np.random.Generator,
        image: NDArray[np.uint8],
        rows: NDArray[np.float32],
        classes: NDArray[np.uint8],
    ) -> None:
        """Draw a random drone, or an object cut from a photograph, into the crop."""
        free = np.flatnonzero(rows[:, WANTED] < 0)
        size = float(np.exp(rng.uniform(np.log(1.8), np.log(45.0))))
        if self.cut_outs and rng.random() < 0.5:
            chosen = self.cut_outs[rng.integers(len(self.cut_outs))]
            drone = chosen.drone
            size = min(size, 14.0)
            k = 2 * size / chosen.opacity.shape[1]
            if k > 1.6:
                k = 1.6
                size = k * chosen.opacity.shape[1] / 2
            shape = (
                max(round(chosen.opacity.shape[1] * k), 2),
                max(round(chosen.opacity.shape[0] * k), 2),
            )
            flip = rng.random() < 0.5
            picture = cv2.resize(chosen.picture, shape, interpolation=cv2.INTER_AREA)
            opacity = cv2.resize(chosen.opacity, shape, interpolation=cv2.INTER_AREA)
            if flip:
                picture, opacity = picture[:, ::-1], opacity[:, ::-1]
            if rng.random() < 0.5:
                bright = np.exp(rng.normal(0, 0.6)) * picture + rng.uniform(-20, 60)
                picture = np.clip(bright, 0, 255).astype(np.uint8)
        else:
            drone = True
            picture, opacity = drawn_drone(rng, size)
        h, w = opacity.shape
        if not len(free) or h >= CROP[0] or w >= CROP[1]:
            return
        y, x = int(rng.integers(CROP[0] - h)), int(rng.integers(CROP[1] - w))
        u, v = x + (w - 1) / 2, y + (h - 1) / 2
        there = rows[rows[:, WANTED] >= 0]
        if (
            len(there)
            and (
                np.hypot(there[:, U] - u, there[:, V] - v)
                < size + np.maximum(there[:, SIZE], 12) + 4
            ).any()
        ):
            return
        part = image[y : y + h, x : x + w]
        part[:] = _laid_over(rng, part, picture, opacity)
        if classes[0, 0] != OPEN:
            classes[y : y + h, x : x + w][opacity > 0.4] = DRONE
        if drone:
            rows[free[0]] = u, v, size, 1.0 if size >= SMALLEST else 0.0


def _laid_over(
    rng: np.random.Generator,
    part: NDArray[np.uint8],
    picture: NDArray[np.uint8],
    opacity: NDArray[np.float32],
) -> NDArray[np.uint8]:
    """Return the part (h,w,3) with a picture over it, as grainy and soft as the part itself.

    Without this, whatever is sharper or cleaner than its surroundings would look like a drone.
    """
    grain = part.astype(np.float32) - cv2.blur(part, (3, 3))
    sigma = float(np.median(np.abs(grain))) * 1.5
    if rng.random() < 0.6:
        soft = float(rng.uniform(0.4, 1.1))
        weighed = cv2.GaussianBlur(picture * opacity[..., None], (0, 0), soft)
        opacity = cv2.GaussianBlur(opacity, (0, 0), soft)  # type: ignore[assignment]
        picture = weighed / np.maximum(opacity, 1e-3)[..., None]  # type: ignore[assignment]
    a = opacity[..., None]
    noisy = picture + sigma * rng.standard_normal(part.shape, np.float32)
    return np.clip(part * (1 - a) + a * noisy, 0, 255).astype(np.uint8)


def _cut(
    rng: np.random.Generator, shard: Shard
) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.uint8]]:
    """Return a random part of a random picture of a shard, at CROP, with labels and classes."""
    n = int(rng.integers(len(shard.pictures)))
    rows = np.array(shard.drones[n])
    if len(rows) < MOST:
        rows = np.vstack([rows, np.full((MOST - len(rows), 4), -1.0, np.float32)])
    height, width = shard.pictures.shape[1:3]
    zoom = float(np.exp(rng.uniform(np.log(0.6), np.log(1.5))))
    h, w = min(round(CROP[0] / zoom), height), min(round(CROP[1] / zoom), width)
    corner = rng.integers([0, 0], [width - w + 1, height - h + 1]).astype(float)
    wanted = rows[rows[:, WANTED] == 1.0]
    if len(wanted) and rng.random() < 0.6:
        chosen = wanted[rng.integers(len(wanted)), :2]
        corner = chosen - rng.uniform([0.1 * w, 0.1 * h], [0.9 * w, 0.9 * h])
    x, y = int(np.clip(corner[0], 0, width - w)), int(np.clip(corner[1], 0, height - h))
    target = CROP[1], CROP[0]
    how = cv2.INTER_AREA if zoom < 1 else cv2.INTER_LINEAR
    image = cv2.resize(
        np.asarray(shard.pictures[n, y : y + h, x : x + w]), target, interpolation=how
    )
    if shard.classes.shape[1] > 1:
        part = np.asarray(shard.classes[n, y : y + h, x : x + w])
        classes = cv2.resize(part, target, interpolation=cv2.INTER_NEAREST)
    else:
        classes = np.full(CROP, OPEN, np.uint8)
    ku, kv = CROP[1] / w, CROP[0] / h
    rows[:, U] = (rows[:, U] - x + 0.5) * ku - 0.5
    rows[:, V] = (rows[:, V] - y + 0.5) * kv - 0.5
    rows[:, SIZE] *= np.sqrt(ku * kv)
    small = (rows[:, WANTED] == 1.0) & (rows[:, SIZE] > 0) & (rows[:, SIZE] < SMALLEST)
    rows[small, WANTED] = 0.0
    if rng.random() < 0.5:
        image, classes = (
            np.ascontiguousarray(image[:, ::-1]),
            np.ascontiguousarray(classes[:, ::-1]),
        )
        rows[:, U] = CROP[1] - 1 - rows[:, U]
    out = (rows[:, :2] < -0.5).any(axis=1)
    out |= (rows[:, :2] > [CROP[1] - 0.5, CROP[0] - 0.5]).any(axis=1)
    rows[out, WANTED] = -1.0
    return image, rows, classes  # type: ignore[return-value]
