"""Visual gyro: the camera's rotation between two pictures, from the pictures alone.

Corners are tracked from picture to picture (Lucas and Kanade). The rotation that explains their
motion is found by iteratively reweighted least squares. Where the drone moves, a corner also moves
along a known direction by an unknown amount, which depends on its distance: along that direction
the corner has little weight (the epipolar constraint for known translation).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from companion.perception.camera import Camera
from companion.perception.pixels import percentile
from companion.perception.reduced import Grey, Reduced
from mavlink_bridge.shared.arrays import Vector, cross

_WIDTH = 160  # px of the reduced picture: subpixel tracking makes 0.05° of it
_CORNERS = 50
_QUALITY, _APART = 0.02, 6  # of a corner against the best one; px between corners
_LEAST = 10  # corners without which there is no rotation
_PIXEL_SIGMA = 0.3  # px, of a tracked corner
_DISTANCE = 6.0  # m, typical of corners: its inverse and the inverse's 1 σ are alike
_STEPS = 5  # of the reweighted least squares
_LITTLE = 1e-6 * np.eye(3)  # information that keeps a solution possible
_DISAGREE = 36.0  # times the expected square error: the points were not tracked


@dataclass(frozen=True)
class VisualRotation:
    """A rotation vector (3,) [rad; camera frame of the first picture], and its 1 σ [rad]."""

    vector: Vector
    sigma: float


class VisualGyro:
    """Measures the rotation from one picture of a camera to another."""

    def __init__(self, camera: Camera) -> None:
        self._height = max(round(camera.height * _WIDTH / camera.width), 1)
        self._camera = camera.scaled(_WIDTH, self._height)

    def reduce(self, picture: Reduced) -> Grey:
        """Return a picture as the small grey one that is compared."""
        return picture.grey(_WIDTH, self._height)

    def rotation(self, before: Grey, after: Grey, moved: Vector) -> VisualRotation | None:
        """Return the rotation from `before` to `after`; None where too little can be tracked.

        moved: (3,) m, own displacement in between, camera frame of `after`.
        """
        corners = cv2.goodFeaturesToTrack(before, _CORNERS, _QUALITY, _APART)
        if corners is None or len(corners) < _LEAST:
            return None
        tracked, found, _ = cv2.calcOpticalFlowPyrLK(
            before,
            after,
            corners,
            np.empty_like(corners),  # no first guess
            winSize=(11, 11),
            maxLevel=2,
        )
        ok = found[:, 0] == 1
        if np.count_nonzero(ok) < _LEAST:
            return None
        first, second = (self._camera.unproject(c[ok, 0]) for c in (corners, tracked))
        return fit_rotation(first, second, moved, _PIXEL_SIGMA / self._camera.fx)


def fit_rotation(
    before: Vector, after: Vector, moved: Vector, sigma: float
) -> VisualRotation | None:
    """Return the camera's rotation from rays `before` (n,3) and `after` (n,3) of the same points.

    None where most of the points do not agree on one.

    moved: (3,) m, own displacement, camera frame of `after`. sigma: rad, of a ray.
    """
    flow = (after @ moved)[:, None] * after - moved  # of a point 1 m away
    length = np.sqrt(np.vecdot(flow, flow)) / _DISTANCE
    along = flow / np.maximum(length * _DISTANCE, 1e-9)[:, None]
    if length.max() < 1e-6:  # without motion any two directions will do
        along = cross(after, np.array([0.0, 1.0, 1e-3]))
        along /= np.linalg.norm(along, axis=1)[:, None]
    # Each ray counts twice: along the flow, and across.
    ways = np.concatenate([along, cross(after, along)])
    weights = np.concatenate([1.0 / (sigma**2 + length**2), np.full(len(after), sigma**-2)])
    twice = np.concatenate([before, before])
    expected = np.vecdot(np.concatenate([after, after]), ways)
    expected[: len(after)] -= length
    rotation, trust = np.eye(3), np.ones(len(after))
    for _ in range(_STEPS):
        turned = twice @ rotation.T
        error = expected - np.vecdot(turned, ways)
        rows = cross(turned, ways)
        weighted = rows * (weights * np.concatenate([trust, trust]))[:, None]
        information = weighted.T @ rows + _LITTLE
        step = cv2.solve(information, weighted.T @ error[:, None])[1]
        rotation = cv2.Rodrigues(step)[0] @ rotation
        # Geman and McClure: moving things and wrong matches lose their weight.
        misfit = (weights * error**2).reshape(2, -1).sum(axis=0) / 2
        spread = max(percentile(misfit, 50) / math.log(2.0), 1.0)
        trust = (1.0 + misfit / (4.0 * spread)) ** -2
    if spread > _DISAGREE:
        return None
    variance = float(np.trace(np.linalg.inv(information))) / 3 * spread
    # The points turn the other way than the camera does.
    vector = -cv2.Rodrigues(rotation)[0].ravel()
    return VisualRotation(np.asarray(vector, float), float(np.sqrt(variance)))
