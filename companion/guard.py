"""The last word before the wire: any input, NaN included, gives a finite, bounded command.

A usable plan passes, clipped to the bounds. A failed solve flies the shifted previous plan
for at most `shifted_max` ticks; after that, and whenever there is no plan, a closed-form law
brakes and hovers without any solver. Without a state: level rates and hover thrust.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from pydantic import Field

from companion.nmpc import Result
from companion.types import Vector
from mavlink_bridge.frames import rotation_matrix
from mavlink_bridge.messages import RateCommand, VehicleState
from mavlink_bridge.settings import StrictModel
from mavlink_bridge.thrust import G


class Reason(Enum):
    """Why a command is what it is."""

    PLAN = "plan"
    SHIFTED_PLAN = "shifted_plan"
    BRAKE = "brake"
    NO_STATE = "no_state"


class GuardConfig(StrictModel):
    """Bounds and thresholds."""

    omega_max: float = Field(3.0, gt=0, description="Each body rate [rad/s].")
    c_min: float = Field(2.0, ge=0, description="m/s².")
    c_max: float = Field(20.0, gt=9.81, description="m/s².")
    shifted_max: int = Field(2, ge=0, description="Ticks that a shifted plan may fly.")
    stale_brake: float = Field(0.3, gt=0, description="Telemetry older than this [s]: no state.")
    brake_gain: float = Field(2.0, gt=0, description="Deceleration per speed [1/s].")
    brake_max: float = Field(5.0, gt=0, description="Most horizontal deceleration [m/s²].")
    attitude_gain: float = Field(6.0, gt=0, description="Rate per attitude error [1/s].")


@dataclass(frozen=True)
class Verdict:
    """The command to send, why it is that one, and how many ticks in a row had no plan."""

    command: RateCommand
    reason: Reason
    bad_ticks: int


class Guard:
    """Total function with a memory of how many ticks in a row went without a plan."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._bad_ticks = 0

    def judge(self, result: Result | None, own: VehicleState | None, age: float) -> Verdict:
        """result: this tick's solve, if any; own: state now; age: of telemetry [s]."""
        if result is not None and result.usable and np.isfinite(result.u[0]).all():
            self._bad_ticks = 0
            return Verdict(self._bounded(result.u[0]), Reason.PLAN, 0)
        self._bad_ticks += 1
        if own is None or not _finite(own) or not age <= self._config.stale_brake:
            level = RateCommand(np.zeros(3), G)
            return Verdict(level, Reason.NO_STATE, self._bad_ticks)
        if (
            result is not None
            and self._bad_ticks <= self._config.shifted_max
            and np.isfinite(result.u[0]).all()
        ):
            return Verdict(self._bounded(result.u[0]), Reason.SHIFTED_PLAN, self._bad_ticks)
        return Verdict(brake(own, self._config), Reason.BRAKE, self._bad_ticks)

    def _bounded(self, u: Vector) -> RateCommand:
        c = self._config
        omega = np.clip(u[1:4], -c.omega_max, c.omega_max)
        return RateCommand(omega, float(np.clip(u[0], c.c_min, c.c_max)))


def brake(own: VehicleState, config: GuardConfig) -> RateCommand:
    """Decelerate and hover in closed form: tilt against the velocity, thrust for height.

    The wanted specific force is −gain·v + g e_z; the attitude error is the rotation between
    the body's z axis and it.
    """
    horizontal = -config.brake_gain * own.v[:2]
    size = float(np.hypot(*horizontal))
    if size > config.brake_max:
        horizontal = horizontal * (config.brake_max / size)
    vertical = float(np.clip(-config.brake_gain * own.v[2], -3.0, 3.0))
    force = np.array([horizontal[0], horizontal[1], G + vertical])
    r = rotation_matrix(own.q_wb)
    wanted = r.T @ (force / np.linalg.norm(force))  # in the body frame
    error = np.cross([0.0, 0.0, 1.0], wanted)
    if wanted[2] < 0.0:  # more than 90° off: turn at full rate
        error = error / max(float(np.linalg.norm(error)), 1e-6)
    omega = np.clip(config.attitude_gain * error, -config.omega_max, config.omega_max)
    c = float(np.clip(force @ r[:, 2], config.c_min, config.c_max))
    return RateCommand(omega, c)


def _finite(own: VehicleState) -> bool:
    return all(bool(np.isfinite(a).all()) for a in (own.p, own.v, own.q_wb, own.omega))
