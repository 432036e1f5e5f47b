"""Height over ground, from a rangefinder that looks down and the own vertical position.

The level of the ground below is a random walk: it changes with the way flown (a slope), and seems
to change with the drift of the own height. Without a rangefinder the ground is where the own frame
has its zero, and the doubt grows with every second and metre.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.ids import SensorRotation
from mavlink_bridge.wire.messages import DistanceSensor, VehicleState

_SIGMA = 0.1  # m, of the ground's level where the own frame began
_SLOPE = 0.1  # m of level per √m flown: a slope of 10° within 3 m
_DRIFT = 0.02  # m per √s: the own height drifts
_SENSOR = 0.03  # m, where the rangefinder does not tell its error
_TILT_MIN = 0.8  # cosine of the angle beyond which the beam looks aside
_GATE = 5.0  # standard deviations; a look farther off is a bush or a neighbour below
_INSIST = 5  # such looks in a row are the ground: a step
_NO_ECHO = 1  # quality of a look without an echo


@dataclass(frozen=True)
class Height:
    """Height over ground [m], its 1 σ [m], and the ground's level in the own frame [m]."""

    value: float
    sigma: float
    ground: float = 0.0


class HeightEstimator:
    """Follows the level of the ground below the drone."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the ground: the own frame has begun anew."""
        self._level, self._variance = 0.0, _SIGMA**2  # m and m², in the own frame
        self._before: tuple[float, Vector] | None = None
        self._refused = 0

    def update(self, own: VehicleState, looks: Iterable[DistanceSensor]) -> Height:
        """Return the height in state `own`, after the looks since the last tick."""
        if self._before is not None:
            dt, way = own.time - self._before[0], np.linalg.norm((own.p - self._before[1])[:2])
            self._variance += _DRIFT**2 * max(dt, 0.0) + _SLOPE**2 * float(way)
        self._before = own.time, own.p
        for look in looks:
            self._look(own, look)
        value = float(own.p[2]) - self._level
        return Height(value, math.sqrt(self._variance), self._level)

    def _look(self, own: VehicleState, look: DistanceSensor) -> None:
        """Correct the level by one look."""
        upright = float(rotation_matrix(own.q_wb)[2, 2])
        heard = look.minimum < look.distance < look.maximum and look.quality != _NO_ECHO
        if look.orientation != SensorRotation.DOWN or not heard or upright < _TILT_MIN:
            return
        z = float(own.p[2] + own.v[2] * (look.time - own.time))
        off = z - look.distance * upright - self._level
        noise = max(look.sigma, _SENSOR) ** 2
        if off * off > _GATE**2 * (self._variance + noise):
            self._refused += 1
            if self._refused < _INSIST:
                return
            self._variance = off * off
        self._refused = 0
        gain = self._variance / (self._variance + noise)
        self._level += gain * off
        self._variance *= 1.0 - gain
