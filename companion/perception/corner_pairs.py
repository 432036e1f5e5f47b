"""Corner pairs: where corners of one picture are in the next, to a fraction of a pixel.

All that `companion calibrate` needs of the pictures, in a thousandth of their bytes.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.types import Image

_WIDTH = 320  # px of the reduced picture
_CORNERS = 100
_QUALITY, _APART = 0.01, 8  # of a corner against the best one; px between corners
_WINDOW, _LEVELS = (15, 15), 3
_THERE_AND_BACK = 0.5  # px by which a corner followed back may miss its start
_LONGEST = 0.25  # s between two pictures


@dataclass(frozen=True)
class CornerPairs:
    """Corners of the picture stamped `before` [s] that the one stamped `after` [s] shows, too.

    pixels: (n,4) u, v before and u, v after, in the whole picture.
    """

    before: float
    after: float
    pixels: NDArray[np.float32]


class CornerFollower:
    """Follows corners from each picture of a camera to the next."""

    def __init__(self, width: int, height: int) -> None:
        """width, height: px of the pictures."""
        self._small = min(width, _WIDTH), max(round(height * min(width, _WIDTH) / width), 1)
        self._scale = np.array([width / self._small[0], height / self._small[1]] * 2)
        self._before: NDArray[np.uint8] | None = None
        self._stamp = -np.inf

    def update(self, stamp: float, image: Image) -> CornerPairs | None:
        """Return the pairs from the last picture to `image` (H,W,3) uint8 BGR of `stamp` [s].

        None where it is no new picture, or the last is too long ago.
        """
        if stamp <= self._stamp:
            return None
        small = cv2.resize(image, self._small, interpolation=cv2.INTER_AREA)
        grey = np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), np.uint8)
        before, then = self._before, self._stamp
        self._before, self._stamp = grey, stamp
        if before is None or stamp - then > _LONGEST:
            return None
        pixels = (_followed(before, grey) + 0.5) * self._scale - 0.5
        return CornerPairs(then, stamp, pixels.astype(np.float32))


def _followed(before: NDArray[np.uint8], after: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the corners (n,4) px that are found in both pictures, forwards and backwards."""
    corners = cv2.goodFeaturesToTrack(before, _CORNERS, _QUALITY, _APART)
    if corners is None:
        return np.zeros((0, 4))
    there, found = _flow(before, after, np.asarray(corners, np.float32))
    back, returned = _flow(after, before, there)
    miss = np.linalg.norm((back - corners)[:, 0], axis=1)
    kept = (found[:, 0] == 1) & (returned[:, 0] == 1) & (miss < _THERE_AND_BACK)
    h, w = after.shape
    at = there[:, 0]
    kept &= (at > 0.0).all(axis=1) & (at[:, 0] < w - 1) & (at[:, 1] < h - 1)
    return np.hstack([corners[kept, 0], at[kept]]).astype(np.float64)


def _flow(
    before: NDArray[np.uint8], after: NDArray[np.uint8], corners: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return where corners (n,1,2) px are in the other picture, and whether each was found."""
    guess = np.empty_like(corners)  # none is used
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        before, after, corners, guess, winSize=_WINDOW, maxLevel=_LEVELS
    )
    return np.asarray(there, np.float32), np.asarray(found, np.uint8)
