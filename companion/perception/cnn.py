"""Drones of any colour by a small network in `cv2.dnn`: a heat map of their centres (cnn)."""

from __future__ import annotations

from pathlib import Path

import cv2

from companion.perception.camera import Camera
from companion.perception.exposure import exposure_gain
from companion.perception.heat_map import CHANNELS, HEIGHT, STRIDE, WIDTH, HeatMap, HeatMapConfig
from companion.perception.networks import ModelError, OnnxNetwork
from companion.types import Detection, Image

PACKAGED = Path(__file__).with_name("models") / "drones.onnx"


class CnnDetector:
    """Runs the network on a camera's frames.

    Raises:
        ModelError: a file that is missing or not such a network.
    """

    def __init__(self, camera: Camera, config: HeatMapConfig, model: Path = PACKAGED) -> None:
        self._reader = HeatMap(camera, config)
        self.network = OnnxNetwork(model, WIDTH, HEIGHT)
        wanted = (1, CHANNELS, HEIGHT // STRIDE, WIDTH // STRIDE)
        if self.network.shape != wanted:
            raise ModelError(
                f"{model}: gives {self.network.shape}, a heat map is {wanted}; "
                "detector: yolo reads models of the YOLO family"
            )

    def detect(self, image: Image) -> list[Detection]:
        """Return the drones in image (H,W,3) uint8 BGR, nearest first."""
        if image.shape[:2] != (HEIGHT, WIDTH):
            image = cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
        return self._reader.read(self.network.run(image, gain=exposure_gain(image))[0])
