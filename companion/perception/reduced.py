"""A picture in the smaller sizes at which it is judged, compared and followed; each made once."""

from __future__ import annotations

from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.types import Image

Grey = NDArray[np.uint8]
_WIDE = 640  # px from which on half the size is enough for whoever asks for less


class Reduced:
    """One picture; image: (H,W,3) uint8 BGR, as it was taken."""

    def __init__(self, image: Image) -> None:
        self.image = image

    def colour(self, width: int, height: int) -> Image:
        """Return the picture (height,width,3) uint8 BGR, each pixel the mean of its area."""
        return _halved(self._small, width, height)

    def grey(self, width: int, height: int) -> Grey:
        """Return the picture (height,width) uint8 in grey likewise."""
        return _halved(self._small_grey, width, height)

    @cached_property
    def _small(self) -> Image:
        height, width = self.image.shape[:2]
        if width < _WIDE:
            return self.image
        return _resized(self.image, (width + 1) // 2, (height + 1) // 2)

    @cached_property
    def _small_grey(self) -> Grey:
        return np.asarray(cv2.cvtColor(self._small, cv2.COLOR_BGR2GRAY), np.uint8)


def _halved(image: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    """Return the resized picture; halves of halves, rounded each time, take a third of the time."""
    wide, high = image.shape[1], image.shape[0]
    while wide % 2 == 0 and high % 2 == 0 and wide // 2 >= width and high // 2 >= height:
        wide, high = wide // 2, high // 2
        image = _resized(image, wide, high)
    return _resized(image, width, height)


def _resized(image: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    if image.shape[:2] == (height, width):
        return image
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
