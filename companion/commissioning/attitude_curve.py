"""The attitude at any time of a flight, from its samples and the body rates at them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import conjugate, multiply, rotation_matrix, rotation_vector
from mavlink_bridge.wire.messages import Attitude

_LONGEST = 0.12  # s between two samples, beyond which nothing between them is known


class AttitudeCurve:
    """Joins attitudes by cubics whose slopes are the body rates.

    A mere line between samples of 50 Hz errs by more than a followed corner does.
    """

    def __init__(self, attitudes: Sequence[Attitude]) -> None:
        """attitudes: two or more, in order of time."""
        self.times = np.array([a.time for a in attitudes])
        self._omega = np.array([a.omega for a in attitudes])
        self._base = np.array([rotation_matrix(a.q_wb) for a in attitudes])
        q = [a.q_wb for a in attitudes]
        turns = [rotation_vector(multiply(conjugate(a), b)) for a, b in itertools.pairwise(q)]
        self._turns = np.array(turns)

    def known(self, times: Vector) -> NDArray[np.bool_]:
        """Return whether each of the times (n,) [s] lies between two near samples."""
        k = np.searchsorted(self.times, times, "right") - 1
        inside = (k >= 0) & (k < len(self.times) - 1)
        k = np.clip(k, 0, len(self.times) - 2)
        near: NDArray[np.bool_] = inside & (self.times[k + 1] - self.times[k] < _LONGEST)
        return near

    def at(self, times: Vector) -> Vector:
        """Return the rotations (n,3,3), body → world, at times (n,) [s]."""
        k = np.clip(np.searchsorted(self.times, times, "right") - 1, 0, len(self.times) - 2)
        h = np.maximum(self.times[k + 1] - self.times[k], 1e-6)
        u = np.clip((times - self.times[k]) / h, -1.0, 2.0)[:, None]
        leaving = u * (1.0 - u) ** 2 * h[:, None] * self._omega[k]
        coming = u * u * (u - 1.0) * h[:, None] * self._omega[k + 1]
        turned = u * u * (3.0 - 2.0 * u) * self._turns[k]
        rotations: Vector = self._base[k] @ rotations_of(leaving + turned + coming)
        return rotations


def rotations_of(vectors: Vector) -> Vector:
    """Return the matrices (n,3,3) of rotation vectors (n,3) [rad] (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=1)
    x, y, z = vectors.T
    o = np.zeros_like(x)
    cross = np.stack([o, -z, y, z, o, -x, -y, x, o], axis=1).reshape(-1, 3, 3)
    first = np.sinc(angle / np.pi)[:, None, None]
    second = (0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2)[:, None, None]
    matrices: Vector = np.eye(3) + first * cross + second * (cross @ cross)
    return matrices
