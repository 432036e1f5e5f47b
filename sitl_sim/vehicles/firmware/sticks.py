"""RC channels of an emulated Betaflight: arming switch, linear rates, throttle, failsafe.

Channels in microseconds, in the order A E T R AUX1 … (roll, pitch, throttle, yaw, arm); rates
are linear (ACTUAL, expo 0), pitch stick up is nose down, yaw stick right turns right.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mavlink_bridge.wire.messages import RateSetpoint

ROLL, PITCH, THROTTLE, YAW, ARM = range(5)
STICKS = 5
ARM_RANGE = (1700.0, 2100.0)
THROTTLE_LOW = 1050.0
HALF_STICK = 500.0


class Sticks:
    """Setpoints and arming switch from the RC channels of one vehicle."""

    def __init__(self, rate_max_deg: float) -> None:
        self._rate_max = math.radians(rate_max_deg)
        self._was_off = False

    def setpoint(self, channels: Sequence[float]) -> RateSetpoint:
        """Return the body rates (FLU) and the throttle of these channels."""
        roll, pitch, yaw = (
            min(max((channels[k] - 1500.0) / HALF_STICK, -1.0), 1.0) for k in (ROLL, PITCH, YAW)
        )
        omega = self._rate_max * np.array([roll, pitch, -yaw])
        throttle = min(max((channels[THROTTLE] - 1000.0) / 1000.0, 0.0), 1.0)
        return RateSetpoint(0.0, omega, throttle)

    def wants_arm(self, channels: Sequence[float]) -> bool:
        """Return whether the switch is on, and was off before."""
        on = ARM_RANGE[0] <= channels[ARM] <= ARM_RANGE[1]
        self._was_off |= not on
        return on and self._was_off

    def may_arm(self, channels: Sequence[float]) -> bool:
        """Return whether the throttle is down."""
        return channels[THROTTLE] <= THROTTLE_LOW

    def failsafe(self) -> None:
        """Note a failsafe: the switch must go off before the vehicle arms again."""
        self._was_off = False
