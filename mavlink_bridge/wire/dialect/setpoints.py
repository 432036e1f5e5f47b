"""Setpoints and commands to a vehicle, to and from MAVLink: `messages.setpoints`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mavlink_bridge.shared.frames import flu_frd, quaternion_enu_ned
from mavlink_bridge.wire import messages as m
from mavlink_bridge.wire.dialect import common as mavlink
from mavlink_bridge.wire.dialect.axes import frd, vector
from mavlink_bridge.wire.dialect.layout import NUMBERS, message
from mavlink_bridge.wire.dialect.units import milliseconds

_IDENTITY = (1.0, 0.0, 0.0, 0.0)
_GLOBAL_FRAMES = (  # x and y of COMMAND_INT are degrees · 1e7; elsewhere metres · 1e4
    mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_INT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
)


def _rate_setpoint_to_wire(s: m.RateSetpoint) -> Any:
    roll_rate, pitch_rate, yaw_rate = frd(s.omega)
    return message("SET_ATTITUDE_TARGET")(
        time_boot_ms=milliseconds(s.time),
        target_system=s.target_system,
        target_component=s.target_component,
        type_mask=s.type_mask,
        q=_IDENTITY if s.q_wb is None else quaternion_enu_ned(s.q_wb),
        body_roll_rate=roll_rate,
        body_pitch_rate=pitch_rate,
        body_yaw_rate=yaw_rate,
        thrust=s.thrust,
    )


def _rate_setpoint_from_wire(w: Any) -> m.RateSetpoint:
    return m.RateSetpoint(
        w.time_boot_ms / 1e3,
        vector(*flu_frd(w.body_roll_rate, w.body_pitch_rate, w.body_yaw_rate)),
        w.thrust,
        w.target_system,
        w.target_component,
        w.type_mask,
        np.array(quaternion_enu_ned(w.q)),
    )


def _command_long_from_wire(w: Any) -> m.Command:
    params = (w.param1, w.param2, w.param3, w.param4, w.param5, w.param6, w.param7)
    return m.Command(w.command, params, w.target_system, w.target_component, w.confirmation)


def _command_int_from_wire(w: Any) -> m.Command:
    scale = 1e7 if w.frame in _GLOBAL_FRAMES else 1e4
    params = (w.param1, w.param2, w.param3, w.param4, w.x / scale, w.y / scale, w.z)
    return m.Command(w.command, params, w.target_system, w.target_component, frame=w.frame)


def _data_stream_from_wire(w: Any) -> m.RequestDataStream:
    return m.RequestDataStream(
        w.target_system,
        w.target_component,
        w.req_stream_id,
        w.req_message_rate,
        bool(w.start_stop),
    )


TO_WIRE: dict[type, Callable[[Any], Any]] = {
    m.RateSetpoint: _rate_setpoint_to_wire,
    m.Command: lambda c: message("COMMAND_LONG")(
        c.target_system, c.target_component, c.command, c.confirmation, *c.params
    ),
    m.CommandAck: lambda a: message("COMMAND_ACK")(
        a.command, a.result, 0, 0, a.target_system, a.target_component
    ),
    m.SetMode: lambda s: message("SET_MODE")(s.target_system, s.base_mode, s.custom_mode),
    m.RequestDataStream: lambda r: message("REQUEST_DATA_STREAM")(
        r.target_system, r.target_component, r.stream, round(r.rate_hz), int(r.start)
    ),
}

FROM_WIRE: dict[int, Callable[[Any], m.Message]] = {
    NUMBERS["SET_ATTITUDE_TARGET"]: _rate_setpoint_from_wire,
    NUMBERS["COMMAND_LONG"]: _command_long_from_wire,
    NUMBERS["COMMAND_INT"]: _command_int_from_wire,
    NUMBERS["COMMAND_ACK"]: lambda w: m.CommandAck(
        w.command, w.result, w.target_system, w.target_component
    ),
    NUMBERS["SET_MODE"]: lambda w: m.SetMode(w.target_system, w.base_mode, w.custom_mode),
    NUMBERS["REQUEST_DATA_STREAM"]: _data_stream_from_wire,
}
