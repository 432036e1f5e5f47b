"""Labelled frames of many looks and bodies in a folder, in the layout of `labelled_frames`.

A frame's `conditions` is its look, and it has two keys more: `look` and `body`. Each drone has its
`radius` [m].
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.sensors.fisheye import Lens
from sitl_sim.sensors.labelled_frames import label, write_calibration
from sitl_sim.sensors.labelled_pictures import drawn_bodies
from sitl_sim.sensors.looks import bodies, look
from sitl_sim.sensors.looks.catalogue import catalogue, readable
from sitl_sim.sensors.looks.renderer import LookRenderer
from sitl_sim.sensors.scenes import RADIUS, varied_scenes
from sitl_sim.sensors.textures import UInt8
from sitl_sim.worlds.ground import Ground

ALL = "all"
_TILT_DEG = 15.0
_PER_WORLD = 5  # pictures of one world and look


def chosen(names: str, known: Sequence[str], every: Sequence[str], option: str) -> list[str]:
    """Return the names of a comma-separated list; `all`: every one.

    Raises:
        SettingsError: a name is not known; the message names the option and the valid names.
    """
    if names == ALL:
        return list(every)
    for name in names.split(","):
        if name not in known:
            raise SettingsError([f"{option}: no {name!r}; valid: {ALL}, {', '.join(known)}"])
    return names.split(",")


def write_looks(
    folder: Path,
    seed: int,
    count: int,
    looks: str,
    kinds: str,
    progress: Callable[[str], object] = lambda name: None,
    open_ground: float = 0.0,
) -> int:
    """Render `count` frames of each look and body into the folder; return their number.

    looks, kinds: comma-separated, or `all`: each readable look, each kind of body.
    open_ground: share of worlds with few trunks or none, where the horizon shows.

    Raises:
        SettingsError: the seed is negative, a name is not known.
    """
    if seed < 0:
        raise SettingsError([f"--seed: must be at least 0, got {seed}"])
    known = [*catalogue()["looks"], *catalogue()["unreadable"]]
    names = chosen(looks, known, readable(), "--look")
    bodies_ = chosen(kinds, [*bodies.KINDS, "ball", "bare", "mixed"], bodies.KINDS, "--bodies")
    folder.mkdir(parents=True, exist_ok=True)
    lens = Lens(640, 400)
    write_calibration(folder, lens)
    rows: list[dict[str, Any]] = []
    for name in names:
        for j, kind in enumerate(bodies_):
            own = (seed * 1009 + known.index(name)) * 31 + j
            for row, image in _frames(own, count, name, kind, lens, open_ground):
                file = f"{len(rows):05d}.png"
                if not cv2.imwrite(str(folder / file), image, [cv2.IMWRITE_PNG_COMPRESSION, 1]):
                    raise OSError(f"{folder / file}: cannot be written")
                rows.append({"file": file, "conditions": name, "look": name, "body": kind, **row})
                progress(name)
    text = json.dumps({"seed": seed, "looks": names, "bodies": bodies_, "frames": rows})
    (folder / "frames.json").write_text(text)
    return len(rows)


def _frames(
    seed: int, count: int, name: str, kind: str, lens: Lens, open_ground: float
) -> Iterator[tuple[dict[str, Any], UInt8]]:
    """Yield labels and picture of `count` scenes, a new world and look for each _PER_WORLD."""
    for first in range(0, count, _PER_WORLD):
        own = seed * 4099 + first
        made = drawn_bodies(kind, np.random.default_rng([own, 86]))
        radii = [b.radius if isinstance(b, bodies.Body) else RADIUS for b in made]
        renderer: LookRenderer | None = None
        most = min(_PER_WORLD, count - first)
        scenes = varied_scenes(most, own, lens, _TILT_DEG, 10.0, open_ground)
        for k, scene in enumerate(scenes):
            if renderer is None:
                renderer = LookRenderer(scene.world, look.draw(name, own), lens, own, made)
            picture = renderer.picture(
                scene.p, scene.q, scene.drones, scene.attitudes, own + k,
                drones_id=(scene.ids + k).tolist(),
            )  # fmt: skip
            row = label(scene, lens)
            ground = float(Ground(scene.world).height(scene.p[0], scene.p[1]))
            row["altitude"] = round(row["altitude"] - ground, 5)
            shares = picture.shown[:, 1] / np.maximum(picture.shown[:, 0], 1e-6)
            for drone, n, share in zip(row["drones"], scene.ids, shares, strict=True):
                drone["radius"] = round(radii[(int(n) + k) % len(radii)], 5)
                drone["visible"] = round(min(drone["visible"], float(share)), 3)
            yield row, picture.image
