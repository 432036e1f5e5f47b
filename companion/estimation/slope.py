"""How steeply the ground rises: by what passes under a rangefinder, and by what the camera sees.

Both are linear in the slope, so that their evidence adds up; it fades with the way flown, as the
ground's shape changes. Most ground is level, and there a slope of 0.01 would shift a trunk 10 m off
by half a metre. So two kinds of ground are weighed against each other, level and sloping (their
marginal likelihoods, as in Bayesian model averaging): without evidence the ground is level.
"""

from __future__ import annotations

import math

import numpy as np

from mavlink_bridge.shared.arrays import Vector

_LEVEL, _SLOPING = 0.003, 0.15  # m/m, 1 σ of the slope of level and of sloping ground
_RARE = math.log(0.1)  # share of sloping ground
_TILT = 0.01  # rad, least 1 σ of the own tilt, which all pictures share
_LENGTH = 6.0  # m of way in which the evidence fades
_STEP = 0.7  # m between two places under the rangefinder that are compared
_BUMPS = 0.03  # m per √m, by which the ground differs from a slope
_LONG = 3.0  # s; between places farther apart in time the own height has drifted
_STEEPEST = 0.5  # m/m; nothing steeper is flown over


class Slope:
    """Estimates the slope (2,) m/m, east and north, of the ground around the drone."""

    def __init__(self) -> None:
        self._ranged, self._seen = _Evidence(), _Evidence()
        self._tilt = _TILT  # rad, 1 σ
        self._under: tuple[tuple[float, float, float], float] | None = None  # a place, and when
        self.rise: tuple[float, float] = (0.0, 0.0)

    def move(self, way: float) -> None:
        """Let the evidence fade as the drone flies on by `way` [m]."""
        self._ranged.fade(way)
        self._seen.fade(way)

    def pass_over(
        self, place: tuple[float, float, float], time: float, sigma: float, drift: float
    ) -> None:
        """Take in a place x, y, z [m] of the ground that a rangefinder saw at `time` [s].

        sigma: m, 1 σ of its height. drift: m/√s, of the own height.
        """
        if self._under is None or time - self._under[1] > _LONG:
            self._under = place, time
            return
        east, north, up = (b - a for a, b in zip(self._under[0], place, strict=True))
        length = math.hypot(east, north)
        if length < _STEP:
            return
        since = time - self._under[1]
        variance = 2.0 * sigma**2 + drift**2 * since + _BUMPS**2 * length
        self._under = place, time
        self._ranged.faded().add(np.array([[east, north]]), np.array([up]), np.array([variance]))
        self._weigh()

    def see(self, places: Vector, sigmas: Vector, alike: float, tilt: float) -> None:
        """Take in places (n,3) m of the ground in one picture, with 1 σ of their heights (n,) m.

        alike: pictures in a row that share their errors. tilt: rad, 1 σ of the own tilt.
        """
        weights = sigmas**-2.0 / np.sum(sigmas**-2.0)
        offsets = places - weights @ places
        self._seen.faded().add(offsets[:, :2], offsets[:, 2], alike * sigmas**2)
        self._tilt = max(tilt, _TILT)
        self._weigh()

    def _weigh(self) -> None:
        """Find the slope from all evidence."""
        information, weighted = self._seen.faded().blurred(self._tilt)
        ranged = self._ranged.faded()
        information, weighted = information + ranged.information, weighted + ranged.weighted
        level, likely_level = _posterior(information, weighted, _LEVEL)
        sloping, likely_sloping = _posterior(information, weighted, _SLOPING)
        share = 1.0 / (1.0 + math.exp(min(likely_level - likely_sloping - _RARE, 50.0)))
        rise = share * sloping + (1.0 - share) * level
        east, north = (rise * min(1.0, _STEEPEST / max(float(np.hypot(*rise)), 1e-9))).tolist()
        self.rise = east, north


class _Evidence:
    """Sums of a least-squares problem for the slope: information (2,2) and right side (2,)."""

    def __init__(self) -> None:
        self.information: Vector = np.zeros((2, 2))
        self.weighted: Vector = np.zeros(2)
        self._way = 0.0  # m, flown since the last sum

    def fade(self, way: float) -> None:
        """Let it fade as the drone flies on by `way` [m]."""
        self._way += way

    def faded(self) -> _Evidence:
        """Return itself, faded by the way flown since the last time."""
        kept, self._way = math.exp(-self._way / _LENGTH), 0.0
        self.information = self.information * kept
        self.weighted = self.weighted * kept
        return self

    def add(self, ways: Vector, climbs: Vector, variances: Vector) -> None:
        """Add ways (n,2) m along which the ground climbs (n,) m; variances: (n,) m², of these."""
        self.information = self.information + ways.T @ (ways / variances[:, None])
        self.weighted = self.weighted + ways.T @ (climbs / variances)

    def blurred(self, sigma: float) -> tuple[Vector, Vector]:
        """Return both, where an error with 1 σ [m/m] is common to all: (I⁻¹ + σ²)⁻¹."""
        less = np.linalg.inv(np.eye(2) + sigma**2 * self.information)
        return less @ self.information, less @ self.weighted


def _posterior(information: Vector, weighted: Vector, prior: float) -> tuple[Vector, float]:
    """Return the slope (2,) with a prior of 1 σ [m/m], and the log of its marginal likelihood."""
    total = information + np.eye(2) / prior**2
    mean = np.asarray(np.linalg.solve(total, weighted), float)
    spread = math.log(float(np.linalg.det(total)) * prior**4)
    return mean, 0.5 * (float(weighted @ mean) - spread)
