"""The packaged network: drones and the classes of the scene, in one pass (network).

It runs in ONNX Runtime on one thread, so that the same picture gives the same output. It takes
640×400 pictures and gives a heat map of drones (`heat_map`) and, for each 4×4 pixels, the
probabilities of a standing obstacle and of ground; sky and drones are the rest (`feet`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from companion.perception.exposure import exposure_gain
from companion.perception.heat_map import CHANNELS, HEIGHT, STRIDE, WIDTH, Cells
from companion.perception.networks import ModelError, SenselessOutput
from companion.types import Image

PACKAGED = Path(__file__).with_name("models") / "eyes.onnx"
SCENE = (HEIGHT // 4, WIDTH // 4)
_INPUT = {"picture": [1, 3, HEIGHT, WIDTH]}
_OUTPUTS = {
    "drones": [1, CHANNELS, HEIGHT // STRIDE, WIDTH // STRIDE],
    "scene": [1, 2, *SCENE],
}


@dataclass(frozen=True)
class Look:
    """What the network makes of one picture.

    drones: (5,50,80) heat map. scene: (2,100,160) probability of obstacle and of ground.
    """

    drones: Cells
    scene: Cells


def _runtime() -> Any:
    """Return ONNX Runtime.

    Raises:
        ModelError: it is not installed; it takes 80 MB, for this network alone.
    """
    try:
        import onnxruntime
    except ModuleNotFoundError as error:
        advice = "pip install 'swarm-companion[eyes]'"
        raise ModelError(f"not installed: {error.name}; {advice}") from error
    return onnxruntime


class Eyes:
    """Runs the network on a camera's pictures.

    Raises:
        ModelError: a file that is missing or not such a network.
    """

    def __init__(self, model: Path = PACKAGED) -> None:
        if not model.is_file():
            raise ModelError(f"{model}: no such model file")
        ort = _runtime()
        options = ort.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        try:
            self._session = ort.InferenceSession(
                model.read_bytes(), options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # ONNX Runtime's errors share no base but this
            text = " ".join(str(error).split())[:160]
            raise ModelError(f"{model}: not a model that ONNX Runtime reads: {text}") from error
        takes = {each.name: list(each.shape) for each in self._session.get_inputs()}
        gives = {each.name: list(each.shape) for each in self._session.get_outputs()}
        if takes != _INPUT or gives != _OUTPUTS:
            raise ModelError(
                f"{model}: takes {takes} and gives {gives}; a network for `network` takes {_INPUT} "
                f"and gives {_OUTPUTS}: see training/train.py"
            )
        self._picture: Cells = np.zeros((1, 3, HEIGHT, WIDTH), np.float32)

    def look(self, image: Image) -> Look:
        """Return the output for image (H,W,3) uint8 BGR.

        Raises:
            SenselessOutput: an output that is not finite.
        """
        if image.shape[:2] != (HEIGHT, WIDTH):
            image = cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
        gain = np.float32(exposure_gain(image) / 255)
        for channel, plane in enumerate(cv2.split(image)):
            np.multiply(plane, gain, out=self._picture[0, channel])
        drones, scene = self._session.run(list(_OUTPUTS), {"picture": self._picture})
        # A sum is finite only where all its parts are.
        if not np.isfinite(float(drones.sum()) + float(scene.sum())):
            raise SenselessOutput("the network gives NaN or infinite numbers")
        return Look(drones[0], scene[0])
