"""Betaflight's rate profile: body rate of a stick deflection, per axis, and the inverse.

Source: Betaflight fc/rc.c (applyBetaflightRates, applyActualRates) and MSP_RC_TUNING.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from mavlink_bridge.betaflight.msp import MspError

_BETAFLIGHT, _ACTUAL = 0, 3
_TYPES = {0: "BETAFLIGHT", 1: "RACEFLIGHT", 2: "KISS", 3: "ACTUAL", 4: "QUICK"}
_RATE_STEP_FROM, _RATE_STEP = 2.0, 14.54  # RC rate above 2.0 counts this much more
_ENOUGH = 1e-6


@dataclass(frozen=True)
class AxisRates:
    """Settings of one axis: kind of curve, rc_rate, srate and expo (0…255), limit [°/s]."""

    kind: int
    rc_rate: int
    rate: int
    expo: int
    limit: float

    def rate_of(self, stick: float) -> float:
        """Return the body rate [rad/s] of a deflection −1…1."""
        curve = _actual if self.kind == _ACTUAL else _betaflight
        degrees = math.copysign(curve(self, abs(stick)), stick)
        return math.radians(min(max(degrees, -self.limit), self.limit))

    def stick_for(self, rate: float) -> float:
        """Return the deflection −1…1 for a body rate [rad/s]; full beyond the range."""
        low, high, wanted = 0.0, 1.0, abs(rate)
        if self.rate_of(1.0) <= wanted:
            return math.copysign(1.0, rate)
        while high - low > _ENOUGH:  # the curve is monotone
            middle = (low + high) / 2
            low, high = (middle, high) if self.rate_of(middle) < wanted else (low, middle)
        return math.copysign((low + high) / 2, rate)


def _actual(a: AxisRates, stick: float) -> float:
    """Return the rate [°/s] of ACTUAL: rc_rate at the centre, srate at full stick, in 10 °/s."""
    expo = a.expo / 100
    curve = stick * (stick**5 * expo + stick * (1 - expo))
    centre = a.rc_rate * 10.0
    return stick * centre + max(a.rate * 10.0 - centre, 0.0) * curve


def _betaflight(a: AxisRates, stick: float) -> float:
    """Return the rate [°/s] of BETAFLIGHT: super rate over an expo curve."""
    expo, rc_rate = a.expo / 100, a.rc_rate / 100
    if rc_rate > _RATE_STEP_FROM:
        rc_rate += _RATE_STEP * (rc_rate - _RATE_STEP_FROM)
    bent = stick * (1 - expo) + stick**4 * expo if expo else stick
    rate = 200.0 * rc_rate * bent
    if a.rate:
        rate /= max(1.0 - stick * a.rate / 100, 0.01)
    return rate


@dataclass(frozen=True)
class RateProfile:
    """Rates of roll, pitch and yaw in the controller's active profile."""

    roll: AxisRates
    pitch: AxisRates
    yaw: AxisRates


def rate_profile(payload: bytes) -> RateProfile:
    """Read MSP_RC_TUNING.

    Raises:
        MspError: an MSP that is too old, or a kind of curve that is not implemented here.
    """
    if len(payload) < 23:
        raise MspError("MSP_RC_TUNING is too short: needs MSP API 1.43 (Betaflight 4.2) or newer")
    rc_roll, expo_roll, s_roll, s_pitch, s_yaw = struct.unpack_from("<5B", payload)
    expo_yaw, rc_yaw, rc_pitch, expo_pitch = struct.unpack_from("<4B", payload, 10)
    limits = struct.unpack_from("<3H", payload, 16)
    kind = payload[22]
    if kind not in (_BETAFLIGHT, _ACTUAL):
        name = _TYPES.get(kind, str(kind))
        raise MspError(f"rates_type {name} is not supported: set ACTUAL or BETAFLIGHT")
    return RateProfile(
        AxisRates(kind, rc_roll, s_roll, expo_roll, limits[0]),
        AxisRates(kind, rc_pitch, s_pitch, expo_pitch, limits[1]),
        AxisRates(kind, rc_yaw, s_yaw, expo_yaw, limits[2]),
    )
