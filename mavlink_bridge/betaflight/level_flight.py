"""Hold, take-off and landing of a bridged Betaflight: sticks in ANGLE mode, throttle by climb rate.

Where the companion does not fly: the controller keeps the frame level by itself, the bridge
leans it gently against the drift and sees to the height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import euler_from_quaternion
from mavlink_bridge.shared.thrust import G, ThrustMap
from mavlink_bridge.wire.messages import VehicleState

_POSITION_GAIN, _VELOCITY_GAIN = 0.7, 1.6  # 1/s
_SPEED_MAX, _LEAN_MAX = 1.5, math.radians(15.0)
_CLIMB_GAIN, _HEIGHT_GAIN, _INTEGRAL_GAIN = 3.0, 1.0, 1.2  # 1/s, 1/s, 1/s²
_INTEGRAL_MAX = 4.0  # m/s²
_CLIMB_MAX, _SINK_MAX = 1.0, 0.7  # m/s
_C_MIN, _C_MAX = 0.5 * G, 1.5 * G  # enough to stay upright by, however late the telemetry
_STUCK = 1.2  # s
_SLOW_BELOW, _SINK_SLOW = 1.0, 0.35  # m, m/s


@dataclass(frozen=True)
class Lean:
    """Lean to the right and nose down [rad], and thrust 0…1."""

    right: float
    forward: float
    thrust: float


class LevelFlight:
    """The loop; one call per cycle."""

    def __init__(self, thrust: ThrustMap) -> None:
        self._thrust = thrust
        self._place: Vector | None = None
        self._height: float | None = None
        self._integral = 0.0
        self._stuck = 0.0  # s without sinking

    def stay(self, height: float | None = None) -> None:
        """From now on stay: where the next steps find it, at `height` [m] or the one found."""
        self._integral = self._stuck = 0.0
        self._place, self._height = None, height

    def reached(self, state: VehicleState) -> bool:
        """Whether the height is reached."""
        return self._height is not None and float(state.p[2]) > self._height - 0.2

    @property
    def grounded(self) -> bool:
        """Whether sinking was asked for and nothing gave way for long."""
        return self._stuck > _STUCK

    def step(
        self, state: VehicleState | None, dt: float, sink: bool = False, placed: bool = True
    ) -> Lean:
        """Sticks now; without a state: level and at hover thrust.

        placed: whether its place is known; where not, level, and only its height is seen to.
        """
        if state is None:
            return Lean(0.0, 0.0, self._thrust.hover_thrust)
        lift = self._lift(state, dt, sink)
        if not placed:
            self._place = None  # once it is known again it stays there, wherever it drifted
            return Lean(0.0, 0.0, lift)
        if self._place is None:
            self._place = state.p.copy()
        wanted = _POSITION_GAIN * (self._place[:2] - state.p[:2])
        wanted *= min(1.0, _SPEED_MAX / max(float(np.linalg.norm(wanted)), 1e-6))
        east, north = _VELOCITY_GAIN * (wanted - state.v[:2]) / G
        _, _, yaw = euler_from_quaternion(state.q_wb)
        forward = math.cos(yaw) * east + math.sin(yaw) * north
        left = math.cos(yaw) * north - math.sin(yaw) * east
        return Lean(_lean(-left), _lean(forward), lift)

    def _lift(self, state: VehicleState, dt: float, sink: bool) -> float:
        height = float(state.p[2])
        if self._height is None:
            self._height = height
        if sink:
            climb = -(_SINK_SLOW if height < _SLOW_BELOW else _SINK_MAX)
        else:
            climb = _HEIGHT_GAIN * (self._height - height)
            climb = min(max(climb, -_SINK_MAX), _CLIMB_MAX)
        error = climb - float(state.v[2])
        self._stuck = self._stuck + dt if sink and error < 0.5 * climb else 0.0
        self._integral += _INTEGRAL_GAIN * error * dt
        self._integral = min(max(self._integral, -_INTEGRAL_MAX), _INTEGRAL_MAX)
        c = G + _CLIMB_GAIN * error + self._integral
        return self._thrust.to_thrust(min(max(c, _C_MIN), _C_MAX))


def _lean(angle: float) -> float:
    return min(max(angle, -_LEAN_MAX), _LEAN_MAX)
