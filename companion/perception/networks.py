"""Networks as ONNX files, run by `cv2.dnn` on one thread."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Tensor = NDArray[np.float32]
_SCORE_MAX = 1.01  # a share, and rounding


class ModelError(ValueError):
    """A model file that cannot be used; the text names the file and the reason."""


class SenselessOutput(ValueError):
    """A network gives numbers that cannot be true; the message says which."""


def check_scores(scores: NDArray[Any]) -> None:
    """Raise SenselessOutput where scores (n,) are no shares 0…1."""
    if scores.size and float(scores.max()) > _SCORE_MAX:
        raise SenselessOutput(f"scores up to {float(scores.max()):.3g}, more than 1")


class OnnxNetwork:
    """A network with one picture as input and one output.

    Raises:
        ModelError: a missing file, not ONNX, or not of this input and output.
    """

    def __init__(self, path: Path, width: int, height: int) -> None:
        """width, height: px, of the pictures that the network takes."""
        self._path = path
        if not path.is_file():
            raise ModelError(f"{path}: no such model file")
        # The newer of OpenCV 5's engines takes twice as long for small pictures.
        engine = [cv2.dnn.ENGINE_CLASSIC] if hasattr(cv2.dnn, "ENGINE_CLASSIC") else []
        try:
            self._net = cv2.dnn.readNetFromONNX(str(path), *engine)
        except cv2.error as error:
            raise ModelError(f"{path}: not a model that OpenCV reads: {_brief(error)}") from error
        self._picture: Tensor = np.zeros((1, 3, height, width), np.float32)
        self.shape = self.run(np.zeros((height, width, 3), np.uint8)).shape

    def run(self, image: NDArray[np.uint8], swap: bool = False, gain: float = 1.0) -> Tensor:
        """Return the output for a picture (height,width,3) uint8 BGR.

        The network is given BGR (swap: RGB) 0…1 times `gain`.

        Raises:
            ModelError: a network that does not take such pictures.
        """
        for channel, plane in zip((2, 1, 0) if swap else (0, 1, 2), cv2.split(image), strict=True):
            np.multiply(plane, np.float32(gain / 255), out=self._picture[0, channel])
        return self.forward()

    def forward(self) -> Tensor:
        """Return the output for the last picture once more.

        Raises:
            SenselessOutput: an output that is not finite.
            ModelError: a network that does not take such pictures.
        """
        try:
            self._net.setInput(self._picture)
            out: Tensor = np.asarray(self._net.forward(), np.float32)
        except cv2.error as error:
            size = f"{self._picture.shape[3]}×{self._picture.shape[2]}"
            raise ModelError(
                f"{self._path}: takes no pictures of {size}: {_brief(error)}"
            ) from error
        if not np.isfinite(out).all():
            raise SenselessOutput(f"{self._path}: gives NaN or infinite numbers")
        return out


def _brief(error: cv2.error) -> str:
    """Return the error's text in one short line."""
    return " ".join(str(error.err or error).split())[:160]
