"""A user's own network of the YOLO family, as ONNX (detector: yolo).

Three layouts of the output are in use: (1, 4 + classes, n) without objectness (version 8 and later)
and (1, n, 5 + classes) with it (versions 5 and 7), where boxes are centre, width and height in the
input's pixels; and (1, n, 6), two corners, score and class, of networks that suppress overlaps
themselves (version 10, and others exported end to end).
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from companion.perception.camera import Camera
from companion.perception.networks import ModelError, OnnxNetwork, Tensor, check_scores
from companion.types import Detection, Image
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import StrictModel

_PADDING = 114  # grey that these networks are trained with
_ROWS, _COLUMNS, _END_TO_END = "rows", "columns", "end-to-end"


class YoloConfig(StrictModel):
    """The network's input, and how its output becomes detections."""

    size: int = Field(
        640, ge=32, le=2048, multiple_of=32, description="Edge of its square input [px]."
    )
    classes: list[Annotated[int, Field(ge=0)]] = Field(
        [], description="Numbers of the classes that are drones; empty: all."
    )
    threshold: float = Field(0.35, gt=0, lt=1, description="Least confidence.")
    overlap: float = Field(0.45, gt=0, lt=1, description="Boxes with a larger overlap are one.")
    radius: float = Field(0.2, gt=0, description="Half the width of a drone [m].")
    sigma_range: float = Field(0.15, gt=0, description="1 σ, as a share of the range.")


class YoloDetector:
    """Runs the network on a camera's frames.

    Raises:
        ModelError: a file that is missing or not such a network.
    """

    def __init__(self, camera: Camera, config: YoloConfig, model: Path) -> None:
        self._camera, self._config = camera, config
        self.network = OnnxNetwork(model, config.size, config.size)
        shape = self.network.shape
        if len(shape) != 3 or shape[0] != 1 or min(shape[1:]) < 5:
            raise ModelError(
                f"{model}: gives {shape}; a YOLO gives (1, 4+classes, n), (1, n, 5+classes) or "
                "(1, n, 6)"
            )
        self._layout = _layout(shape, config.size)
        known = {_ROWS: shape[1] - 4, _COLUMNS: shape[2] - 5}.get(self._layout)
        if known is not None and (unknown := [n for n in config.classes if n >= known]):
            raise ModelError(
                f"{model}: tells {known} classes, from 0 on; sensing.yolo.classes names {unknown}"
            )

    def detect(self, image: Image) -> list[Detection]:
        """Return the drones in image (H,W,3) uint8 BGR, nearest first."""
        c = self._config
        height, width = image.shape[:2]
        scale = c.size / max(width, height)
        w, h = round(width * scale), round(height * scale)
        canvas = np.full((c.size, c.size, 3), _PADDING, np.uint8)
        cv2.resize(image, (w, h), dst=canvas[:h, :w])
        boxes, scores = self._boxes(self.network.run(canvas, swap=True)[0])
        corners = np.hstack([boxes[:, :2] - boxes[:, 2:] / 2, boxes[:, 2:]])
        check_scores(scores)
        kept = cv2.dnn.NMSBoxes(corners.tolist(), scores.tolist(), c.threshold, c.overlap)
        found = [self._detection(boxes[i] / scale, float(scores[i])) for i in np.ravel(kept)]
        return sorted(found, key=lambda d: d.range)

    def _boxes(self, out: Tensor) -> tuple[Vector, Vector]:
        """Return the likely boxes (n,4), centre and size [px of the input], and scores (n,)."""
        if self._layout == _END_TO_END:
            rows = out.astype(float)
            wanted = self._config.classes
            drones = np.isin(np.round(rows[:, 5]), wanted) | (not wanted)
            boxes = np.hstack([(rows[:, :2] + rows[:, 2:4]) / 2, rows[:, 2:4] - rows[:, :2]])
            likely = (rows[:, 4] >= self._config.threshold) & drones
            return boxes[likely], rows[likely, 4]
        if self._layout == _ROWS:
            rows, first = out.T.astype(float), 4
            objectness = np.ones(len(rows))
        else:
            rows, first = out.astype(float), 5
            objectness = rows[:, 4]
        classes = rows[:, first:][:, self._config.classes or slice(None)]
        scores = objectness * (classes.max(axis=1) if classes.shape[1] else 1.0)
        likely = scores >= self._config.threshold
        return rows[likely, :4], scores[likely]

    def _detection(self, box: Vector, score: float) -> Detection:
        """Return the detection of a box [px of the frame]: its longer side is the drone's width."""
        u, v, w, h = box - np.array([0.5, 0.5, 0.0, 0.0])
        ends = [[u - w / 2, v], [u + w / 2, v]] if w >= h else [[u, v - h / 2], [u, v + h / 2]]
        middle, a, b = self._camera.unproject(np.array([[u, v], *ends]))
        half = np.arccos(np.clip(a @ b, -1.0, 1.0)) / 2
        distance = self._config.radius / max(float(np.sin(half)), 1e-3)
        sigma_range = self._config.sigma_range * distance
        return Detection(middle, distance, 0.1 * float(half) + 0.002, sigma_range, score)


def _layout(shape: tuple[int, ...], size: int) -> str:
    """Return the layout, by the number of boxes of a network of this input size, else by shape."""
    cells = 21 * (size // 32) ** 2  # of strides 8, 16 and 32
    if shape[2] == cells:
        return _ROWS
    boxes = 3 * cells, 3 * (cells + (size // 64) ** 2)  # three a cell; of four strides, too
    if shape[1] in boxes:
        return _COLUMNS
    if shape[2] == 6:
        return _END_TO_END
    return _ROWS if shape[1] < shape[2] else _COLUMNS
