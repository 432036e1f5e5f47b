"""Sensors of a board on the simulator's physics, with the noise of their data sheets.

A real autopilot tests its sensors: PX4 counts a hundred equal samples as a dead one, so sensors
without noise never let it arm. Sources: BMI088 (gyro 0.014 °/s/√Hz, accelerometer 0.175 mg/√Hz),
IST8310 (0.3 µT), MS5611 at its highest resolution (0.012 mbar), ZED-F9P with RTK (position 0.01 m,
velocity 0.05 m/s, both median values).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import HilGps, HilSensor
from sitl_sim.vehicles.rigid_body import State
from sitl_sim.worlds.geodesy import LocalFrame

IMU_PERIOD, GPS_PERIOD = 0.004, 0.1  # s
_FIELD = np.array([0.011, 0.210, -0.428])  # gauss, ENU: the Earth's, at the geodetic reference
_BANDWIDTH = 0.5 / IMU_PERIOD  # Hz
_GYRO = math.radians(0.014) * math.sqrt(_BANDWIDTH)  # rad/s
_FORCE = 0.175e-3 * GRAVITY * math.sqrt(_BANDWIDTH)  # m/s²
_UP = np.array([0.0, 0.0, 1.0])
_RANGE = 15.9 * GRAVITY  # m/s²; PX4 keeps HIL samples as those of a sensor of ±16 g, and wraps
_MAGNETIC = 0.003  # gauss
_PRESSURE = 0.012  # hPa
_MEDIAN = 1.1774  # of a horizontal error, in σ of each axis
_PLACE = np.array([0.01 / _MEDIAN, 0.01 / _MEDIAN, 0.015])  # m
_VELOCITY = 0.05 / _MEDIAN  # m/s
_ACCURACY = (0.02, 0.03)  # m, horizontal and vertical, as such a receiver states them
_SEA_LEVEL = 1013.25  # hPa


class HilSensors:
    """IMU, compass, barometer and satellite receiver of one vehicle.

    frame: the vehicle's own, in which its receiver and compass agree. The noise depends on `seed`
    alone.
    """

    def __init__(self, frame: LocalFrame, seed: tuple[int, ...]) -> None:
        self._frame = frame
        self._rng = np.random.default_rng(seed)
        self._before: tuple[float, NDArray[np.float64]] | None = None  # time, velocity (3,)

    def imu(self, time: float, i: int, state: State) -> HilSensor:
        """Return what IMU, compass and barometer of vehicle i measure; time: s, its clock."""
        noise = self._rng.standard_normal(10)
        field = rotation_matrix(self._frame.attitude(state.q[i])).T @ _FIELD
        _, _, altitude = self._frame.to_geo(state.p[i])
        pressure = _SEA_LEVEL * (1.0 - 2.25577e-5 * altitude) ** 5.25588 + _PRESSURE * noise[9]
        return HilSensor(
            time,
            self._force(time, i, state) + _FORCE * noise[0:3],
            state.omega[i] + _GYRO * noise[3:6],
            field + _MAGNETIC * noise[6:9],
            float(pressure),
            altitude,
        )

    def _force(self, time: float, i: int, state: State) -> NDArray[np.float64]:
        """Return the mean specific force since the last sample (3,) m/s², body, in the range.

        An accelerometer integrates: a touchdown between two samples must not be missed, or the
        autopilot's estimate would go on falling.
        """
        before, self._before = self._before, (time, state.v[i].copy())
        if before is None or time <= before[0]:
            force: NDArray[np.float64] = state.specific_force[i]
        else:
            change = (state.v[i] - before[1]) / (time - before[0])
            force = rotation_matrix(state.q[i]).T @ (change + _UP * GRAVITY)
        return np.clip(force, -_RANGE, _RANGE)

    def gps(self, time: float, i: int, state: State) -> HilGps:
        """Return the fix of vehicle i; time: s, its clock."""
        error = self._rng.standard_normal(6)
        place: NDArray[np.float64] = state.p[i] + _PLACE * error[:3]
        velocity = self._frame.vector(state.v[i]) + _VELOCITY * error[3:]
        return HilGps(time, *self._frame.to_geo(place), velocity, *_ACCURACY)
