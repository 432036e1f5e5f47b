"""Commands that brake and level: laws in closed form, without any solver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from companion.supervision.guard_config import GuardConfig
from mavlink_bridge.shared.arrays import Vector, finite, norm
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import integrate, rotation_matrix
from mavlink_bridge.wire.messages import RateCommand, VehicleState

_LATE_GAIN = 0.7  # of the error, per command: 1 would be dead-beat
_LATE_BRAKE = 0.25  # of the attitude's gain
_UNTIL_TURNED = 0.1  # s, from a command's effect until the frame has turned most of its way
_UNTIL_ACTING = 0.75  # share of the time between late commands before a command acts
_TURN_MAX = 0.5  # s; the body rates of the last command are assumed for no longer
_CALM: Vector = np.zeros(3)


def brake(own: VehicleState, config: GuardConfig, wind: Vector = _CALM) -> RateCommand:
    """Return the command that brakes: tilt against the velocity, thrust for the height.

    The wanted specific force is −gain·v + g e_z, bounded; v is the velocity when the frame can have
    turned, as its present tilt goes on accelerating it until then. wind: (3,) m/s², acceleration
    that is made up for: else a drone drifts with it.
    """
    tilted = GRAVITY * rotation_matrix(own.q_wb)[:, 2] + wind
    then = own.v + _UNTIL_TURNED * np.array([tilted[0], tilted[1], 0.0])
    force = _against(then, config.brake_gain, config.brake_gain, config)
    return _towards(force - wind, own, config)


def brake_late(own: VehicleState, config: GuardConfig, held: float) -> RateCommand:
    """Return the command that brakes, with gains low enough for a command held for `held` [s].

    The body rates of the last command go on turning the frame until this one acts. Where ticks
    are late, no wind is known to be made up for.
    """
    q_then = integrate(own.q_wb, own.omega, min(held, _TURN_MAX) * _UNTIL_ACTING)
    gain = min(_LATE_GAIN / held, config.attitude_gain)
    force = _against(own.v, min(_LATE_BRAKE * gain, config.brake_gain), gain, config)
    slower = config.model_copy(update={"attitude_gain": gain})
    return _towards(force, replace(own, q_wb=q_then), slower)


def _against(v: Vector, horizontal: float, vertical: float, config: GuardConfig) -> Vector:
    """Return the specific force (3,) [m/s²; world] that brakes v (3,) m/s by these gains [1/s]."""
    sideways = -horizontal * v[:2]
    size = float(np.hypot(*sideways))
    if size > config.brake_max:
        sideways = sideways * (config.brake_max / size)
    up = float(np.clip(-vertical * v[2], -3.0, 3.0))
    return np.array([sideways[0], sideways[1], GRAVITY + up])


def level(own: VehicleState, config: GuardConfig) -> RateCommand:
    """Return the command that levels the frame and carries the weight; only q_wb is used."""
    return _towards(np.array([0.0, 0.0, GRAVITY]), own, config)


def _towards(force: Vector, own: VehicleState, config: GuardConfig) -> RateCommand:
    """Return the command that turns the thrust towards a specific force (3,) [m/s²; world].

    The attitude error is the rotation between the body's z axis and the force; the thrust is the
    part of the force along that axis.
    """
    r = rotation_matrix(own.q_wb)
    wanted = r.T @ (force / norm(force))  # in the body frame
    error = np.cross([0.0, 0.0, 1.0], wanted)
    if wanted[2] < 0.0:  # more than 90° off: turn at full rate
        error = error / max(norm(error), 1e-6)
    omega = np.clip(config.attitude_gain * error, -config.omega_max, config.omega_max)
    c = float(np.clip(force @ r[:, 2], config.c_min, config.c_max))
    if not (finite(omega) and np.isfinite(c)):  # numbers too large to be squared
        return RateCommand(np.zeros(3), GRAVITY)
    return RateCommand(omega, c)
