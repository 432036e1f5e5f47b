"""Places of landmarks relative to the drone, with their joint covariance.

The drone's own position drifts. That moves all landmarks together, so their errors are correlated:
a look at one landmark tells how far the others have shifted, too. Landmarks that no look corrects
grow uncertain. This is the filter of simultaneous localisation and mapping, in the frame of the
drone: the drone's pose is taken as it is, and the landmarks carry its doubt.

The same filter finds by how much the own state lags behind the pictures. A lag moves what is seen
against the landmarks in proportion to the drone's speed and turn, which no drift does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mavlink_bridge.shared.arrays import Vector

_LAG_SIGMA = 0.06  # s, of the lag before anything is seen
_LAG_WALK = 1e-3  # s per √s
LAG_MIN, LAG_MAX = -0.05, 0.3  # s; a camera's own delay may be estimated too long

Place = tuple[float, float]


@dataclass(frozen=True)
class Drift:
    """How far the own pose may have drifted since the last look: m and rad, 1 σ."""

    position: float = 0.0
    yaw: float = 0.0


class LandmarkPlaces:
    """Means and covariance of a lag [s] and of n places (x, y) [m], in the order of adding."""

    def __init__(self) -> None:
        self._mean: Vector = np.zeros(1)
        self._covariance: Vector = np.array([[_LAG_SIGMA**2]])
        self._time: float | None = None

    def __len__(self) -> int:
        return (len(self._mean) - 1) // 2

    @property
    def lag(self) -> tuple[float, float]:
        """By how much the own state is older than the pictures, and the doubt of it [s]."""
        return float(self._mean[0]), math.sqrt(float(self._covariance[0, 0]))

    def place(self, n: int) -> Place:
        """Return place n (x, y) m."""
        return float(self._mean[2 * n + 1]), float(self._mean[2 * n + 2])

    def variance(self, n: int) -> float:
        """Return the variance of place n along one axis [m²]."""
        i = 2 * n + 1
        return 0.5 * float(self._covariance[i, i] + self._covariance[i + 1, i + 1])

    def drift(self, time: float, here: Place, drift: Drift) -> None:
        """Let the pose drift until `time` [s]: a shift, and a turn about the drone at `here`."""
        dt = 0.0 if self._time is None else max(time - self._time, 0.0)
        self._time = time
        self._covariance[0, 0] += _LAG_WALK**2 * dt
        if not len(self):
            return
        arms = self._mean[1:].reshape(-1, 2) - here
        moved = np.zeros((len(self._mean) - 1, 3))
        moved[0::2, 0] = moved[1::2, 1] = drift.position
        moved[0::2, 2], moved[1::2, 2] = -drift.yaw * arms[:, 1], drift.yaw * arms[:, 0]
        self._covariance[1:, 1:] += moved @ moved.T

    def add(self, place: Place, variance: float) -> None:
        """Append a landmark that was seen at `place` m with a variance [m²] along each axis."""
        n = len(self._mean)
        covariance = np.zeros((n + 2, n + 2))
        covariance[:n, :n] = self._covariance
        covariance[n, n] = covariance[n + 1, n + 1] = variance
        self._mean, self._covariance = np.append(self._mean, place), covariance

    def correct(
        self, n: int, place: Place, variance: float, floor: float, motion: Place = (0.0, 0.0)
    ) -> None:
        """Correct all by a look that shows landmark n at `place` m, of a variance [m²].

        floor: least variance [m²] of n. motion: m/s, how fast what is seen moves against the
        landmarks where the own state lags behind the picture.
        """
        i = 2 * n + 1
        p = self._covariance
        # The look shows the place, less what the lag moves it by.
        ph = p[:, i : i + 2] - p[:, :1] * np.array([motion])
        s = ph[i : i + 2] - np.array([motion]).T * ph[:1] + variance * np.eye(2)
        gain = np.linalg.solve(s, ph.T).T
        self._mean = self._mean + gain @ (np.array(place) - self._mean[i : i + 2])
        p = p - gain @ ph.T
        self._covariance = 0.5 * (p + p.T)
        for k in (i, i + 1):
            self._covariance[k, k] = max(self._covariance[k, k], floor)
        self._mean[0] = min(max(self._mean[0], LAG_MIN), LAG_MAX)

    def keep(self, left: Sequence[int]) -> None:
        """Drop all landmarks but those of these numbers."""
        rows = [0, *(k for n in left for k in (2 * n + 1, 2 * n + 2))]
        self._mean, self._covariance = self._mean[rows], self._covariance[np.ix_(rows, rows)]
