"""Rendered pictures with labels, in shards on disk.

A shard holds pictures, the class of every pixel beside its colours, and the drones. Worlds, looks
and drones are drawn by the shard's seed (`sitl_sim.sensors.labelled_pictures`). One shard in twelve
shows looks in which no camera sees: there the network has to learn that it cannot tell.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sitl_sim.sensors.fisheye import Lens
from sitl_sim.sensors.labelled_pictures import Labelled, stream
from sitl_sim.sensors.looks.catalogue import unreadable
from sitl_sim.sensors.looks.shapes import Seen

SHARD = 100  # pictures
KNOWN = 11.5  # m; farther drones are left open
VISIBLE = 0.35  # share; drones that show less are left open
SMALLEST = 3.0  # px, radius; smaller drones are left open: at 13 m one of 0.2 m has 3.5 px
LENS = Lens(640, 400)
MOST = 16  # drones in a picture
CROWD = 14  # of them, where a picture shows many
# Columns of a label. SIZE: radius [px]; below 0: only a loose box of this longer side is known.
# WANTED: 1 yes, 0 left open, −1 no drone.
U, V, SIZE, WANTED = range(4)
# Classes of pixels. FAR: an obstacle that does not matter yet. OPEN: not labelled. UNCLEAR: shows
# nothing that could tell.
OTHER, GROUND, OBSTACLE, DRONE, FAR, OPEN, UNCLEAR = range(7)
DISTANT = 15.0  # m; obstacles beyond are FAR
_SEED = 1_000_000  # shards have seeds that nothing else uses
_OPEN = 0.25  # share of worlds with few trunks: elsewhere these hide the horizon
_UNREADABLE_EVERY, _BALLS_EVERY = 12, 8  # shards


class Shard(NamedTuple):
    """Pictures (n,h,w,4): BGR and the pixel's class; drones (n,MOST,4)."""

    pictures: NDArray[np.uint8]
    drones: NDArray[np.float32]


def load(folder: Path, name: str) -> Shard:
    """Return a shard of a folder."""
    return Shard(*(np.load(folder / f"{name}.{part}.npy") for part in Shard._fields))


def save(folder: Path, name: str, shard: Shard) -> None:
    """Write a shard; where its last file is there, all are, and complete."""
    folder.mkdir(parents=True, exist_ok=True)
    for part in Shard._fields:
        whole = folder / f"{name}.{part}.npy"
        np.save(new := whole.with_suffix(".new.npy"), getattr(shard, part))
        new.replace(whole)


def complete(folder: Path) -> list[str]:
    """Return the names of a folder's rendered shards that are complete, in order."""
    files = folder.glob(f"looks-*.{Shard._fields[-1]}.npy")
    return sorted(f.name.split(".")[0] for f in files if ".new." not in f.name)


def remove(folder: Path, name: str) -> None:
    """Remove a shard."""
    for part in reversed(Shard._fields):
        (folder / f"{name}.{part}.npy").unlink()


def rendered(seed: int, per_world: int | None = None) -> Shard:
    """Return the pictures of a seed; per_world: as many of one world."""
    made = Shard(
        np.zeros((SHARD, LENS.height, LENS.width, 4), np.uint8),
        np.full((SHARD, MOST, 4), -1.0, np.float32),
    )
    blind = seed % _UNREADABLE_EVERY == _UNREADABLE_EVERY - 1
    for n, labelled in enumerate(_pictures(seed, blind, per_world)):
        made.pictures[n, ..., :3] = labelled.image
        rows = drone_rows(labelled)
        if blind:
            rows[:, WANTED] = np.minimum(rows[:, WANTED], 0.0)
        made.drones[n, : len(rows)] = rows
        made.pictures[n, ..., 3] = UNCLEAR if blind else classes(labelled)
    return made


def drone_rows(labelled: Labelled) -> NDArray[np.float32]:
    """Return the labels (m,4) of a picture's drones: pixel u, v, size [px], wanted.

    size: the drone's radius as the lens images it there; it and the lens give the range.
    """
    wanted = (labelled.visible >= VISIBLE) & (labelled.range <= KNOWN) & (labelled.size >= SMALLEST)
    u, v = labelled.pixel.T
    inside = (u > -0.5) & (v > -0.5) & (u < LENS.width - 0.5) & (v < LENS.height - 0.5)
    rows = np.column_stack([u, v, labelled.size, wanted])[(labelled.area > 0) & inside]
    return rows[:MOST].astype(np.float32)


def classes(labelled: Labelled) -> NDArray[np.uint8]:
    """Return the class (h,w) of each pixel of a picture."""
    seen = labelled.seen
    out = np.full(seen.shape, OBSTACLE, np.uint8)
    out[labelled.depth > DISTANT] = FAR
    out[seen == Seen.GROUND] = GROUND
    out[seen == Seen.SKY] = OTHER
    out[(seen == Seen.DRONE) | (seen == Seen.BIRD)] = DRONE
    return out


def _pictures(seed: int, blind: bool, per_world: int | None) -> Iterator[Labelled]:
    """Yield the pictures of one shard."""
    kind = "ball" if seed % _BALLS_EVERY == _BALLS_EVERY - 1 else ("mixed", "bare")[seed % 2]
    names = unreadable() if blind else ["random"]
    each = -(-SHARD // len(names))
    for n, name in enumerate(names):
        own = _SEED + 16 * seed + n
        pictures = stream(own, name, kind, crowd=CROWD, per_world=per_world, open_ground=_OPEN)
        yield from islice(pictures, min(each, SHARD - n * each))
