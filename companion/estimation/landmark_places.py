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

from companion.estimation.turns import turn_about
from mavlink_bridge.shared.arrays import Vector

Place = tuple[float, float]
# States before the places: tilt [rad] about the own frame's x and y, and about the drone's own
# axes, level. The error of an attitude that is summed up from rates stays as the drone turns; that
# of a mounted camera or of an accelerometer turns with it.
_POSE = 4
_TILTS = np.eye(_POSE)
_TURN = 2.0 * math.pi


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

    here, place: (x, y) m, of the drone and where the landmark seems to stand. along, across: m, 1 σ
    along the line of sight and across it. foot: how the own pose shifts the place; None: it does
    not.
    """

    here: Place
    place: Place
    along: float
    across: float
    foot: Foot | None = None

    def noise(self, place: Place) -> Vector:
        """Return the covariance (2,2) m² of this look alone at a landmark at `place` (x, y) m."""
        x, y, _ = _direction(self._offset(place))
        along, across = self.along**2, self.across**2
        mixed = along * (x * y) - across * (x * y)
        return np.array(
            [
                [along * (x * x) + across * (y * y), mixed],
                [mixed, along * (y * y) + across * (x * x)],
            ]
        )

    def pose(self, place: Place) -> Vector:
        """Return the shift (2,4) m/rad of a landmark at `place` (x, y) m by errors of the tilt."""
        if self.foot is None:
            return np.zeros((2, _POSE))
        return self.foot.shift(self._offset(place))

    def _offset(self, place: Place) -> Place:
        return place[0] - self.here[0], place[1] - self.here[1]


@dataclass(frozen=True)
class Foot:
    """The foot of a landmark, whose depression and the height over ground [m] tell its distance.

    yaw: rad, of the drone. radius: m, of the landmark: its foot is nearer than its axis.
    """

    yaw: float
    height: float
    radius: float

    def shift(self, offset: Place) -> Vector:
        """Return the shift (2,4) m/rad of a landmark at `offset` (x, y) m by errors of the tilt.

        A foot at depression a is s = h / tan(a) away: an error e of its elevation shifts it by
        e (s² + h²) / h.
        """
        x, y, distance = _direction(offset)
        s, h = max(distance - self.radius, 0.1), max(self.height, 0.3)
        lever = (s * s + h * h) / h
        c, d = math.cos(self.yaw), math.sin(self.yaw)
        ahead, left = c * x + d * y, c * y - d * x
        shifts = lever * y, lever * -x, lever * left, lever * -ahead
        return np.array([[x * shift for shift in shifts], [y * shift for shift in shifts]])


def _direction(offset: Place) -> tuple[float, float, float]:
    """Return the unit vector (x, y) along an offset (x, y) m, and its length [m]."""
    x, y = offset
    length = math.sqrt(x * x + y * y)
    scale = max(length, 1e-6)
    return x / scale, y / scale, length


class LandmarkPlaces:
    """Means and covariance of n places (x, y) [m], in the order of adding."""

    def __init__(self) -> None:
        self._mean: Vector = np.zeros(_POSE)
        self._covariance: Vector = np.zeros((_POSE, _POSE))

    def __len__(self) -> int:
        return (len(self._mean) - _POSE) // 2

    def places(self) -> list[Place]:
        """Return all places (x, y) m."""
        left = self._mean[_POSE:].tolist()
        return list(zip(left[0::2], left[1::2], strict=True))

    def variances(self) -> list[float]:
        """Return the variance of each place along the axis of its largest doubt [m²]."""
        own = self._covariance[_POSE:, _POSE:]
        axes, mixed = own.diagonal().tolist(), own.diagonal(1)[0::2].tolist()
        return [
            0.5 * (a + b) + math.hypot(0.5 * (a - b), c)
            for a, b, c in zip(axes[0::2], axes[1::2], mixed, strict=True)
        ]

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

    def turn(self, p: Vector, angle: float) -> None:
        """Turn all places left about the drone at p (≥2,) m by a small `angle` [rad]."""
        turn_about(self._mean[_POSE:].reshape(-1, 2), p, angle)

    def _drift_tilt(self, drift: Drift) -> None:
        kept = drift.tilt_kept if len(self) else 0.0  # nothing has told it before
        p, tilt = self._covariance, slice(0, _POSE)
        self._mean[tilt] *= kept
        p[tilt] *= kept
        p[:, tilt] *= kept
        # Half of the variance turns with the drone.
        p[tilt, tilt] += 0.5 * drift.tilt**2 * (1.0 - kept**2) * _TILTS

    def corrected(self, look: Look) -> Place:
        """Return where a look shows its landmark, less what errors of the tilt shift it."""
        x, y = _place(look.pose(look.place) @ self._mean[:_POSE])
        return look.place[0] - x, look.place[1] - y

    def add(self, look: Look) -> None:
        """Append the landmark of a look."""
        n, p = len(self._mean), self._covariance
        place = self.corrected(look)
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
        error, pose, s = self._innovation(i, look)
        ph = self._covariance[:, i : i + 2] + self._covariance[:, :_POSE] @ pose.T
        gain = np.linalg.solve(s, ph.T).T
        self._mean = self._mean + gain @ error
        p = self._covariance - gain @ ph.T
        self._covariance = 0.5 * (p + p.T)
        for k in (i, i + 1):
            self._covariance[k, k] = max(self._covariance[k, k], floor)

    def surprise(self, n: int, look: Look, uneven: float) -> float:
        """Return how little a look is what place n would show: −2 log of its density [1/m²].

        uneven: m², variance of where the same trunk may show, beside the doubt of places and look.
        """
        (x, y), _, s = self._innovation(_index(n), look)
        a, b, c = float(s[0, 0]) + uneven, float(s[1, 1]) + uneven, float(s[0, 1])
        det = a * b - c * c
        return float(b * x * x + a * y * y - 2.0 * c * x * y) / det + math.log(_TURN**2 * det)

    def _innovation(self, i: int, look: Look) -> tuple[Vector, Vector, Vector]:
        """Return what a look shows less what the state says (2,), and its covariance (2,2) last.

        Between them: the shift (2,4) by errors of the tilt. i: where the place begins in the state.
        """
        own = self._covariance[i : i + 2, i : i + 2]
        tilt, mixed = self._covariance[:_POSE, :_POSE], self._covariance[i : i + 2, :_POSE]
        place = _place(self._mean[i : i + 2])
        # Shifts at the known place: those at the seen one would make its noise part of the slope,
        # and the estimates would shrink all distances.
        pose = look.pose(place)
        shifted = mixed @ pose.T
        s = own + shifted + shifted.T + pose @ tilt @ pose.T + look.noise(place)
        return np.array(look.place) - place - pose @ self._mean[:_POSE], pose, s

    def keep(self, left: Sequence[int]) -> None:
        """Drop all landmarks but those of these numbers."""
        rows = [*range(_POSE), *(k for n in left for k in (_index(n), _index(n) + 1))]
        self._mean, self._covariance = self._mean[rows], self._covariance[np.ix_(rows, rows)]


def _place(state: Vector) -> Place:
    x, y = state.tolist()
    return x, y


def _index(n: int) -> int:
    """Return where place n begins in the state."""
    return _POSE + 2 * n
