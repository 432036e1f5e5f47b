"""Labelled frames in a folder, the input of `companion bench perception`.

`camera.yaml` is the calibration; `frames.json` lists the frames and their labels (camera frame: x
right, y down, z forward; m, m/s):

    {"frames": [{"file", "conditions", "altitude", "q": [w, x, y, z] body → world,
      "drones": [{"direction": [3], "range", "visible": 0…1, "v": [3] world}],
      "trunks": [{"direction": [3] to the axis, level, "distance" to it, "radius", "visible"}],
      "sequence", "time", "p": [3], "v": [3] world: only of frames that follow each other}]}

`trunks`, `visible` (then 1) and `v` may be left out. `look` names the world's look, where frames of
several looks are compared.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from companion.perception.camera import Camera
from companion.types import Image
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.wire.messages import VehicleState


class LabelError(ValueError):
    """A folder that cannot be used; the text names the file and the mistake."""


@dataclass(frozen=True)
class Drones:
    """The drones of one frame.

    rays (m,3): unit vectors, camera frame. ranges (m,): m. visible (m,): share, 0…1. velocities
    (m,3): m/s, world.
    """

    rays: Vector
    ranges: Vector
    visible: Vector
    velocities: Vector


@dataclass(frozen=True)
class LabelledFrame:
    """One frame and its truth.

    trunks (k,6): direction, distance to the axis, radius, visible; None where not labelled.
    sequence: number of its flight; None for a single frame. look: of the world; None where the
    frames are not of several looks.
    """

    file: Path
    conditions: str
    own: VehicleState
    drones: Drones
    trunks: Vector | None
    sequence: int | None
    look: str | None = None

    def image(self) -> Image:
        """Return the picture (H,W,3) uint8 BGR.

        Raises:
            LabelError: a file that cannot be read.
        """
        image = cv2.imread(str(self.file), cv2.IMREAD_COLOR)
        if image is None:
            raise LabelError(f"{self.file}: not a picture that OpenCV reads")
        return image  # type: ignore[return-value]


def load(folder: Path) -> tuple[Camera, list[LabelledFrame]]:
    """Return the camera and the frames of a folder.

    Raises:
        LabelError: a `frames.json` that is missing or not as above.
        CalibrationError: a `camera.yaml` that cannot be used.
    """
    listing = folder / "frames.json"
    camera = Camera.load(folder / "camera.yaml")
    try:
        rows = json.loads(listing.read_text(encoding="utf-8"))["frames"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise LabelError(f"{listing}: no list of frames: {error!r}") from error
    return camera, list(_frames(folder, listing, rows))


def _frames(folder: Path, listing: Path, rows: list[dict[str, Any]]) -> Iterator[LabelledFrame]:
    for number, row in enumerate(rows):
        try:
            yield _frame(folder, row)
        except (KeyError, ValueError, TypeError, AttributeError) as error:
            raise LabelError(f"{listing}: frame {number}: {error!r}") from error


def _frame(folder: Path, row: dict[str, Any]) -> LabelledFrame:
    p = np.array([0.0, 0.0, float(row["altitude"])])
    own = VehicleState(
        float(row.get("time", 0.0)),
        np.array(row.get("p", p), float),
        np.array(row.get("v", [0.0, 0, 0]), float),
        np.array(row["q"], float),
        np.zeros(3),
    )
    drones = row["drones"]
    known = Drones(
        np.array([d["direction"] for d in drones], float).reshape(-1, 3),
        np.array([d["range"] for d in drones], float),
        np.array([d.get("visible", 1.0) for d in drones], float),
        np.array([d.get("v", [np.nan] * 3) for d in drones], float).reshape(-1, 3),
    )
    trunks = None
    if "trunks" in row:
        trunks = np.array(
            [[*t["direction"], t["distance"], t["radius"], t["visible"]] for t in row["trunks"]]
        ).reshape(-1, 6)
    conditions = str(row.get("conditions", "clean"))
    return LabelledFrame(
        folder / row["file"],
        conditions,
        own,
        known,
        trunks,
        row.get("sequence"),
        row.get("look"),
    )
