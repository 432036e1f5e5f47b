"""Setpoints and commands to a vehicle, and its answers."""

from __future__ import annotations

from dataclasses import dataclass

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.wire.ids import AttitudeTargetMask, ComponentId


@dataclass(frozen=True)
class RateCommand:
    """The control input that the companion computes; `ThrustMap` turns `c` into thrust.

    omega: (3,) body rates [rad/s], body FLU. c: collective acceleration [m/s²] along +z_B.
    """

    omega: Vector
    c: float


@dataclass(frozen=True)
class RateSetpoint:
    """SET_ATTITUDE_TARGET; with the default type_mask the attitude in it is ignored.

    omega: (3,) body rates [rad/s], body FLU. thrust: normalised collective thrust 0…1. q_wb: (4,)
    attitude, body → world, as it was received; None: sent as no rotation in the wire's frames.
    """

    time: float
    omega: Vector
    thrust: float
    target_system: int = 0
    target_component: int = ComponentId.AUTOPILOT1
    type_mask: int = AttitudeTargetMask.ATTITUDE_IGNORE
    q_wb: Vector | None = None


@dataclass(frozen=True)
class Command:
    """COMMAND_LONG, or COMMAND_INT in its form: seven parameters, NaN where unused.

    frame: MAV_FRAME of a COMMAND_INT; None: it came as COMMAND_LONG. Commands go out as the latter.
    """

    command: int
    params: tuple[float, float, float, float, float, float, float]
    target_system: int = 0
    target_component: int = ComponentId.AUTOPILOT1
    confirmation: int = 0
    frame: int | None = None


@dataclass(frozen=True)
class CommandAck:
    """COMMAND_ACK; result: MAV_RESULT."""

    command: int
    result: int
    target_system: int = 0
    target_component: int = 0


@dataclass(frozen=True)
class SetMode:
    """SET_MODE, deprecated in MAVLink and still sent by ground stations."""

    target_system: int
    base_mode: int
    custom_mode: int


@dataclass(frozen=True)
class RequestDataStream:
    """REQUEST_DATA_STREAM, deprecated in MAVLink and still sent by MAVProxy."""

    target_system: int
    target_component: int
    stream: int
    rate_hz: float
    start: bool
