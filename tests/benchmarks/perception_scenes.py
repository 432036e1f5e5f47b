"""Seeded random scenes with known truth, and the perception table measured on them.

Needs both siblings (renderer and detectors), so it lives beside the tests. Run it:
`python -m tests.benchmarks.perception_scenes [--scenes N] [--seed S] [--width W]`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from companion.perception.ball import ColorDetector, Detector
from companion.perception.camera import Camera
from companion.types import Detection
from sitl_sim.sensors.fisheye import R_BC, rotation
from sitl_sim.sensors.renderer import Renderer, Sensor

MARKER = 0.10


def quaternion(yaw: float, pitch: float, roll: float) -> np.ndarray:
    """Body → world (w, x, y, z) from Z-Y-X angles [rad]."""
    c, s = np.cos([roll / 2, pitch / 2, yaw / 2]), np.sin([roll / 2, pitch / 2, yaw / 2])
    return np.array(
        [
            c[0] * c[1] * c[2] + s[0] * s[1] * s[2],
            s[0] * c[1] * c[2] - c[0] * s[1] * s[2],
            c[0] * s[1] * c[2] + s[0] * c[1] * s[2],
            c[0] * c[1] * s[2] - s[0] * s[1] * c[2],
        ]
    )


def forest(rng: np.random.Generator) -> dict[str, Any]:
    """The paper's forest: 7×7 trunks of radius 1 m, 7 m apart, jittered."""
    grid = (np.arange(7) - 3) * 7.0
    jitter = rng.uniform(-1.2, 1.2, (7, 7, 2))
    cylinders = [
        {"x": x + jitter[i, j, 0], "y": y + jitter[i, j, 1], "radius": 1.0, "height": 10.0}
        for i, x in enumerate(grid)
        for j, y in enumerate(grid)
    ]
    return {"cylinders": cylinders, "boxes": [], "drone_radius": 0.2}


@dataclass
class Scene:
    """One frame and its truth. p, q: camera's pose. drones: (m,3). visible: (m,) share 0…1."""

    world: dict[str, Any]
    p: np.ndarray
    q: np.ndarray
    drones: np.ndarray
    attitudes: np.ndarray
    visible: np.ndarray
    seed: int

    @property
    def r_wc(self) -> np.ndarray:
        return rotation(self.q) @ R_BC

    def in_camera(self, points: np.ndarray) -> np.ndarray:
        """World points (n,3) in the camera frame."""
        return (points - self.p) @ self.r_wc


def _blocked(start: np.ndarray, ends: np.ndarray, trunks: np.ndarray) -> np.ndarray:
    """(n,) whether the segment from start (3,) to each end (n,3) meets a trunk or the ground."""
    d = ends[:, None, :2] - start[:2]
    f = start[:2] - trunks[None, :, :2]
    a = (d * d).sum(-1)
    b = (d * f).sum(-1)
    c = (f * f).sum(-1) - trunks[None, :, 2] ** 2
    root = b * b - a * c
    t = (-b - np.sqrt(np.maximum(root, 0))) / np.maximum(a, 1e-12)
    hit = (root > 0) & (t > 0) & (t < 1)
    z = start[2] + t * (ends[:, None, 2] - start[2])
    return (hit & (z < trunks[None, :, 3])).any(1) | (ends[:, 2] < 0)


def visible_share(
    p: np.ndarray, drones: np.ndarray, trunks: np.ndarray, camera: Camera, r_wc: np.ndarray
) -> np.ndarray:
    """(m,) share of each marker's disc that the picture shows: in frame and not hidden."""
    n = 48
    k = np.arange(n)
    radius, angle = MARKER * np.sqrt((k + 0.5) / n), k * 2.399963
    share = np.zeros(len(drones))
    for i, drone in enumerate(drones):
        axis = (drone - p) / np.linalg.norm(drone - p)
        e1 = np.cross(axis, [0.3, 0.1, 0.9])
        e1 /= np.linalg.norm(e1)
        e2 = np.cross(axis, e1)
        points = drone + radius[:, None] * (
            np.cos(angle)[:, None] * e1 + np.sin(angle)[:, None] * e2
        )
        uv = camera.project((points - p) @ r_wc)
        with np.errstate(invalid="ignore"):
            seen = (uv > -0.5).all(1) & (uv < (camera.width - 0.5, camera.height - 0.5)).all(1)
        seen &= ~_blocked(p, points, trunks)
        rays = points - p
        for j, other in enumerate(drones):
            if j != i and np.linalg.norm(other - p) < np.linalg.norm(drone - p):
                along = np.clip(rays @ (other - p) / (rays * rays).sum(1), 0, 1)
                gap = np.linalg.norm(p + along[:, None] * rays - other, axis=1)
                seen &= gap > MARKER
        share[i] = seen.mean()
    return share


def scenes(
    count: int, seed: int, width: int = 640, height: int = 400, tilt_deg: float = 35.0
) -> Iterator[Scene]:
    """Random poses in random forests with up to nine drones from 0.5 to 12 m."""
    rng = np.random.default_rng([seed, 77])
    camera = Camera.equidistant(width, height)
    world = forest(rng)
    for index in range(count):
        if index % 25 == 0:
            world = forest(rng)
        trunks = np.array([[c["x"], c["y"], c["radius"], c["height"]] for c in world["cylinders"]])

        def free(point: np.ndarray, gap: float, trunks: np.ndarray = trunks) -> bool:
            distance = np.hypot(*(trunks[:, :2] - point[:2]).T) - trunks[:, 2]
            return bool(distance.min() > gap and 0.4 < point[2] < 6)

        while True:
            p = np.array([*rng.uniform(-27, 27, 2), rng.uniform(0.8, 4.0)])
            if free(p, 0.3):
                break
        q = quaternion(rng.uniform(-np.pi, np.pi), *np.radians(rng.uniform(-tilt_deg, tilt_deg, 2)))
        r_wc = rotation(q) @ R_BC
        drones: list[np.ndarray] = []
        for _ in range(200):
            if len(drones) >= 1 + index % 9:
                break
            bearing, up = np.radians(rng.uniform(-95, 95)), np.radians(rng.normal(0, 8))
            yaw = np.arctan2(r_wc[1, 2], r_wc[0, 2]) + bearing
            reach = rng.uniform(0.5, 12)
            d = p + reach * np.array(
                [np.cos(yaw) * np.cos(up), np.sin(yaw) * np.cos(up), np.sin(up)]
            )
            if free(d, 0.2) and all(np.linalg.norm(d - o) > 0.5 for o in drones):
                drones.append(d)
        position = np.array(drones).reshape(-1, 3)
        tilt = np.radians(rng.uniform(-25, 25, (len(drones), 2)))
        attitudes = np.array([quaternion(rng.uniform(-3, 3), *t) for t in tilt]).reshape(-1, 4)
        visible = visible_share(p, position, trunks, camera, r_wc)
        yield Scene(world, p, q, position, attitudes, visible, seed * 100003 + index)


@dataclass
class Band:
    """Counts and errors of one range band."""

    wanted: int = 0
    found: int = 0
    false: int = 0
    bearing: list[float] = field(default_factory=list)  # deg
    relative: list[float] = field(default_factory=list)  # (measured − true) / true
    normalised: list[float] = field(default_factory=list)  # range error / sigma_range

    def row(self) -> str:
        """One line of the table."""
        rel = np.array(self.relative or [np.nan])
        return (
            f"{self.found / max(self.wanted, 1):6.3f} "
            f"{self.found / max(self.found + self.false, 1):6.3f} "
            f"{np.sqrt(np.mean(np.square(self.bearing or [np.nan]))):8.3f} "
            f"{100 * np.median(np.abs(rel)):8.2f} {100 * np.median(rel):8.2f} "
            f"{np.percentile(np.abs(rel), 95) * 100:8.2f} "
            f"{np.sqrt(np.mean(np.square(self.normalised or [np.nan]))):6.2f} {self.wanted:6d}"
        )


HEADER = "band       recall  prec  bear.rms  |rng|med%  bias%   p95%  sig-n   n"


def score(
    scene: Scene, detections: list[Detection], bands: dict[tuple[float, float], Band]
) -> None:
    """Match one frame's detections to its truth (greedy by angle) and add them to the bands."""
    truth = scene.in_camera(scene.drones)
    distance = np.linalg.norm(truth, axis=1)
    axes = truth / np.maximum(distance, 1e-9)[:, None]
    taken: set[int] = set()
    matched: dict[int, Detection] = {}
    for d in detections:
        angles = np.degrees(np.arccos(np.clip(axes @ d.direction, -1, 1)))
        # Half a marker's angular size or 1.5°, whichever is more, counts as the same drone.
        limit = np.maximum(1.5, np.degrees(MARKER / np.maximum(distance, MARKER)))
        order = [i for i in np.argsort(angles) if i not in taken and angles[i] < limit[i]]
        if order:
            taken.add(int(order[0]))
            matched[int(order[0])] = d
        else:
            for (low, high), band in bands.items():
                band.false += low <= d.range < high
    for i, r in enumerate(distance):
        for (low, high), band in bands.items():
            if not low <= r < high or scene.visible[i] < 0.35:
                continue
            band.wanted += 1
            if i in matched:
                m = matched[i]
                band.found += 1
                band.bearing.append(
                    float(np.degrees(np.arccos(np.clip(axes[i] @ m.direction, -1, 1))))
                )
                band.relative.append((m.range - r) / r)
                band.normalised.append((m.range - r) / m.sigma_range)


def bands() -> dict[tuple[float, float], Band]:
    """Empty bands of the issue's table."""
    edges = [(0.3, 2.0), (2.0, 4.0), (4.0, 8.0), (8.0, 10.0), (10.0, 12.0), (0.3, 8.0), (0.3, 10.0)]
    return {edge: Band() for edge in edges}


def evaluate(
    detector: Detector, count: int, seed: int, width: int, height: int, sensor: Sensor | None = None
) -> tuple[dict[tuple[float, float], Band], list[float]]:
    """Bands and detection times [ms] over `count` scenes."""
    result, times = bands(), []
    renderer: Renderer | None = None
    world: object = None
    for scene in scenes(count, seed, width, height):
        if renderer is None or scene.world is not world:
            world = scene.world
            renderer = Renderer(scene.world, width, height, seed=scene.seed, sensor=sensor)
        image = renderer.render(scene.p, scene.q, scene.drones, scene.attitudes, scene.seed)
        begin = time.perf_counter()
        found = detector.detect(image)
        times.append((time.perf_counter() - begin) * 1e3)
        score(scene, found, result)
    return result, times


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--blur", type=float, default=0.0)
    parser.add_argument("--exposure", type=float, default=1.0)
    parser.add_argument("--noise", type=float, default=2.5)
    args = parser.parse_args()
    height = args.width * 5 // 8
    detector = ColorDetector(Camera.equidistant(args.width, height))
    sensor = Sensor(noise=args.noise, blur=args.blur, exposure=args.exposure)
    result, times = evaluate(detector, args.scenes, args.seed, args.width, height, sensor)
    print(HEADER)
    for (low, high), band in result.items():
        print(f"{low:4.1f}–{high:4.1f} {band.row()}")
    print(f"detect ms p50 {np.median(times):.2f} p99 {np.percentile(times, 99):.2f}")


if __name__ == "__main__":
    main()
