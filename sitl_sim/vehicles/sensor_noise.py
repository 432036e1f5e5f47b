"""Standard deviations of the fast errors of a state estimate."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of the estimate's errors, small but real.

    Drifts change with the time constant that follows each. The gyro has white noise and a constant
    bias, drawn once. There is no accelerometer: velocity has a drift of its own.
    """

    position: float = 0.02  # m
    position_time: float = 2.0  # s
    velocity: float = 0.03  # m/s
    velocity_time: float = 0.5  # s
    attitude: float = math.radians(0.3)  # rad
    attitude_time: float = 5.0  # s
    gyro: float = 0.01  # rad/s
    gyro_bias: float = 0.002  # rad/s
    lag: float = 0.01  # s, of position and velocity

    @staticmethod
    def none() -> SensorNoise:
        """Return the noise of a perfect estimate: none."""
        return SensorNoise(0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0)
