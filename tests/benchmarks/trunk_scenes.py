"""Trunk detection measured on seeded random forests.

Run it: `python -m tests.benchmarks.trunk_scenes [--scenes N] [--seed S] [--tilt DEG]`.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, field

import numpy as np

from companion.perception.camera import Camera
from companion.perception.trunks import TrunkDetector
from companion.types import Trunk
from sitl_sim.sensors.renderer import Renderer, Sensor
from tests.benchmarks.perception_scenes import Scene, scenes


@dataclass
class TrunkBand:
    """Counts and errors of trunks in one band of surface distance."""

    wanted: int = 0
    found: int = 0
    relative: list[float] = field(default_factory=list)
    normalised: list[float] = field(default_factory=list)


@dataclass
class TrunkFigures:
    """All bands, reports that match no trunk, reports in all, nearest trunk wrong by > 15 %."""

    bands: dict[tuple[float, float], TrunkBand]
    ghosts: int = 0
    reports: int = 0
    nearest_wrong: int = 0
    frames: int = 0


def exposed(scene: Scene, camera: Camera) -> list[tuple[float, float, float, float]]:
    """Per trunk: surface distance [m], share of its width in view, azimuth in W [rad], radius.

    In view: the point of its outline at the camera's height lies in the frame and is not hidden
    by a nearer trunk. Share 0.35 and more counts as visible.
    """
    rows = []
    trunks = [
        (c["x"] - scene.p[0], c["y"] - scene.p[1], c["radius"]) for c in scene.world["cylinders"]
    ]
    for i, (x, y, r) in enumerate(trunks):
        d = np.hypot(x, y)
        half, middle = np.arcsin(min(r / d, 1.0)), np.arctan2(y, x)
        az = middle + half * np.linspace(-0.98, 0.98, 41)
        delta = az - middle
        t = d * (np.cos(delta) - np.sqrt(np.maximum((r / d) ** 2 - np.sin(delta) ** 2, 0)))
        ray = np.stack([np.cos(az), np.sin(az), np.zeros_like(az)], axis=1)
        uv = camera.project(ray @ scene.r_wc)
        with np.errstate(invalid="ignore"):
            seen = (uv > 4).all(1) & (uv < (camera.width - 5, camera.height - 5)).all(1)
        for j, (ox, oy, orr) in enumerate(trunks):
            if j != i and np.hypot(ox, oy) - orr < t.max():
                along = ray[:, 0] * ox + ray[:, 1] * oy
                off2 = ox * ox + oy * oy - along**2
                hit = (off2 < orr**2) & (along > 0)
                seen &= ~(hit & (along - np.sqrt(np.maximum(orr**2 - off2, 0)) < t))
        rows.append((float(d - r), float(seen.mean()), float(middle), float(r)))
    return rows


def add(figures: TrunkFigures, scene: Scene, camera: Camera, reports: list[Trunk]) -> None:
    """Match one frame's reports to its trunks."""
    truth = exposed(scene, camera)
    figures.frames += 1
    figures.reports += len(reports)
    heading = [scene.r_wc @ t.direction for t in reports]
    azimuth = [float(np.arctan2(h[1], h[0])) for h in heading]
    used: set[int] = set()
    for gap, share, middle, r in truth:
        half = np.arcsin(min(r / (gap + r), 1.0))
        near = [
            (abs(reports[k].distance - reports[k].radius - gap), k)
            for k, a in enumerate(azimuth)
            if k not in used
            and abs((a - middle + np.pi) % (2 * np.pi) - np.pi) < 0.9 * half + 0.02
            and abs(reports[k].distance - reports[k].radius - gap) < 0.3 * gap + 0.5
        ]
        if near:
            used.add(min(near)[1])
        if share < 0.35:
            continue
        for (low, high), band in figures.bands.items():
            if low <= gap < high:
                band.wanted += 1
                if near:
                    match = reports[min(near)[1]]
                    error = match.distance - match.radius - gap
                    band.found += 1
                    band.relative.append(error / gap)
                    band.normalised.append(error / match.sigma)
    figures.ghosts += len(reports) - len(used)
    visible = [row for row in truth if row[1] >= 0.5 and row[0] < 8.0]
    if visible:
        gap = min(visible)[0]
        best = min((t.distance - t.radius for t in reports), default=np.inf)
        hidden_nearer = min(row[0] for row in truth if row[1] > 0.02)
        figures.nearest_wrong += not (hidden_nearer * 0.85 - 0.1 <= best <= gap * 1.15 + 0.1)


def evaluate(
    count: int,
    seed: int,
    width: int,
    height: int,
    sensor: Sensor | None = None,
    error_deg: float = 0.0,
    tilt_deg: float = 35.0,
) -> tuple[TrunkFigures, list[float]]:
    """Figures and times [ms] over `count` scenes; gravity is off by `error_deg` (1 σ per axis),
    the camera tilted by up to `tilt_deg` about each axis.
    """
    edges = [(0.0, 2.0), (2.0, 5.0), (5.0, 8.0), (8.0, 10.0), (0.0, 5.0), (0.0, 8.0)]
    figures = TrunkFigures({edge: TrunkBand() for edge in edges})
    camera = Camera.equidistant(width, height)
    detector = TrunkDetector(camera)
    rng = np.random.default_rng(seed)
    times: list[float] = []
    renderer: Renderer | None = None
    world: object = None
    for scene in scenes(count, seed, width, height, tilt_deg):
        if renderer is None or scene.world is not world:
            world = scene.world
            renderer = Renderer(scene.world, width, height, seed=scene.seed, sensor=sensor)
        image = renderer.render(scene.p, scene.q, scene.drones, scene.attitudes, scene.seed)
        down = -scene.r_wc[2] + rng.normal(0, np.radians(error_deg), 3)
        begin = time.perf_counter()
        reports = detector.detect(image, down / np.linalg.norm(down), float(scene.p[2]))
        times.append((time.perf_counter() - begin) * 1e3)
        add(figures, scene, camera, reports)
    return figures, times


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--error", type=float, default=0.0, help="of gravity, degrees")
    parser.add_argument("--tilt", type=float, default=35.0, help="of the camera, degrees")
    args = parser.parse_args()
    figures, times = evaluate(
        args.scenes,
        args.seed,
        args.width,
        args.width * 5 // 8,
        error_deg=args.error,
        tilt_deg=args.tilt,
    )
    print("surface m   found  |err|med%  bias%    p95%  sig-n     n")
    for (low, high), band in figures.bands.items():
        e = np.array(band.relative or [np.nan])
        print(
            f"{low:4.1f}–{high:4.1f} {band.found / max(band.wanted, 1):8.3f} "
            f"{100 * np.median(np.abs(e)):8.2f} {100 * np.median(e):8.2f} "
            f"{100 * np.percentile(np.abs(e), 95):8.2f} "
            f"{np.sqrt(np.mean(np.square(band.normalised or [np.nan]))):6.2f} {band.wanted:6d}"
        )
    print(
        f"ghosts {figures.ghosts} of {figures.reports}; nearest wrong in {figures.nearest_wrong} "
        f"of {figures.frames} frames; "
        f"ms p50 {np.median(times):.2f} p99 {np.percentile(times, 99):.2f}"
    )


if __name__ == "__main__":
    main()
