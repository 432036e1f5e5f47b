"""Vehicle state from coarse telemetry: stepped angles, a slow GPS without timestamps, a barometer.

Attitude: the filter integrates the gyro (or, without one, the slope of the angles) and corrects
by the part of the error that exceeds the step of the angles. Position: it integrates the
accelerometer (or a constant velocity) and corrects towards each new GPS and barometer value,
compared with the state at the time of the measurement.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import (
    conjugate,
    multiply,
    quaternion_from_euler,
    rotate,
    rotation_matrix,
    rotation_vector,
)
from mavlink_bridge.wire.messages import VehicleState

_EARTH = 6371008.8  # m, mean radius: a flat map around the start is enough
_HISTORY = 50
_LONGEST_STEP = 0.2  # s of prediction without telemetry
_JUMP = 1.0  # m; Betaflight zeroes its height at arming, on a busy machine seconds later
_SCALE_GAIN = 0.05  # of a new sample in the accelerometer's scale, learnt at rest


@dataclass(frozen=True)
class CoarseGains:
    """Correction per sample, steps of the angles [rad], age of values without timestamp [s]."""

    tilt: float = 0.25
    heading: float = 0.2
    tilt_step: float = math.radians(0.1)
    heading_step: float = math.radians(1.0)
    rate: float = 0.35  # without a gyro: of the slope between successive angles
    position: float = 0.35
    velocity: float = 0.4
    slope: float = 1.0  # 1/s, per error of a position that comes without velocity
    height: float = 0.03
    climb: float = 0.02  # 1/s, per height error
    gps_age: float = 0.06
    baro_age: float = 0.12


class CoarseState:
    """The filter: times in seconds of one clock, world ENU from the first GPS fix, body FLU."""

    def __init__(
        self,
        gains: CoarseGains | None = None,
        silent: float = 0.5,
        unfixed: float = 1.5,
        jumps: bool = True,
    ) -> None:
        """Start without a state.

        silent, unfixed: s without telemetry or without a fix after which no state is given.
        jumps: a height step above one metre is a new zero of the barometer, not a climb.
        """
        self._jumps = jumps
        self._silent, self._unfixed = silent, unfixed
        self._fixed_at = -math.inf
        self._g = gains or CoarseGains()
        self._time: float | None = None
        self._q: Vector | None = None
        self._omega = np.zeros(3)
        self._p = np.zeros(3)
        self._v = np.zeros(3)
        self._acceleration = np.zeros(3)
        self._force_scale = 0.0
        self._origin: tuple[float, float] | None = None
        self._ground: float | None = None
        self._past: deque[tuple[float, Vector, Vector]] = deque(maxlen=_HISTORY)

    def at(self, time: float, need_fix: bool = True) -> VehicleState | None:
        """Return the state at `time` [s]; None before attitude and height, or after their loss.

        need_fix: False: also without a fix; position and horizontal velocity are guesses then.
        """
        if self._q is None or self._ground is None or self._time is None:
            return None
        if time - self._time > self._silent or (need_fix and time - self._fixed_at > self._unfixed):
            return None
        dt = min(max(time - self._time, 0.0), _LONGEST_STEP)
        q = rotate(self._q, self._omega * dt)
        return VehicleState(time, self._p + self._v * dt, self._v.copy(), q, self._omega.copy())

    def advance(self, time: float) -> None:
        """Predict the state at `time` [s], before the measurements of that time are given."""
        if self._time is not None and self._q is not None:
            dt = min(max(time - self._time, 0.0), _LONGEST_STEP)
            self._q = rotate(self._q, self._omega * dt)
            self._p += self._v * dt + 0.5 * self._acceleration * dt * dt
            self._v += self._acceleration * dt
            self._past.append((time, self._p.copy(), self._v.copy()))
        self._time = time

    def angles(self, roll: float, pitch: float, yaw: float, dt: float = 0.0) -> None:
        """Correct by measured angles [rad], FLU and ENU.

        dt: s since the last angles, to derive body rates where there is no gyro; else 0.
        """
        measured = quaternion_from_euler(roll, pitch, yaw)
        if self._q is None:
            self._q = measured
            return
        error = rotation_vector(multiply(conjugate(self._q), measured))
        g = self._g
        over = np.array(
            [
                _beyond(error[0], g.tilt_step / 2),
                _beyond(error[1], g.tilt_step / 2),
                _beyond(error[2], g.heading_step / 2),
            ]
        )
        if dt > 0.0:
            self._omega = self._omega + g.rate * over / dt
        self._q = rotate(self._q, over * np.array([g.tilt, g.tilt, g.heading]))

    def gyro(self, omega: Vector) -> None:
        """Take measured body rates (3,) rad/s, FLU."""
        self._omega = omega

    def force(self, force: Vector, resting: bool) -> None:
        """Take a specific force (3,) FLU in any unit; its scale is learnt at rest."""
        size = float(np.linalg.norm(force))
        if resting and size > 0.0:
            scale = GRAVITY / size
            old = self._force_scale or scale
            self._force_scale = old + _SCALE_GAIN * (scale - old)
        if resting or not self._force_scale or self._q is None:
            self._acceleration = np.zeros(3)
            return
        world = rotation_matrix(self._q) @ (force * self._force_scale)
        self._acceleration = world - np.array([0.0, 0.0, GRAVITY])

    def gps(
        self,
        latitude_deg: float,
        longitude_deg: float,
        v: Vector | None,
        age: float | None = None,
    ) -> None:
        """Correct by a new fix.

        v: m/s ENU, (2,), (3,) or None where the receiver gives none. age: s, where it is known.
        """
        lost = self._time is None or self._time - self._fixed_at > self._unfixed
        self.confirm_fix()
        if self._origin is None:
            self._origin = (latitude_deg, longitude_deg)
        lat0, lon0 = self._origin
        east = math.radians(longitude_deg - lon0) * _EARTH * math.cos(math.radians(lat0))
        north = math.radians(latitude_deg - lat0) * _EARTH
        if lost:  # the state since the last fix is a guess
            self._p[:2] = east, north
            self._v[:2] = 0.0 if v is None else v[:2]
            self._past.clear()
            return
        p, v_then = self._then(self._g.gps_age if age is None else age)
        error = np.array([east, north]) - p[:2]
        self._p[:2] += self._g.position * error
        if v is None:
            self._v[:2] += self._g.slope * error
            return
        k = len(v)
        self._v[:k] += self._g.velocity * (v - v_then[:k])

    def confirm_fix(self) -> None:
        """Confirm that the last fix is still valid."""
        if self._time is not None:
            self._fixed_at = self._time

    def height(self, height: float, resting: bool) -> None:
        """Correct by a barometric height [m] above any zero; the height at rest is the ground."""
        if resting or self._ground is None:
            self._ground = height
            self._p[2] = self._v[2] = 0.0
            return
        p, _ = self._then(self._g.baro_age)
        error = height - self._ground - p[2]
        if self._jumps and abs(error) > _JUMP:
            self._ground += error
            return
        self._p[2] += self._g.height * error
        self._v[2] += self._g.climb * error

    def _then(self, age: float) -> tuple[Vector, Vector]:
        """Return the position and velocity of the filter `age` seconds ago."""
        if self._time is not None:
            for time, p, v in reversed(self._past):
                if time <= self._time - age:
                    return p, v
        return self._p, self._v


def _beyond(error: float, band: float) -> float:
    """Return the part of an error outside ±band; a stepped value does not resolve the rest."""
    return math.copysign(max(abs(error) - band, 0.0), error)
