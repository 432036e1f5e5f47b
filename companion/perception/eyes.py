"""The packaged network: drones and the classes of the scene, in one pass (network).

It takes 640×400 pictures and gives a heat map of drones (`heat_map`) and, for each 4×4 pixels, the
probabilities of a standing obstacle and of ground; sky and drones are the rest (`feet`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from companion.perception.exposure import exposure_gain
from companion.perception.heat_map import CHANNELS, HEIGHT, STRIDE, WIDTH, Cells
from companion.perception.networks import SenselessOutput
from companion.perception.onnx_runtime import opened
from companion.types import Image

PACKAGED = Path(__file__).with_name("models") / "eyes.onnx"
FEATURES = 32  # channels that the drones are found in
SCENE = (HEIGHT // 4, WIDTH // 4)
_INPUT = {"picture": [1, 3, HEIGHT, WIDTH]}
_OUTPUTS = {
    "drones": [1, CHANNELS, HEIGHT // STRIDE, WIDTH // STRIDE],
    "scene": [1, 2, *SCENE],
    "features": [1, FEATURES, HEIGHT // STRIDE, WIDTH // STRIDE],
}


@dataclass(frozen=True)
class Look:
    """What the network makes of one picture.

    drones: (5,50,80) heat map. scene: (2,100,160) probability of obstacle and of ground. features:
    (FEATURES,50,80), what the drones are found in.
    """

    drones: Cells
    scene: Cells
    features: Cells


def at_its_size(image: Image) -> Image:
    """Return the image at the size that the network takes."""
    if image.shape[:2] == (HEIGHT, WIDTH):
        return image
    return np.asarray(cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA), np.uint8)


class Eyes:
    """Runs the network on a camera's pictures.

    Raises:
        ModelError: a file that is missing or not such a network.
    """

    def __init__(self, model: Path = PACKAGED) -> None:
        self._session = opened(model, _INPUT, _OUTPUTS, "`network` (see training/train.py)")
        self._picture: Cells = np.zeros((1, 3, HEIGHT, WIDTH), np.float32)

    def look(self, image: Image) -> Look:
        """Return the output for image (H,W,3) uint8 BGR.

        Raises:
            SenselessOutput: an output that is not finite.
        """
        image = at_its_size(image)
        gain = np.float32(exposure_gain(image) / 255)
        for channel, plane in enumerate(cv2.split(image)):
            np.multiply(plane, gain, out=self._picture[0, channel])
        found = self._session.run(list(_OUTPUTS), {"picture": self._picture})
        # A sum is finite only where all its parts are.
        if not np.isfinite(sum(float(each.sum()) for each in found)):
            raise SenselessOutput("the network gives NaN or infinite numbers")
        return Look(*(each[0] for each in found))
