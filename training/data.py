"""Rendered pictures with labels, in shards on disk.

A shard holds pictures, the drones in them, and the class of every pixel. The looks vary: worlds
with and without walls; drones marked, bare and in the colours of trees; noise, blur, exposure, low
sun, rain.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sitl_sim.sensors.fisheye import R_BC, Lens, rotation
from sitl_sim.sensors.labelled_frames import CONDITIONS, Conditions, rendered
from sitl_sim.sensors.renderer import Renderer, Sensor
from sitl_sim.sensors.scenes import RADIUS, Scene, still_scenes

SHARD = 250  # pictures
REACH = 13.0  # m, farthest drone rendered
KNOWN = 11.5  # m; farther drones are left open
VISIBLE = 0.35  # share; drones that show less are left open
LENS = Lens(640, 400)
MOST = 12  # drones in a picture
U, V, SIZE, WANTED = range(4)  # columns of a label; WANTED: 1 yes, 0 left open, −1 no drone
OTHER, GROUND, OBSTACLE, DRONE, FAR, OPEN = range(6)  # classes of pixels; OPEN: not labelled
DISTANT = 15.0  # m; obstacles beyond are FAR


class Shard(NamedTuple):
    """Pictures (n,h,w,3) BGR, drones (n,MOST,4), and classes (n,h,w) of their pixels."""

    pictures: NDArray[np.uint8]
    drones: NDArray[np.float32]
    classes: NDArray[np.uint8]


def load(folder: Path, name: str) -> Shard:
    """Return a shard of a folder; pictures stay on disk until they are used."""
    parts = [np.load(folder / f"{name}.{part}.npy", mmap_mode="r") for part in Shard._fields]
    return Shard(*parts)


def save(folder: Path, name: str, shard: Shard) -> None:
    """Write a shard; its last file is complete only when all are."""
    folder.mkdir(parents=True, exist_ok=True)
    for part, values in zip(Shard._fields, shard, strict=True):
        np.save(folder / f"{name}.{part}.npy", values)


def rendered_shard(folder: Path, seed: int) -> Shard:
    """Return the pictures of a seed; missing files are rendered first."""
    name = f"rendered-{seed:05d}"
    if not (folder / f"{name}.classes.npy").exists():
        size = (SHARD, LENS.height, LENS.width)
        made = Shard(
            np.zeros((*size, 3), np.uint8),
            np.full((SHARD, MOST, 4), -1.0, np.float32),
            np.zeros(size, np.uint8),
        )
        renderers: dict[int, Renderer] = {}
        for n, (scene, image) in enumerate(_pictures(seed)):
            made.pictures[n] = image
            rows = label(scene)
            made.drones[n, : len(rows)] = rows
            if id(scene.world) not in renderers:
                renderers = {id(scene.world): Renderer(scene.world)}
            made.classes[n] = classes(scene, renderers[id(scene.world)])
        save(folder, name, made)
    return load(folder, name)


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
    return rows[:MOST].astype(np.float32)


def classes(scene: Scene, renderer: Renderer) -> NDArray[np.uint8]:
    """Return the class (h,w) of each pixel of a scene's picture."""
    size = (LENS.width, LENS.height)
    none = np.zeros((0, 3)), np.zeros((0, 4))
    still = renderer.depth(scene.p, scene.q, *none, *size)
    nearest = renderer.depth(scene.p, scene.q, scene.drones, scene.attitudes, *size)
    down = (rotation(scene.q) @ R_BC)[2]  # of each ray, the part along world z
    with np.errstate(invalid="ignore"):
        height = scene.p[2] + still * np.tensordot(down, LENS.rays, 1)
    out = np.where(height > 0.05, OBSTACLE, GROUND).astype(np.uint8)
    out[(out == OBSTACLE) & (still > DISTANT)] = FAR
    out[~np.isfinite(still)] = OTHER
    out[nearest < still - 0.01] = DRONE
    return out


def _pictures(seed: int) -> Iterator[tuple[Scene, NDArray[np.uint8]]]:
    """Yield the scenes and pictures of one shard: ten worlds, each in its own weather."""
    rng = np.random.default_rng([seed, 80])
    scenes = still_scenes(SHARD, 1_000_000 + seed, LENS, reach=REACH, varied=True)
    batch = [next(scenes) for _ in range(SHARD)]
    for n in range(0, SHARD, 25):
        after = rng.choice(np.array([None] * 8 + ["backlight", "rain"], object))
        sensor = Sensor(
            noise=float(rng.uniform(1.0, 6.0)),
            blur=float(rng.choice([0.0, rng.uniform(0.3, 1.2)])),
            exposure=float(np.exp(rng.uniform(-0.7, 0.5))),
            vignette=float(rng.uniform(0.1, 0.4)),
        )
        weather = Conditions(sensor, CONDITIONS[after].after if after else None)
        part = iter(batch[n : n + 25])
        yield from rendered(part, weather, "mixed", LENS, 7_000_000 + seed * 10 + n // 25, 25)
