"""Places of landmarks relative to the drone, with their joint covariance.

The drone's own position drifts. That moves all landmarks together, so their errors are correlated:
a look at one landmark tells how far the others have shifted, too. Landmarks that no look corrects
grow uncertain. A wrong tilt shifts all feet that one picture shows, the far ones most; it is
estimated with the places. This is the filter of simultaneous localisation and mapping, in
the frame of the drone: the drone's position and heading are taken as they are, and the landmarks
carry their doubt.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mavlink_bridge.shared.arrays import Vector, norm

Place = tuple[float, float]
# States before the places: tilt [rad] about the own frame's x and y, and about the drone's own
# axes, level. The error of an attitude that is summed up from rates stays as the drone turns; that
# of a mounted camera or of an accelerometer turns with it.
_POSE = 4


@dataclass(frozen=True)
class Drift:
    """How far the own pose may have drifted since the last look: m and rad, 1 σ.

    tilt: rad, 1 σ of the tilt's error. tilt_kept: share of that error which is left since the last
    look.
    """

    position: float = 0.0
    yaw: float = 0.0
    tilt: float = 0.0
    tilt_kept: float = 1.0


@dataclass(frozen=True)
class Look:
    """One look at a landmark, from a drone at `here`.

    here, place: (2,) m, of the drone and where the landmark seems to stand. along, across: m, 1 σ
    along the line of sight and across it. foot: how the own pose shifts the place; None: it does
    not.
    """

    here: Vector
    place: Vector
    along: float
    across: float
    foot: Foot | None = None

    def noise(self, place: Vector) -> Vector:
        """Return the covariance (2,2) m² of this look alone at a landmark at `place` (2,) m."""
        u = _direction(place - self.here)
        side = np.array([-u[1], u[0]])
        noise: Vector = self.along**2 * np.outer(u, u) + self.across**2 * np.outer(side, side)
        return noise

    def pose(self, place: Vector) -> Vector:
        """Return the shift (2,4) m/rad of a landmark at `place` (2,) m by errors of the tilt."""
        if self.foot is None:
            return np.zeros((2, _POSE))
        return self.foot.shift(place - self.here)


@dataclass(frozen=True)
class Foot:
    """The foot of a landmark, whose depression and the height over ground [m] tell its distance.

    yaw: rad, of the drone. radius: m, of the landmark: its foot is nearer than its axis.
    """

    yaw: float
    height: float
    radius: float

    def shift(self, offset: Vector) -> Vector:
        """Return the shift (2,4) m/rad of a landmark at `offset` (2,) m by errors of the tilt.

        A foot at depression a is s = h / tan(a) away: an error e of its elevation shifts it by
        e (s² + h²) / h.
        """
        u = _direction(offset)
        distance = norm(offset)
        s, h = max(distance - self.radius, 0.1), max(self.height, 0.3)
        lever = (s * s + h * h) / h
        c, d = math.cos(self.yaw), math.sin(self.yaw)
        ahead, left = c * u[0] + d * u[1], c * u[1] - d * u[0]
        return np.outer(u, lever * np.array([u[1], -u[0], left, -ahead]))


def _direction(offset: Vector) -> Vector:
    u: Vector = offset / max(norm(offset), 1e-6)
    return u


class LandmarkPlaces:
    """Means and covariance of n places (x, y) [m], in the order of adding."""

    def __init__(self) -> None:
        self._mean: Vector = np.zeros(_POSE)
        self._covariance: Vector = np.zeros((_POSE, _POSE))

    def __len__(self) -> int:
        return (len(self._mean) - _POSE) // 2

    def place(self, n: int) -> Place:
        """Return place n (x, y) m."""
        i = _index(n)
        return float(self._mean[i]), float(self._mean[i + 1])

    def variance(self, n: int) -> float:
        """Return the variance of place n along the axis of its largest doubt [m²]."""
        i = _index(n)
        a, b = self._covariance[i, i], self._covariance[i + 1, i + 1]
        return float(0.5 * (a + b) + math.hypot(0.5 * (a - b), self._covariance[i, i + 1]))

    def drift(self, here: Place, drift: Drift) -> None:
        """Let the pose drift: a shift, a turn about the drone at `here`, and its tilt."""
        self._drift_tilt(drift)
        if not len(self):
            return
        arms = self._mean[_POSE:].reshape(-1, 2) - here
        moved = np.zeros((2 * len(self), 3))
        moved[0::2, 0] = moved[1::2, 1] = drift.position
        moved[0::2, 2], moved[1::2, 2] = -drift.yaw * arms[:, 1], drift.yaw * arms[:, 0]
        self._covariance[_POSE:, _POSE:] += moved @ moved.T

    def _drift_tilt(self, drift: Drift) -> None:
        kept = drift.tilt_kept if len(self) else 0.0  # nothing has told it before
        p, tilt = self._covariance, slice(0, _POSE)
        self._mean[tilt] *= kept
        p[tilt] *= kept
        p[:, tilt] *= kept
        # Half of the variance turns with the drone.
        p[tilt, tilt] += 0.5 * drift.tilt**2 * (1.0 - kept**2) * np.eye(_POSE)

    def corrected(self, look: Look) -> Place:
        """Return where a look shows its landmark, less what errors of the tilt shift it."""
        x, y = look.place - look.pose(look.place) @ self._mean[:_POSE]
        return float(x), float(y)

    def add(self, look: Look) -> None:
        """Append the landmark of a look."""
        n, p = len(self._mean), self._covariance
        place = np.array(self.corrected(look))
        pose = look.pose(place)
        covariance = np.zeros((n + 2, n + 2))
        covariance[:n, :n] = p
        shifted = -pose @ p[:_POSE]
        covariance[n:, :n], covariance[:n, n:] = shifted, shifted.T
        covariance[n:, n:] = look.noise(place) - shifted[:, :_POSE] @ pose.T
        self._mean, self._covariance = np.append(self._mean, place), covariance

    def correct(self, n: int, look: Look, floor: float) -> None:
        """Correct all by a look at landmark n. floor: least variance [m²] of n."""
        i = _index(n)
        p = self._covariance
        place = self._mean[i : i + 2]
        # Shifts at the known place: those at the seen one would make its noise part of the slope,
        # and the estimates would shrink all distances.
        pose = look.pose(place)
        ph = p[:, i : i + 2] + p[:, :_POSE] @ pose.T
        s = ph[i : i + 2] + pose @ ph[:_POSE] + look.noise(place)
        gain = np.linalg.solve(s, ph.T).T
        self._mean = self._mean + gain @ (look.place - place - pose @ self._mean[:_POSE])
        p = p - gain @ ph.T
        self._covariance = 0.5 * (p + p.T)
        for k in (i, i + 1):
            self._covariance[k, k] = max(self._covariance[k, k], floor)

    def keep(self, left: Sequence[int]) -> None:
        """Drop all landmarks but those of these numbers."""
        rows = [*range(_POSE), *(k for n in left for k in (_index(n), _index(n) + 1))]
        self._mean, self._covariance = self._mean[rows], self._covariance[np.ix_(rows, rows)]


def _index(n: int) -> int:
    """Return where place n begins in the state."""
    return _POSE + 2 * n
