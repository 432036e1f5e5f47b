"""Hold, take-off and landing of a bridged Betaflight: sticks in ANGLE mode, throttle by climb rate.

It flies while the companion sends no setpoints. The controller keeps the frame level by itself;
the bridge tilts it gently against the drift and controls the height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import euler_from_quaternion
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.messages import VehicleState

_POSITION_GAIN, _VELOCITY_GAIN = 0.7, 1.6  # 1/s
_SPEED_MAX, _TILT_MAX = 1.5, math.radians(15.0)
_CLIMB_GAIN, _HEIGHT_GAIN, _INTEGRAL_GAIN = 3.0, 1.0, 1.2  # 1/s, 1/s, 1/s²
_INTEGRAL_MAX = 4.0  # m/s²
_CLIMB_MAX, _SINK_MAX = 1.0, 0.7  # m/s
# enough to stay upright by, however late the telemetry
_C_MIN, _C_MAX = 0.5 * GRAVITY, 1.5 * GRAVITY
_LANDED_AFTER = 1.2  # s of a commanded descent without descending
_SLOW_BELOW, _SINK_SLOW = 1.0, 0.35  # m, m/s
_HEIGHT_TOLERANCE = 0.2  # m


@dataclass(frozen=True)
class AngleSetpoint:
    """Roll (right side down) and pitch (nose down) [rad, FLU], and normalised thrust 0…1."""

    roll: float
    pitch: float
    thrust: float


class PositionHold:
    """Position and height controller; one call of `step` per cycle."""

    def __init__(self, thrust: ThrustMap) -> None:
        self._thrust = thrust
        self._place: Vector | None = None
        self._height: float | None = None
        self._integral = 0.0
        self._not_descending = 0.0  # s

    def hold_here(self, height: float | None = None) -> None:
        """Hold the position of the next step, at `height` [m] or at the height of that step."""
        self._integral = self._not_descending = 0.0
        self._place, self._height = None, height

    def height_reached(self, state: VehicleState) -> bool:
        """Return whether the vehicle has climbed to the height to hold."""
        if self._height is None:
            return False
        return float(state.p[2]) > self._height - _HEIGHT_TOLERANCE

    @property
    def landed(self) -> bool:
        """Whether the vehicle has long not descended although it should."""
        return self._not_descending > _LANDED_AFTER

    def step(
        self,
        state: VehicleState | None,
        dt: float,
        descend: bool = False,
        position_known: bool = True,
    ) -> AngleSetpoint:
        """Return the setpoint of this cycle; without a state: level and at hover thrust.

        dt: s since the last step. descend: land. position_known: without it, level and height only.
        """
        if state is None:
            return AngleSetpoint(0.0, 0.0, self._thrust.hover_thrust)
        thrust = self._climb_thrust(state, dt, descend)
        if not position_known:
            self._place = None  # it may drift; once known again, the new position is held
            return AngleSetpoint(0.0, 0.0, thrust)
        if self._place is None:
            self._place = state.p.copy()
        wanted = _POSITION_GAIN * (self._place[:2] - state.p[:2])
        wanted *= min(1.0, _SPEED_MAX / max(float(np.linalg.norm(wanted)), 1e-6))
        east, north = _VELOCITY_GAIN * (wanted - state.v[:2]) / GRAVITY
        _, _, yaw = euler_from_quaternion(state.q_wb)
        forward = math.cos(yaw) * east + math.sin(yaw) * north
        left = math.cos(yaw) * north - math.sin(yaw) * east
        return AngleSetpoint(_limited(-left), _limited(forward), thrust)

    def _climb_thrust(self, state: VehicleState, dt: float, descend: bool) -> float:
        """Return the normalised thrust that controls the height or the descent."""
        height = float(state.p[2])
        if self._height is None:
            self._height = height
        if descend:
            climb = -(_SINK_SLOW if height < _SLOW_BELOW else _SINK_MAX)
        else:
            climb = _HEIGHT_GAIN * (self._height - height)
            climb = min(max(climb, -_SINK_MAX), _CLIMB_MAX)
        error = climb - float(state.v[2])
        stuck = descend and error < 0.5 * climb
        self._not_descending = self._not_descending + dt if stuck else 0.0
        self._integral += _INTEGRAL_GAIN * error * dt
        self._integral = min(max(self._integral, -_INTEGRAL_MAX), _INTEGRAL_MAX)
        c = GRAVITY + _CLIMB_GAIN * error + self._integral
        return self._thrust.to_thrust(min(max(c, _C_MIN), _C_MAX))


def _limited(angle: float) -> float:
    return min(max(angle, -_TILT_MAX), _TILT_MAX)
