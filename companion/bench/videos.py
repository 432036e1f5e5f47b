"""A detector measured on labelled real videos of drones, birds, aeroplanes and helicopters.

The videos come from other cameras than the drone's: only what is found counts, not how far it is. A
labelled object counts as found where a detection lies in its box. The boxes are loose, some 2.5
times the width of a small drone; sizes are those of the boxes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from companion.bench.labels import LabelError
from companion.bench.video_labels import Boxes, read_boxes
from companion.perception.ball import Detector
from companion.perception.camera import Camera
from companion.types import Image
from mavlink_bridge.shared.arrays import Vector

SIZES = ((8.0, 16.0), (16.0, 32.0), (32.0, np.inf))  # px, longer side of a box
OTHERS = ("BIRD", "AIRPLANE", "HELICOPTER")
_NAME = re.compile(r"V_[A-Z]+_(\d+)")
EVERY = 10  # frames from one that is measured to the next


@dataclass(frozen=True)
class Video:
    """One video and its boxes, frame by frame."""

    file: Path
    boxes: list[Boxes]

    def frames(self, every: int) -> Iterator[tuple[Image, Boxes]]:
        """Yield every so many frames with their boxes.

        Raises:
            LabelError: a video that OpenCV cannot read.
        """
        capture = cv2.VideoCapture(str(self.file))
        if not capture.isOpened():
            raise LabelError(f"{self.file}: not a video that OpenCV reads")
        for number, boxes in enumerate(self.boxes):
            if not capture.grab():
                return
            if number % every == 0:
                _, image = capture.retrieve()
                yield np.asarray(image, np.uint8), boxes


def videos(folder: Path, odd: bool) -> Iterator[Video]:
    """Yield the videos V_CLASS_NNN.mp4 of a folder with their labels; those of odd or even number.

    Raises:
        LabelError: no such videos, or labels that are missing or unreadable.
    """
    files = [f for f in sorted(folder.glob("V_*.mp4")) if _NAME.fullmatch(f.stem)]
    wanted = [f for f in files if int(f.stem.rpartition("_")[2]) % 2 == odd]
    if not wanted:
        raise LabelError(
            f"{folder}: no videos V_CLASS_NNN.mp4 of {'odd' if odd else 'even'} number"
        )
    for file in wanted:
        yield Video(file, read_boxes(file.with_name(f"{file.stem}_LABELS.mat")))


@dataclass
class VideoTally:
    """Counts over pictures.

    wanted, found: drones by size. shown, taken: other objects by class, and those taken for drones.
    false: detections on nothing labelled.
    """

    wanted: dict[tuple[float, float], int] = field(default_factory=lambda: dict.fromkeys(SIZES, 0))
    found: dict[tuple[float, float], int] = field(default_factory=lambda: dict.fromkeys(SIZES, 0))
    shown: dict[str, int] = field(default_factory=lambda: dict.fromkeys(OTHERS, 0))
    taken: dict[str, int] = field(default_factory=lambda: dict.fromkeys(OTHERS, 0))
    pictures: int = 0
    false: int = 0

    def add(self, points: Vector, boxes: Boxes) -> None:
        """Count one picture: the detections' centres (n,2) px and the labels."""
        self.pictures += 1
        explained = np.zeros(len(points), bool)
        for name, rows in boxes.items():
            for x, y, w, h in rows:
                inside = (np.abs(points - [x + w / 2 - 0.5, y + h / 2 - 0.5]) * 2 <= [w, h]).all(1)
                explained |= inside
                if name in self.shown:
                    self.shown[name] += 1
                    self.taken[name] += bool(inside.any())
                for low, high in SIZES:
                    if name == "DRONE" and low <= max(w, h) < high:
                        self.wanted[low, high] += 1
                        self.found[low, high] += bool(inside.any())
        self.false += int(np.count_nonzero(~explained))

    def figures(self) -> dict[str, Any]:
        """Return the figures of the report; None where nothing was measured."""
        recall = {
            f"{low:g}–{high:g} px" if np.isfinite(high) else f"from {low:g} px": {
                "wanted": self.wanted[low, high],
                "recall": _share(self.found[low, high], self.wanted[low, high]),
            }
            for low, high in SIZES
        }
        taken = {
            name.lower(): {"shown": n, "taken_for_drones": _share(self.taken[name], n)}
            for name, n in self.shown.items()
        }
        return {
            "pictures": self.pictures,
            "drones": recall,
            "others": taken,
            "false_per_picture": _share(self.false, self.pictures),
        }


def measure_videos(folder: Path, detector: Detector, camera: Camera) -> dict[str, Any]:
    """Return the figures of a detector over the odd videos of a folder.

    camera: that the detector was made for. Larger pictures are looked at in parts of its size.

    Raises:
        LabelError: no videos, or some that cannot be read.
    """
    tally = VideoTally()
    for video in videos(folder, odd=True):
        for image, boxes in video.frames(EVERY):
            tally.add(_centres(image, detector, camera), boxes)
    return tally.figures()


def _centres(image: Image, detector: Detector, camera: Camera) -> Vector:
    """Return the centres (n,2) px of the detections in a picture, each part of it looked at once.

    Parts overlap, and each gives what lies nearer to its middle than to that of another part.
    """
    corners = [
        (x, y)
        for y in _starts(image.shape[0], camera.height)
        for x in _starts(image.shape[1], camera.width)
    ]
    middles = np.array(corners) + np.array([camera.width / 2 - 0.5, camera.height / 2 - 0.5])
    found = []
    for n, (x, y) in enumerate(corners):
        part = np.zeros((camera.height, camera.width, 3), np.uint8)
        shown = image[y : y + camera.height, x : x + camera.width]
        part[: shown.shape[0], : shown.shape[1]] = shown
        rays = np.array([d.direction for d in detector.detect(part)]).reshape(-1, 3)
        pixels = camera.project(rays) + np.array([x, y])
        away = np.linalg.norm(pixels[:, None] - middles, axis=2)
        found.append(pixels[away.argmin(axis=1) == n])
    return np.vstack(found)


def _starts(length: int, part: int) -> list[int]:
    """Return where parts begin that cover a length [px], evenly spread."""
    count = -(-length // part)
    return [round(n * max(length - part, 0) / max(count - 1, 1)) for n in range(count)]


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None
