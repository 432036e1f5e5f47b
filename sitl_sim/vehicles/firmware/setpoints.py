"""What an autopilot makes of a SET_ATTITUDE_TARGET, whose mask may leave fields out.

PX4 (mavlink_receiver.cpp) takes any: what is not given or not finite is rate 0, or the thrust
before. ArduCopter (GCS_MAVLink_Copter.cpp) takes all three rates or none, and needs thrust.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mavlink_bridge.wire.ids import AttitudeTargetMask as Mask
from mavlink_bridge.wire.messages import RateSetpoint

_UNIT = 1e-3  # how far from 1 the length of ArduCopter's quaternion may be
_RATES = int(Mask.BODY_ROLL_RATE_IGNORE | Mask.BODY_PITCH_RATE_IGNORE | Mask.BODY_YAW_RATE_IGNORE)
_TILT_RATES = int(Mask.BODY_ROLL_RATE_IGNORE | Mask.BODY_PITCH_RATE_IGNORE)


def understood(m: RateSetpoint, before: RateSetpoint | None, strict: bool) -> RateSetpoint | None:
    """Return the setpoint to fly, finite; None where it gives nothing to fly.

    before: the one in force. strict: as ArduCopter. In the result q_wb is None where the body rates
    are to be flown, else the attitude, and omega what is added to its control.
    """
    if strict and (m.type_mask & Mask.THROTTLE_IGNORE or m.type_mask & _RATES not in (0, _RATES)):
        return None
    attitude = not m.type_mask & Mask.ATTITUDE_IGNORE
    if not attitude and m.type_mask & (_RATES if strict else _TILT_RATES):
        return None
    q = _attitude(m, strict) if attitude else None
    if attitude and q is None and strict:
        return None
    given = [not m.type_mask & bit for bit in (1, 2, 4)]
    omega = np.where(given & np.isfinite(m.omega), m.omega, 0.0)
    thrust_given = np.isfinite(m.thrust) and not m.type_mask & Mask.THROTTLE_IGNORE
    if strict and not thrust_given:
        return None
    thrust = m.thrust if thrust_given else (before.thrust if before else 0.0)
    if q is not None:
        omega[:2] = 0.0
    return replace(m, omega=omega, thrust=float(thrust), q_wb=q)


def _attitude(m: RateSetpoint, strict: bool) -> np.ndarray | None:
    """Return the attitude in a setpoint, of length 1; None where there is none to fly."""
    if m.q_wb is None:
        return None
    length = float(np.linalg.norm(m.q_wb))
    if not np.isfinite(length) or length < _UNIT or (strict and abs(length - 1.0) > _UNIT):
        return None
    unit: np.ndarray = m.q_wb / length
    return unit
