"""Places of landmarks relative to the drone, with their joint covariance.

The drone's own position drifts. That moves all landmarks together, so their errors are correlated:
a look at one landmark tells how far the others have shifted, too. Landmarks that no look corrects
grow uncertain. This is the filter of simultaneous localisation and mapping, in the frame of the
drone: the drone's pose is taken as it is, and the landmarks carry its doubt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mavlink_bridge.shared.arrays import Vector

Place = tuple[float, float]


@dataclass(frozen=True)
class Drift:
    """How far the own pose may have drifted since the last look: m and rad, 1 σ."""

    position: float = 0.0
    yaw: float = 0.0


class LandmarkPlaces:
    """Means and covariance of n places (x, y) [m], in the order of adding."""

    def __init__(self) -> None:
        self._mean: Vector = np.zeros(0)
        self._covariance: Vector = np.zeros((0, 0))

    def __len__(self) -> int:
        return len(self._mean) // 2

    def place(self, n: int) -> Place:
        """Return place n (x, y) m."""
        return float(self._mean[2 * n]), float(self._mean[2 * n + 1])

    def variance(self, n: int) -> float:
        """Return the variance of place n along one axis [m²]."""
        i = 2 * n
        return 0.5 * float(self._covariance[i, i] + self._covariance[i + 1, i + 1])

    def drift(self, here: Place, drift: Drift) -> None:
        """Let the pose drift: a shift, and a turn about the drone at `here`."""
        if not len(self):
            return
        arms = self._mean.reshape(-1, 2) - here
        moved = np.zeros((len(self._mean), 3))
        moved[0::2, 0] = moved[1::2, 1] = drift.position
        moved[0::2, 2], moved[1::2, 2] = -drift.yaw * arms[:, 1], drift.yaw * arms[:, 0]
        self._covariance += moved @ moved.T

    def add(self, place: Place, variance: float) -> None:
        """Append a landmark that was seen at `place` m with a variance [m²] along each axis."""
        n = len(self._mean)
        covariance = np.zeros((n + 2, n + 2))
        covariance[:n, :n] = self._covariance
        covariance[n, n] = covariance[n + 1, n + 1] = variance
        self._mean, self._covariance = np.append(self._mean, place), covariance

    def correct(self, n: int, place: Place, variance: float, floor: float) -> None:
        """Correct all by a look that shows landmark n at `place` m, of a variance [m²].

        floor: least variance [m²] of n.
        """
        i = 2 * n
        p = self._covariance
        ph = p[:, i : i + 2]
        gain = np.linalg.solve(ph[i : i + 2] + variance * np.eye(2), ph.T).T
        self._mean = self._mean + gain @ (np.array(place) - self._mean[i : i + 2])
        p = p - gain @ ph.T
        self._covariance = 0.5 * (p + p.T)
        for k in (i, i + 1):
            self._covariance[k, k] = max(self._covariance[k, k], floor)

    def keep(self, left: Sequence[int]) -> None:
        """Drop all landmarks but those of these numbers."""
        rows = [k for n in left for k in (2 * n, 2 * n + 1)]
        self._mean, self._covariance = self._mean[rows], self._covariance[np.ix_(rows, rows)]
