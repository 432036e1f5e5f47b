"""Real pictures: frames and cut-outs of labelled drone videos, in shards on disk.

The videos are those of `DroneDetectionThesis/Drone-detection-dataset` (CC0). Training uses videos
of even number only; `companion bench perception --videos` reports on the odd ones.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.bench.videos import Video, videos
from training.data import MOST, OPEN, Shard

EVERY, EVERY_CUT = 24, 12  # frames from one that is used to the next; for cut-outs
_QUALITY = 88  # of the frames on disk, as JPEG
_SMOOTH, _CONTRAST = 7.0, 30.0  # grey levels: of the sky around a cut-out, of the object before it


class CutOut(NamedTuple):
    """An object before the sky: its picture (h,w,3) BGR, its opacity (h,w) 0…1, drone or not."""

    picture: NDArray[np.uint8]
    opacity: NDArray[np.float32]
    drone: bool


def real_shard(folder: Path, source: Path) -> Shard:
    """Return frames of all even videos; a missing file is made first. Pixels are not classified."""
    path = folder / "real.npz"
    if not path.exists():
        packed, rows = [], []
        for video in videos(source, odd=False):
            for image, boxes in video.frames(EVERY):
                packed.append(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1])
                rows.append(_rows(boxes.get("DRONE", np.zeros((0, 4)))))
        folder.mkdir(parents=True, exist_ok=True)
        ends = np.cumsum([len(p) for p in packed])
        np.savez(path, packed=np.concatenate(packed), ends=ends, drones=np.stack(rows))
    held = np.load(path)
    images = [
        cv2.imdecode(part, cv2.IMREAD_COLOR) for part in np.split(held["packed"], held["ends"][:-1])
    ]
    pictures = np.full((*np.shape(images)[:3], 4), OPEN, np.uint8)
    pictures[..., :3] = images
    return Shard(pictures, held["drones"])


def cut_outs(folder: Path, source: Path) -> list[CutOut]:
    """Return the objects of all even videos that stand before a smooth sky."""
    path = folder / "cut-outs.npz"
    if not path.exists():
        found = [c for video in videos(source, odd=False) for c in _cut(video)]
        parts = {f"p{n}": c.picture for n, c in enumerate(found)}
        parts |= {f"o{n}": np.round(255 * c.opacity).astype(np.uint8) for n, c in enumerate(found)}
        np.savez_compressed(path, drone=np.array([c.drone for c in found]), **parts)
    data = np.load(path)
    return [
        CutOut(data[f"p{n}"], data[f"o{n}"].astype(np.float32) / 255, bool(d))
        for n, d in enumerate(data["drone"])
    ]


def box_rows(boxes: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the labels (n,4) of drones in boxes (n,4) x, y, w, h."""
    x, y, w, h = boxes.reshape(-1, 4).T
    rows = [x + w / 2 - 0.5, y + h / 2 - 0.5, -np.maximum(w, h), np.ones(len(x))]
    return np.column_stack(rows).astype(np.float32)


def _rows(boxes: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the same for a shard: (MOST,4)."""
    rows = np.full((MOST, 4), -1.0, np.float32)
    rows[: len(boxes)] = box_rows(boxes[:MOST])
    return rows


def _cut(video: Video) -> list[CutOut]:
    """Return the cut-outs of one video."""
    found = []
    for image, boxes in video.frames(EVERY_CUT):
        for name, rows in boxes.items():
            for x, y, w, h in rows:
                left, top = max(int(x) - 3, 0), max(int(y) - 3, 0)
                patch = image[top : int(y + h) + 3, left : int(x + w) + 3]
                if min(patch.shape[:2]) >= 8 and (made := _before_sky(patch)) is not None:
                    found.append(CutOut(*made, name == "DRONE"))
    return found


def _before_sky(
    patch: NDArray[np.uint8],
) -> tuple[NDArray[np.uint8], NDArray[np.float32]] | None:
    """Return picture and opacity of what stands in a patch; None where its border is not smooth."""
    border = np.concatenate([patch[0], patch[-1], patch[:, 0], patch[:, -1]]).astype(np.float32)
    if border.std(axis=0).max() > _SMOOTH:
        return None
    off = np.abs(patch.astype(np.float32) - np.median(border, axis=0)).max(axis=2)
    if off.max() < _CONTRAST:
        return None
    opacity = np.clip((off - 8.0) / (0.5 * float(np.percentile(off, 98)) + 1.0), 0.0, 1.0)
    columns, rows = (
        np.flatnonzero(opacity.max(axis=0) > 0.5),
        np.flatnonzero(opacity.max(axis=1) > 0.5),
    )
    if len(columns) < 4 or len(rows) < 2:
        return None
    part = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    return patch[part], cv2.blur(opacity, (2, 2))[part].astype(np.float32)
