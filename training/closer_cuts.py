"""Cut-outs to train the closer look on: what the search takes for drones, in pictures with labels.

Of each picture the hottest places of the packaged network's heat map are cut out, as in flight, and
each drone besides, and in videos each bird and aircraft, a few times, not quite in the middle and
not quite of its size: so that there are enough of each.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.bench.videos import videos
from companion.perception.closer_look import RADII, around, cut_outs, widths
from companion.perception.eyes import Eyes
from companion.perception.heat_map import peaks
from companion.types import Image
from mavlink_bridge.shared.arrays import Vector
from training.data import LENS, SIZE, WANTED, Shard, U, V
from training.videos import box_rows

EVERY = 8  # frames of a video from one that is used to the next
_MOST, _LEAST_HEAT = 32, 0.06  # of the search, in one picture
_TIMES, _VIDEO_TIMES = 2, 3  # that each drone is cut out beside, in renders and in videos
_ASIDE, _SIZED = 0.25, 0.25  # 1 σ: of the place [radii], of the size's logarithm
_DRONE_IN_BOX, _OTHER_IN_BOX = 0.22, 0.3  # radius over the longer side of its loose box
# A place means a drone where it is as near to its centre (radii, px; share of a box) and of about
# its size; what is near, but not so, is left open.
_NEAR, _NEAR_PX, _NEAR_BOX, _TIMES_SIZE = 0.6, 5.0, 0.35, 4.0
_BESIDE, _BESIDE_PX, _BESIDE_BOX = 1.5, 9.0, 0.9
# Columns of a label. DRONE: 1, 0. DU, DV: cut-out widths to its centre. RATIO: logarithm of its
# size over the cut-out's. SIZED: 1 where that is known.
DRONE, DU, DV, RATIO, SIZED = range(5)


class Cuts(NamedTuple):
    """n cut-outs.

    pictures: (n,SIDE,SIDE,PLANES). around: (n,AROUND), what the search says there. labels: (n,5).
    others: (n,), which show other things that fly.
    """

    pictures: NDArray[np.uint8]
    around: NDArray[np.float16]
    labels: NDArray[np.float32]
    others: NDArray[np.bool_]


class Cutter:
    """Cuts pictures by what the packaged network finds in them."""

    def __init__(self, seed: int) -> None:
        self._eyes, self._rng = Eyes(), np.random.default_rng([seed, 86])

    def shard(self, shard: Shard) -> Cuts:
        """Return the cut-outs of rendered pictures."""
        return joined(
            self._cut(np.ascontiguousarray(picture[..., :3]), drones, _TIMES)
            for picture, drones in zip(shard.pictures, shard.drones, strict=True)
        )

    def real(self, source: Path) -> Cuts:
        """Return the cut-outs of the even videos in a folder."""
        made = []
        for video in videos(source, odd=False):
            for number, (image, boxes) in enumerate(video.frames(EVERY)):
                part, top = _part(image, number % 2 == 1)
                rows = {name: box_rows(each - [0, top, 0, 0]) for name, each in boxes.items()}
                rows = {
                    name: r[(r[:, V] > 0) & (r[:, V] < LENS.height)] for name, r in rows.items()
                }
                drones = rows.pop("DRONE", box_rows(np.zeros((0, 4))))
                others = np.concatenate([box_rows(np.zeros((0, 4))), *rows.values()])
                made.append(self._cut(part, drones, _VIDEO_TIMES, others))
        return joined(made)

    def _cut(
        self, image: Image, drones: NDArray[np.float32], times: int, others: Vector | None = None
    ) -> Cuts:
        look = self._eyes.look(image)
        found = peaks(look.drones, _LEAST_HEAT).first(_MOST)
        wanted = drones[drones[:, WANTED] == 1]
        beside = self._beside(wanted, _DRONE_IN_BOX, times)
        places, sizes = np.vstack([found.places, beside[0]]), np.append(found.sizes, beside[1])
        flying = np.zeros(len(sizes), bool)
        if others is not None and len(others):
            more = self._beside(others, _OTHER_IN_BOX, times)
            places, sizes = np.vstack([places, more[0]]), np.append(sizes, more[1])
            flying = np.append(flying, np.ones(len(more[1]), bool))
        rows = labels(places, sizes, drones)
        known = rows[:, DRONE] >= 0
        places, sizes = places[known], sizes[known]
        said = around(look, places).astype(np.float16)
        return Cuts(cut_outs(image, places, sizes), said, rows[known], flying[known])

    def _beside(self, rows: Vector, share: float, times: int) -> tuple[Vector, Vector]:
        """Return places (n,2) and sizes (n,) near those of drones (m,4); share: radius in a box."""
        rows = np.repeat(rows.astype(float), times, axis=0)
        sizes = np.where(rows[:, SIZE] > 0, rows[:, SIZE], np.maximum(-share * rows[:, SIZE], 4.0))
        off = _ASIDE * np.maximum(sizes, 6.0)[:, None] * self._rng.normal(size=(len(rows), 2))
        sizes = sizes * np.exp(_SIZED * self._rng.normal(size=len(rows)))
        return rows[:, [U, V]] + off, sizes


def labels(places: Vector, sizes: Vector, drones: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the labels (n,5) of places (n,2) and sizes (n,) among drones (m,4); DRONE −1: open."""
    out = np.zeros((len(places), 5), np.float32)
    drones = drones[(drones[:, WANTED] >= 0)].astype(float)
    if not len(drones) or not len(places):
        return out
    width = widths(sizes)
    size, boxed = np.abs(drones[:, SIZE]), drones[:, SIZE] < 0
    away = np.linalg.norm(places[:, None] - drones[None, :, [U, V]], axis=2)
    ratio = np.where(boxed, 1.0, size / (width[:, None] / RADII))
    near = away < np.where(boxed, _NEAR_BOX * size, np.maximum(_NEAR * size, _NEAR_PX))
    near &= (ratio < _TIMES_SIZE) & (ratio > 1 / _TIMES_SIZE) & (drones[:, WANTED] == 1)
    beside = away < np.where(boxed, _BESIDE_BOX * size, np.maximum(_BESIDE * size, _BESIDE_PX))
    out[beside.any(axis=1), DRONE] = -1
    best = np.where(near, away, np.inf).argmin(axis=1)
    right = np.flatnonzero(near.any(axis=1))
    chosen = best[right]
    out[right, DRONE] = 1
    out[right, DU] = (drones[chosen, U] - places[right, 0]) / width[right]
    out[right, DV] = (drones[chosen, V] - places[right, 1]) / width[right]
    out[right, RATIO] = np.log(ratio[right, chosen])
    out[right, SIZED] = ~boxed[chosen]
    return out


def joined(parts: Iterable[Cuts]) -> Cuts:
    """Return all of them as one."""
    return Cuts(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def save(file: Path, cuts: Cuts) -> None:
    """Write cut-outs; where the file is there, it is complete."""
    new = file.with_suffix(".new.npz")
    np.savez(new, **cuts._asdict())
    new.replace(file)


def load(file: Path) -> Cuts:
    """Return what `save` wrote."""
    held = np.load(file)
    return Cuts(*(held[name] for name in Cuts._fields))


def _part(image: Image, low: bool) -> tuple[Image, int]:
    """Return the upper or lower part of a picture, of the height that flies, and its first row."""
    height = min(image.shape[0], LENS.height)
    top = image.shape[0] - height if low else 0
    return np.ascontiguousarray(image[top : top + height]), top
