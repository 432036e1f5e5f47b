"""Synthetic pictures with labels, in shards on disk, and random crops of them.

The looks vary: worlds with and without walls; drones marked, bare and in the colours of trees;
noise, blur, exposure, low sun, rain.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from companion.perception.cnn import exposure_gain
from sitl_sim.sensors.fisheye import Lens
from sitl_sim.sensors.labelled_frames import CONDITIONS, Conditions, rendered
from sitl_sim.sensors.renderer import Sensor
from sitl_sim.sensors.scenes import RADIUS, Scene, still_scenes

SHARD = 250  # pictures
REACH = 13.0  # m, farthest drone rendered
KNOWN = 11.5  # m; farther drones are left open
VISIBLE = 0.35  # share; drones that show less are left open
CROP = (128, 192)  # px, height and width
LENS = Lens(640, 400)
MOST = 9  # drones in a picture
U, V, SIZE, WANTED = range(4)  # columns of a label; WANTED: 1 yes, 0 left open, −1 no drone


def shard(folder: Path, seed: int) -> tuple[Path, Path]:
    """Return the files of a seed's pictures (SHARD,h,w,3) and labels (SHARD,MOST,4).

    Missing files are rendered first.
    """
    pictures, labels = folder / f"{seed:05d}.npy", folder / f"{seed:05d}.labels.npy"
    if not labels.exists():
        folder.mkdir(parents=True, exist_ok=True)
        images = np.zeros((SHARD, LENS.height, LENS.width, 3), np.uint8)
        rows = np.full((SHARD, MOST, 4), -1.0, np.float32)
        for n, (scene, image) in enumerate(_pictures(seed)):
            images[n] = image
            made = label(scene)
            rows[n, : len(made)] = made
        np.save(pictures, images)
        np.save(labels, rows)
    return pictures, labels


def label(scene: Scene) -> NDArray[np.float32]:
    """Return the labels (m,4) of a picture's drones: pixel u, v, size [px], wanted.

    size: the drone's radius as the lens images it there; it and the lens give the range.
    """
    offsets = scene.in_camera(scene.drones - scene.p)
    ranges = np.linalg.norm(offsets, axis=1)
    rho = np.hypot(offsets[:, 0], offsets[:, 1])
    theta = np.arctan2(rho, offsets[:, 2])
    scale = LENS.f * theta / np.maximum(rho, 1e-9)
    u = (LENS.width - 1) / 2 + scale * offsets[:, 0]
    v = (LENS.height - 1) / 2 + scale * offsets[:, 1]
    size = RADIUS / ranges * LENS.f * np.sqrt(theta / np.maximum(np.sin(theta), 1e-3))
    wanted = (scene.visible >= VISIBLE) & (ranges <= KNOWN)
    inside = (u > -0.5) & (v > -0.5) & (u < LENS.width - 0.5) & (v < LENS.height - 0.5)
    rows = np.stack([u, v, size, wanted], axis=1)[(scene.visible > 0.02) & inside]
    return rows.astype(np.float32)


def _pictures(seed: int) -> Iterator[tuple[Scene, NDArray[np.uint8]]]:
    """Yield the scenes and pictures of one shard: ten worlds, each in its own weather."""
    rng = np.random.default_rng([seed, 80])
    scenes = still_scenes(SHARD, 1_000_000 + seed, LENS, reach=REACH, varied=True)
    batch = [next(scenes) for _ in range(SHARD)]
    for n in range(0, SHARD, 25):
        after = rng.choice(np.array([None] * 8 + ["backlight", "rain"], object))
        sensor = Sensor(
            noise=float(rng.uniform(1.0, 9.0)),
            blur=float(rng.choice([0.0, rng.uniform(0.3, 1.6)])),
            exposure=float(np.exp(rng.uniform(-1.0, 0.75))),
            vignette=float(rng.uniform(0.1, 0.4)),
        )
        weather = Conditions(sensor, CONDITIONS[after].after if after else None)
        part = iter(batch[n : n + 25])
        yield from rendered(part, weather, "mixed", LENS, 7_000_000 + seed * 10 + n // 25, 25)


@dataclass
class Crops:
    """Random crops of shards, as the network takes them."""

    files: list[tuple[Path, Path]]
    seed: int

    def __post_init__(self) -> None:
        self._pictures = [np.load(p, mmap_mode="r") for p, _ in self.files]
        self._labels = [np.load(q) for _, q in self.files]
        self._gains = [np.array([exposure_gain(i) for i in some]) for some in self._pictures]
        self._rng = np.random.default_rng([self.seed, 81])

    def batch(
        self, size: int
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.float32]]:
        """Return pictures (size,h,w,3) BGR, labels (size,MOST,4) in crop pixels, gains (size,)."""
        made = [self._one() for _ in range(size)]
        pictures, labels, gains = zip(*made, strict=True)
        return np.stack(pictures), np.stack(labels), np.array(gains, np.float32)

    def _one(self) -> tuple[NDArray[np.uint8], NDArray[np.float32], float]:
        rng = self._rng
        s = int(rng.integers(len(self.files)))
        n = int(rng.integers(SHARD))
        rows = self._labels[s][n].copy()
        h, w = CROP
        corner = rng.integers([0, 0], [LENS.width - w + 1, LENS.height - h + 1])
        wanted = rows[rows[:, WANTED] == 1.0]
        if len(wanted) and rng.random() < 0.75:
            chosen = wanted[rng.integers(len(wanted)), :2]
            corner = chosen - rng.uniform([0.1 * w, 0.1 * h], [0.9 * w, 0.9 * h])
        x = int(np.clip(corner[0], 0, LENS.width - w)) // 4 * 4
        y = int(np.clip(corner[1], 0, LENS.height - h)) // 4 * 4
        crop = self._pictures[s][n, y : y + h, x : x + w]
        rows[:, U] -= x
        rows[:, V] -= y
        if rng.random() < 0.5:
            crop = crop[:, ::-1]
            rows[:, U] = w - 1 - rows[:, U]
        out = (rows[:, :2] < -0.5).any(axis=1) | (rows[:, :2] > [w - 0.5, h - 0.5]).any(axis=1)
        rows[out, WANTED] = -1.0
        return crop, rows, float(self._gains[s][n])
