"""Labelled frames in a folder, to measure and train perception.

`camera.yaml` is the calibration, `frames.json` lists the frames: file, conditions, attitude and
altitude, and what is in it (camera frame: x right, y down, z forward; m, m/s):

    {"file", "conditions", "altitude", "q": [w, x, y, z] body → world,
     "drones": [{"direction": [3], "range", "visible": 0…1, "id", "v": [3] world}],
     "trunks": [{"direction": [3] to the axis, level, "distance" to the axis, "radius", "visible"}],
     "sequence", "time", "p": [3], "v": [3] world: only of frames that follow one another}
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.sensors.drones import MAGENTA, Look
from sitl_sim.sensors.fisheye import Lens
from sitl_sim.sensors.renderer import Renderer, Sensor
from sitl_sim.sensors.scenes import (
    Scene,
    crowded_scenes,
    flight_scenes,
    still_scenes,
    trunks_in_view,
)
from sitl_sim.sensors.textures import UInt8

LOOKS = 12  # of drones in one world
# Colours of bark and litter in the renderer's textures, BGR.
_TREE = np.array([[70.0, 82.0, 92.0], [48.0, 88.0, 116.0], [52.0, 98.0, 92.0], [90.0, 112.0, 96.0]])


@dataclass(frozen=True)
class Conditions:
    """How a set of frames is degraded.

    looks: `marked`, `bare` or `tree`. after: alters the rendered picture. hidden: only frames in
    which a drone is partly hidden.
    """

    sensor: Sensor = field(default_factory=Sensor)
    after: Callable[[UInt8, Scene, Lens, np.random.Generator], UInt8] | None = None
    looks: str | None = None
    hidden: bool = False


def _backlight(image: UInt8, scene: Scene, lens: Lens, rng: np.random.Generator) -> UInt8:
    """Add a low sun: glare around it, and underexposure elsewhere."""
    azimuth, height = rng.uniform(-1.2, 1.2), rng.uniform(0.05, 0.5)
    sun = np.array([np.sin(azimuth), -np.sin(height), np.cos(azimuth)])
    away = np.arccos(np.clip(np.tensordot(sun / np.linalg.norm(sun), lens.rays, 1), -1, 1))
    glare = 190 * np.exp(-away / 0.35) + 40
    lit: UInt8 = np.clip(0.55 * image + glare[..., None], 0, 255).astype(np.uint8)
    return lit


def _rain(image: UInt8, scene: Scene, lens: Lens, rng: np.random.Generator) -> UInt8:
    """Add streaks, drops on the lens, and less contrast."""
    veil = cv2.addWeighted(image, 0.8, np.full_like(image, 190), 0.2, 0)
    streaks = np.zeros(image.shape[:2], np.uint8)
    for u, v in rng.uniform([0, 0], [lens.width, lens.height], (260, 2)):
        length = rng.uniform(6, 22)
        end = (int(u + 0.15 * length), int(v + length))
        cv2.line(streaks, (int(u), int(v)), end, int(rng.uniform(30, 90)), 1, cv2.LINE_AA)
    wet = cv2.add(veil, cv2.cvtColor(streaks, cv2.COLOR_GRAY2BGR))
    soft = cv2.GaussianBlur(wet, (0, 0), 4.0)
    drops = np.zeros(image.shape[:2], np.uint8)
    for u, v in rng.integers([0, 0], [lens.width, lens.height], (14, 2)):
        cv2.circle(drops, (int(u), int(v)), int(rng.uniform(4, 14)), 255, -1)
    cover = drops[..., None] > 0
    return np.where(cover, soft, wet).astype(np.uint8)


CONDITIONS = {
    "clean": Conditions(),
    "blur": Conditions(Sensor(blur=1.5)),
    "noise": Conditions(Sensor(noise=9.0)),
    "dark": Conditions(Sensor(exposure=0.35, noise=3.5)),
    "bright": Conditions(Sensor(exposure=2.0)),
    "backlight": Conditions(after=_backlight),
    "rain": Conditions(after=_rain),
    "occlusion": Conditions(hidden=True),
    "tree-coloured": Conditions(looks="tree"),
}


def looks(kind: str, rng: np.random.Generator) -> list[Look]:
    """Return LOOKS appearances of drones of one kind.

    marked: dark with a magenta ball. bare: grey to coloured, without ball. tree: in the colours of
    bark and litter. mixed: any of these.
    """
    made = []
    for _ in range(LOOKS):
        one = str(rng.choice(["marked", "bare", "bare", "tree"])) if kind == "mixed" else kind
        grey = float(rng.uniform(20, 190))
        colour = grey + rng.normal(0, 1, 3) * rng.choice([4.0, 45.0])
        if one == "marked":
            made.append(Look(marker=MAGENTA))
            continue
        if one == "tree":
            colour = _TREE[rng.integers(len(_TREE))] * rng.uniform(0.75, 1.15)
        b, g, r = np.clip(colour, 8, 235).tolist()
        made.append(Look(body=(b, g, r), marker_radius=0.0))
    return made


CROWDS = (1, 5, 10, 20)  # neighbours in view, to measure computation time


def write(
    folder: Path,
    seed: int,
    count: int,
    degraded: int,
    sequences: int,
    kind: str,
    progress: Callable[[str], object] = lambda name: None,
) -> int:
    """Render the evaluation set of a seed and return its number of frames.

    It has `count` clean frames, `degraded` ones of each other condition, `sequences` flights of
    4 s, and `neighbours-N`.

    Raises:
        SettingsError: the seed is negative.
    """
    if seed < 0:
        raise SettingsError([f"--seed: must be at least 0, got {seed}"])
    folder.mkdir(parents=True, exist_ok=True)
    lens = Lens(640, 400)
    write_calibration(folder, lens)
    rows: list[dict[str, Any]] = []
    for name, scene, image in _all(seed, count, degraded, sequences, kind, lens):
        file = f"{len(rows):05d}.png"
        if not cv2.imwrite(str(folder / file), image, [cv2.IMWRITE_PNG_COMPRESSION, 1]):
            raise OSError(f"{folder / file}: cannot be written")
        rows.append({"file": file, "conditions": name.split(":")[0], **label(scene, lens)})
        if ":" in name:
            rows[-1] |= _moving(scene, int(name.split(":")[1]))
        progress(name)
    text = json.dumps({"seed": seed, "looks": kind, "frames": rows})
    (folder / "frames.json").write_text(text)
    return len(rows)


def write_calibration(folder: Path, lens: Lens) -> None:
    """Write `camera.yaml` of an equidistant lens."""
    calibration = {
        "width": lens.width,
        "height": lens.height,
        "fx": lens.f,
        "fy": lens.f,
        "cx": (lens.width - 1) / 2,
        "cy": (lens.height - 1) / 2,
        "k1": 0.0,
        "k2": 0.0,
        "k3": 0.0,
        "k4": 0.0,
    }
    (folder / "camera.yaml").write_text(yaml.safe_dump(calibration, sort_keys=False))


def label(scene: Scene, lens: Lens) -> dict[str, Any]:
    """Return the labels of a scene's picture, as in `frames.json`."""
    offsets = scene.in_camera(scene.drones - scene.p)
    ranges = np.linalg.norm(offsets, axis=1)
    drones = [
        {
            "direction": _plain(offset / r),
            "range": round(float(r), 5),
            "visible": round(float(share), 3),
            "id": int(i),
            "v": _plain(v),
        }
        for offset, r, share, i, v in zip(
            offsets, ranges, scene.visible, scene.ids, scene.velocities, strict=True
        )
    ]
    trunks = [
        {"direction": _plain(level), "distance": round(d, 5), "radius": r, "visible": round(s, 3)}
        for level, d, r, s in trunks_in_view(scene, lens)
    ]
    return {
        "altitude": round(float(scene.p[2]), 5),
        "q": _plain(scene.q),
        "drones": drones,
        "trunks": trunks,
    }


def _moving(scene: Scene, sequence: int) -> dict[str, Any]:
    assert scene.own_v is not None
    return {
        "sequence": sequence,
        "time": scene.time,
        "p": _plain(scene.p),
        "v": _plain(scene.own_v),
    }


def _all(
    seed: int, count: int, degraded: int, sequences: int, kind: str, lens: Lens
) -> Iterator[tuple[str, Scene, UInt8]]:
    for number, (name, conditions) in enumerate(CONDITIONS.items()):
        wanted = count if name == "clean" else degraded
        scenes = still_scenes(
            10 * wanted if conditions.hidden else wanted, seed * 16 + number, lens
        )
        yield from (
            (name, *pair) for pair in rendered(scenes, conditions, kind, lens, seed, wanted)
        )
    for crowd in CROWDS:
        scenes = crowded_scenes(crowd, 12, seed, lens)
        for scene, image in rendered(scenes, CONDITIONS["clean"], kind, lens, seed, 12):
            yield f"neighbours-{crowd}", scene, image
    for n, flight in enumerate(flight_scenes(sequences, 4.0, seed, lens)):
        for scene, image in rendered(iter(flight), CONDITIONS["clean"], kind, lens, seed, 40):
            yield f"sequence:{n}", scene, image


def rendered(
    scenes: Iterator[Scene], conditions: Conditions, kind: str, lens: Lens, seed: int, wanted: int
) -> Iterator[tuple[Scene, UInt8]]:
    """Render scenes under the given conditions; each world has a renderer of its own."""
    rng = np.random.default_rng([seed, 79])
    renderer: Renderer | None = None
    world: dict[str, Any] | None = None
    made = 0
    for index, scene in enumerate(scenes):
        if conditions.hidden and not ((scene.visible > 0.35) & (scene.visible < 0.75)).any():
            continue
        if renderer is None or scene.world is not world:
            world = scene.world
            renderer = Renderer(
                world,
                lens.width,
                lens.height,
                lens.fov_deg,
                seed=seed * 1009 + index,
                sensor=conditions.sensor,
                looks=looks(conditions.looks or kind, rng),
            )
        ids = (scene.ids + index // 25).tolist() if scene.own_v is None else scene.ids.tolist()
        image = renderer.render(
            scene.p, scene.q, scene.drones, scene.attitudes, seed * 100003 + index, drones_id=ids
        )
        if conditions.after is not None:
            image = conditions.after(image, scene, lens, rng)
        yield scene, image
        made += 1
        if made >= wanted:
            return


def _plain(values: np.ndarray) -> list[float]:
    return [round(float(x), 6) for x in values]
