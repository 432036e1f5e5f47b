"""Draws perception.webp, what the packaged networks see in each look, with the code that flies.

python docs/perception_figures.py [--seed S]
"""

import argparse
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from companion.bench.labels import LabelledFrame, load
from companion.bench.perception import TO_8, VISIBLE, matched_drones, matched_trunks
from companion.perception.camera import Camera
from companion.perception.config import SensingConfig
from companion.perception.network_search import NetworkSearch
from companion.types import Detection, Image, Trunk
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import rotation_matrix

OUT = Path(__file__).with_name("perception.webp")
LOOKS = (
    *("clearing", "litter", "grass", "asphalt", "sand", "snow", "mud", "field", "birch", "pine"),
    *("brown", "mossy", "cold", "warm", "dappled", "dusk", "misty", "harsh", "cheap", "random"),
)
REACH = 9.0  # m
RIGHT, FALSE, MISSED = (80, 220, 80), (60, 60, 255), (60, 60, 255)
STANDS, STANDS_NOT = (255, 160, 60), (0, 160, 255)
HEIGHTS = np.linspace(-1.2, 1.2, 13)  # m over the camera, where edges are drawn
_SHOWN = 2  # drones
COLUMNS, WIDTH, QUALITY = 4, 400, 75


def main() -> None:
    """Draw the first picture of each look that shows two drones."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=4242)
    seed = str(parser.parse_args().seed)
    tiles = []
    with TemporaryDirectory() as made:
        for look in LOOKS:
            folder = Path(made) / look
            render = [sys.executable, "-m", "sitl_sim", "frames", str(folder), "--look", look]
            subprocess.run(
                [*render, "--bodies", "bare", "--count", "6", "--seed", seed], check=True
            )
            camera, frames = load(folder)
            shown = [f for f in frames if (f.drones.ranges < TO_8[1]).sum() >= _SHOWN] or frames
            tiles.append(drawn(camera, shown[0], look))
    rows = [np.hstack(tiles[n : n + COLUMNS]) for n in range(0, len(tiles), COLUMNS)]
    cv2.imwrite(str(OUT), np.vstack(rows), [cv2.IMWRITE_WEBP_QUALITY, QUALITY])


def drawn(camera: Camera, frame: LabelledFrame, look: str) -> Image:
    """Return the frame with what is found in it, and what is there."""
    image = frame.image()
    network = NetworkSearch(camera, SensingConfig(detector="network", obstacles="network"))
    network.look(image)
    down = -(rotation_matrix(frame.own.q_wb) @ rotation_matrix(camera.mount))[2]
    drones = [d for d in network.drones() if d.range < REACH]
    trunks = [t for t in network.trunks(down, float(frame.own.p[2])) if t.distance < REACH]
    picture = image.copy()
    draw_drones(picture, camera, drones, frame)
    draw_obstacles(picture, camera, trunks, frame, down)
    tile = cv2.resize(picture, (WIDTH, WIDTH * 5 // 8), interpolation=cv2.INTER_AREA)
    cv2.putText(tile, look, (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 255), 2)
    return np.asarray(tile, np.uint8)


def draw_drones(
    picture: Image, camera: Camera, found: list[Detection], frame: LabelledFrame
) -> None:
    """Ring what was found, and cross what was not."""
    drones = frame.drones
    there = (drones.visible >= VISIBLE) & (drones.ranges < REACH)
    rays = np.array([d.direction for d in found]).reshape(-1, 3)
    right = matched_drones(found, drones)[2]
    for n, (u, v) in enumerate(camera.project(rays)):
        size = round(max(0.3 / found[n].range * camera.fx, 8.0))
        cv2.circle(picture, (round(u), round(v)), size, RIGHT if n in right.values() else FALSE, 2)
    for n in np.flatnonzero(there):
        if n not in right:
            u, v = camera.project(drones.rays[n : n + 1])[0]
            cv2.drawMarker(picture, (round(u), round(v)), MISSED, cv2.MARKER_TILTED_CROSS, 16, 2)


def draw_obstacles(
    picture: Image, camera: Camera, found: list[Trunk], frame: LabelledFrame, down: Vector
) -> None:
    """Mark the edges of what was found, at the camera's height, and cross what was not."""
    trunks: Vector = np.zeros((0, 6)) if frame.trunks is None else frame.trunks
    trunks = trunks[(trunks[:, 5] >= VISIBLE) & (trunks[:, 3] < REACH)]
    right = matched_trunks(found, trunks)
    for n, trunk in enumerate(found):
        colour = STANDS if n in right.values() else STANDS_NOT
        aside = np.cross(trunk.direction, down)
        aside *= trunk.radius / max(float(np.linalg.norm(aside)), 1e-9)
        for edge in (-aside, aside):
            line = trunk.direction * trunk.distance + edge - np.outer(HEIGHTS, down)
            pixels = camera.project(line)
            inside = ((pixels > 0) & (pixels < [camera.width, camera.height])).all(axis=1)
            edge_shown = np.round(pixels[inside][:, None]).astype(np.int32)
            cv2.polylines(picture, [edge_shown], False, colour, 2)
    for n in set(range(len(trunks))) - set(right):
        u, v = camera.project(trunks[n : n + 1, :3])[0]
        cv2.drawMarker(picture, (round(u), round(v)), STANDS_NOT, cv2.MARKER_TILTED_CROSS, 16, 2)


if __name__ == "__main__":
    main()
