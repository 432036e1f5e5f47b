"""Each message class of `messages` to and from its MAVLink 2 message (common dialect).

Two tables, one function per direction and message; units and frames change here and
nowhere else.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import (
    enu_ned,
    euler_from_quaternion,
    flu_frd,
    heading_from_yaw,
    quaternion_enu_ned,
    quaternion_from_euler,
    rotation_matrix,
    yaw_from_heading,
)
from mavlink_bridge.wire import messages as m

_NAN_Q = (math.nan,) * 4
_HIL_ALL = 0x1FFF  # fields of HIL_SENSOR: all
_OPEN = 2**31 - 1  # x and y of a mission item without a place
_NO_HORIZONTAL = mavlink.GPS_INPUT_IGNORE_FLAG_VEL_HORIZ
_NO_VERTICAL = mavlink.GPS_INPUT_IGNORE_FLAG_VEL_VERT
_NED_FRAMES = (mavlink.MAV_FRAME_LOCAL_NED,)
_BODY_FRAMES = (mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_FRD)


def _ms(time: float) -> int:
    return round(time * 1e3) & 0xFFFFFFFF


def _clip(value: float, low: int, high: int) -> int:
    return min(max(round(value), low), high) if math.isfinite(value) else low


def _course(degrees: float) -> int:
    """0 … 35999 centidegrees: what is rounded up to a full turn is north."""
    return round(degrees * 100) % 36000


def _text(raw: str | bytes) -> str:
    return raw.decode("utf-8", "replace") if isinstance(raw, bytes) else raw


def _array(x: float, y: float, z: float) -> Vector:
    return np.array((x, y, z), dtype=float)


# --- to the wire -------------------------------------------------------------------------


def _rate_setpoint(s: m.RateSetpoint) -> Any:
    p, q, r = flu_frd(*(float(a) for a in s.omega))
    return mavlink.MAVLink_set_attitude_target_message(
        _ms(s.time), s.target_system, s.target_component, s.type_mask, (1.0, 0.0, 0.0, 0.0),
        p, q, r, s.thrust,
    )  # fmt: skip


def _heartbeat(h: m.Heartbeat) -> Any:
    base = h.base_mode | (mavlink.MAV_MODE_FLAG_SAFETY_ARMED if h.armed else 0)
    return mavlink.MAVLink_heartbeat_message(
        h.vehicle_type, h.autopilot, base, h.custom_mode, h.system_status, 3
    )


def _attitude(a: m.Attitude) -> Any:
    q = quaternion_enu_ned(a.q_wb)
    return mavlink.MAVLink_attitude_quaternion_message(
        _ms(a.time), *q, *flu_frd(*(float(w) for w in a.omega))
    )


def _euler_attitude(a: m.EulerAttitude) -> Any:
    angles = euler_from_quaternion(quaternion_enu_ned(a.q_wb))
    return mavlink.MAVLink_attitude_message(
        _ms(a.time), *angles, *flu_frd(*(float(w) for w in a.omega))
    )


def _local_position(lp: m.LocalPosition) -> Any:
    return mavlink.MAVLink_local_position_ned_message(
        _ms(lp.time), *enu_ned(*(float(a) for a in lp.p)), *enu_ned(*(float(a) for a in lp.v))
    )


def _odometry(o: m.Odometry) -> Any:
    v = rotation_matrix(o.q_wb).T @ o.v
    return mavlink.MAVLink_odometry_message(
        round(o.time * 1e6), mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_FRD,
        *enu_ned(*(float(a) for a in o.p)), quaternion_enu_ned(o.q_wb),
        *flu_frd(*(float(a) for a in v)), *flu_frd(*(float(w) for w in o.omega)),
        [math.nan] * 21, [math.nan] * 21,
    )  # fmt: skip


def _global_position(g: m.GlobalPosition) -> Any:
    vx, vy, vz = enu_ned(*(float(a) for a in g.v))
    heading = 0xFFFF if g.heading is None else _course(math.degrees(g.heading))
    return mavlink.MAVLink_global_position_int_message(
        _ms(g.time), round(g.latitude_deg * 1e7), round(g.longitude_deg * 1e7),
        round(g.altitude * 1e3), round(g.relative_altitude * 1e3),
        _clip(vx * 100, -32768, 32767), _clip(vy * 100, -32768, 32767),
        _clip(vz * 100, -32768, 32767), heading,
    )  # fmt: skip


def _system_status(s: m.SystemStatus) -> Any:
    return mavlink.MAVLink_sys_status_message(
        s.present, s.enabled, s.health, _clip(s.load * 1000, 0, 1000),
        _clip(s.voltage * 1e3, 0, 65535), _clip(s.current * 100, -1, 32767),
        _clip(s.remaining * 100, -1, 100), 0, 0, 0, 0, 0, 0,
    )  # fmt: skip


def _battery(b: m.BatteryStatus) -> Any:
    cells = [_clip(b.voltage * 1e3, 0, 65534)] + [0xFFFF] * 9
    return mavlink.MAVLink_battery_status_message(
        0, 0, 3, 0x7FFF, cells, _clip(b.current * 100, -1, 32767), -1, -1,
        _clip(b.remaining * 100, -1, 100),
    )  # fmt: skip


def _home(h: m.HomePosition) -> Any:
    return mavlink.MAVLink_home_position_message(
        round(h.latitude_deg * 1e7), round(h.longitude_deg * 1e7), round(h.altitude * 1e3),
        *enu_ned(*(float(a) for a in h.p)), _NAN_Q, math.nan, math.nan, math.nan,
    )  # fmt: skip


def _gps(g: m.GpsRaw) -> Any:
    return mavlink.MAVLink_gps_raw_int_message(
        round(g.time * 1e6), g.fix_type, round(g.latitude_deg * 1e7),
        round(g.longitude_deg * 1e7), round(g.altitude * 1e3), 80, 120,
        _clip(g.speed * 100, 0, 65535), _course(math.degrees(heading_from_yaw(g.course))),
        g.satellites,
    )  # fmt: skip


def _gps_input(g: m.GpsInput) -> Any:
    given = [] if g.v is None else [float(a) for a in g.v]
    flags = (0 if len(given) > 1 else _NO_HORIZONTAL) | (0 if len(given) > 2 else _NO_VERTICAL)
    east, north, up = (*given, 0.0, 0.0, 0.0)[:3]
    return mavlink.MAVLink_gps_input_message(
        round(g.time * 1e6), 0, flags, 0, 0, g.fix_type, round(g.latitude_deg * 1e7),
        round(g.longitude_deg * 1e7), g.altitude, 0.8, 1.2, *enu_ned(east, north, up),
        0.1, 0.5, 0.8, g.satellites,
    )  # fmt: skip


def _gps_velocity(w: Any) -> Vector | None:
    """Of GPS_INPUT, as far as it says that it gives it."""
    if w.ignore_flags & _NO_HORIZONTAL:
        return None
    v = _array(*enu_ned(w.vn, w.ve, w.vd))
    return v[:2] if w.ignore_flags & _NO_VERTICAL else v


def _hil_sensor(s: m.HilSensor) -> Any:
    body = [flu_frd(*(float(a) for a in v)) for v in (s.force, s.omega, s.magnetic)]
    return mavlink.MAVLink_hil_sensor_message(
        round(s.time * 1e6), *body[0], *body[1], *body[2], s.pressure, 0.0, s.altitude, 25.0,
        _HIL_ALL,
    )  # fmt: skip


def _hil_gps(g: m.HilGps) -> Any:
    v = [_clip(a * 100, -32768, 32767) for a in enu_ned(*(float(a) for a in g.v))]
    speed, course = math.hypot(v[0], v[1]), math.degrees(math.atan2(v[1], v[0]))
    return mavlink.MAVLink_hil_gps_message(
        round(g.time * 1e6), 3, round(g.latitude_deg * 1e7), round(g.longitude_deg * 1e7),
        round(g.altitude * 1e3), 30, 40, round(speed), *v, _course(course), 12,
    )  # fmt: skip


def _estimator(e: m.EstimatorStatus) -> Any:
    return mavlink.MAVLink_estimator_status_message(
        round(e.time * 1e6), e.flags, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1,
        e.horizontal_accuracy, e.vertical_accuracy,
    )  # fmt: skip


def _autopilot_version(v: m.AutopilotVersion) -> Any:
    zeros = [0] * 8
    return mavlink.MAVLink_autopilot_version_message(
        v.capabilities, v.flight_sw_version, 0, 0, 0, zeros, zeros, zeros, 0, 0, v.uid
    )


def _statustext(s: m.StatusText) -> Any:
    return mavlink.MAVLink_statustext_message(s.severity, s.text.encode()[:50])


def _param_value(p: m.ParamValue) -> Any:
    return mavlink.MAVLink_param_value_message(
        p.name.encode(), p.value, p.param_type, p.count, p.index
    )


def _place(degrees: float) -> int:
    """1e-7 deg in an int32; what is left open is its largest value, as MAVLink has it."""
    return _clip(degrees * 1e7, -(2**31), _OPEN) if math.isfinite(degrees) else _OPEN


def _mission_item(i: m.MissionItem) -> Any:
    return mavlink.MAVLink_mission_item_int_message(
        i.target_system, i.target_component, i.seq, i.frame, i.command, i.current,
        i.autocontinue, *i.params, _place(i.x_deg), _place(i.y_deg), i.z, i.mission_type,
    )  # fmt: skip


TO_WIRE: dict[type, Callable[[Any], Any]] = {
    m.RateSetpoint: _rate_setpoint,
    m.Heartbeat: _heartbeat,
    m.Attitude: _attitude,
    m.EulerAttitude: _euler_attitude,
    m.LocalPosition: _local_position,
    m.Odometry: _odometry,
    m.GlobalPosition: _global_position,
    m.SystemStatus: _system_status,
    m.BatteryStatus: _battery,
    m.HomePosition: _home,
    m.GpsRaw: _gps,
    m.GpsInput: _gps_input,
    m.EstimatorStatus: _estimator,
    m.HilSensor: _hil_sensor,
    m.HilGps: _hil_gps,
    m.AutopilotVersion: _autopilot_version,
    m.StatusText: _statustext,
    m.ParamValue: _param_value,
    m.MissionItem: _mission_item,
    m.Command: lambda c: mavlink.MAVLink_command_long_message(
        c.target_system, c.target_component, c.command, c.confirmation, *c.params
    ),
    m.CommandAck: lambda a: mavlink.MAVLink_command_ack_message(
        a.command, a.result, 0, 0, a.target_system, a.target_component
    ),
    m.SetMode: lambda s: mavlink.MAVLink_set_mode_message(
        s.target_system, s.base_mode, s.custom_mode
    ),
    m.ExtendedSystemState: lambda e: mavlink.MAVLink_extended_sys_state_message(0, e.landed_state),
    m.TimeSync: lambda t: mavlink.MAVLink_timesync_message(t.tc1, t.ts1),
    m.SystemTime: lambda t: mavlink.MAVLink_system_time_message(
        round(t.unix_time * 1e6), _ms(t.time)
    ),
    m.ParamRequestRead: lambda p: mavlink.MAVLink_param_request_read_message(
        p.target_system, p.target_component, p.name.encode(), p.index
    ),
    m.ParamRequestList: lambda p: mavlink.MAVLink_param_request_list_message(
        p.target_system, p.target_component
    ),
    m.ParamSet: lambda p: mavlink.MAVLink_param_set_message(
        p.target_system, p.target_component, p.name.encode(), p.value, p.param_type
    ),
    m.MissionCount: lambda c: mavlink.MAVLink_mission_count_message(
        c.target_system, c.target_component, c.count, c.mission_type
    ),
    m.MissionRequestList: lambda r: mavlink.MAVLink_mission_request_list_message(
        r.target_system, r.target_component, r.mission_type
    ),
    m.MissionRequest: lambda r: mavlink.MAVLink_mission_request_int_message(
        r.target_system, r.target_component, r.seq, r.mission_type
    ),
    m.MissionAck: lambda a: mavlink.MAVLink_mission_ack_message(
        a.target_system, a.target_component, a.result, a.mission_type
    ),
    m.MissionSetCurrent: lambda s: mavlink.MAVLink_mission_set_current_message(
        s.target_system, s.target_component, s.seq
    ),
    m.MissionClearAll: lambda c: mavlink.MAVLink_mission_clear_all_message(
        c.target_system, c.target_component, c.mission_type
    ),
    m.MissionCurrent: lambda c: mavlink.MAVLink_mission_current_message(c.seq),
    m.MissionItemReached: lambda r: mavlink.MAVLink_mission_item_reached_message(r.seq),
    m.RequestDataStream: lambda r: mavlink.MAVLink_request_data_stream_message(
        r.target_system, r.target_component, r.stream, round(r.rate_hz), int(r.start)
    ),
    m.FileTransfer: lambda f: mavlink.MAVLink_file_transfer_protocol_message(
        0, f.target_system, f.target_component, f.payload.ljust(251, b"\0")
    ),
}


# --- from the wire -----------------------------------------------------------------------


def _from_attitude_euler(w: Any) -> m.EulerAttitude:
    q = quaternion_enu_ned(quaternion_from_euler(w.roll, w.pitch, w.yaw))
    rates = flu_frd(w.rollspeed, w.pitchspeed, w.yawspeed)
    return m.EulerAttitude(w.time_boot_ms / 1e3, np.array(q), _array(*rates))


def _from_odometry(w: Any) -> m.Odometry:
    """Velocity comes along the body's axes, or the world's."""
    q = np.array(quaternion_enu_ned(w.q))
    known = w.frame_id in _NED_FRAMES and w.child_frame_id in (*_NED_FRAMES, *_BODY_FRAMES)
    p = _array(*enu_ned(w.x, w.y, w.z)) if known else np.full(3, math.nan)
    if w.child_frame_id in _BODY_FRAMES:
        v = rotation_matrix(q) @ _array(*flu_frd(w.vx, w.vy, w.vz))
    else:
        v = _array(*enu_ned(w.vx, w.vy, w.vz))
    omega = _array(*flu_frd(w.rollspeed, w.pitchspeed, w.yawspeed))
    return m.Odometry(w.time_usec / 1e6, p, v, q, omega)


def _from_global_position(w: Any) -> m.GlobalPosition:
    heading = None if w.hdg == 0xFFFF else math.radians(w.hdg / 100)
    v = enu_ned(w.vx / 100, w.vy / 100, w.vz / 100)
    return m.GlobalPosition(
        w.time_boot_ms / 1e3, w.lat / 1e7, w.lon / 1e7, w.alt / 1e3, w.relative_alt / 1e3,
        _array(*v), heading,
    )  # fmt: skip


def _from_command_int(w: Any) -> m.Command:
    scale = 1e7 if w.frame in (0, 3, 5, 6, 10, 11) else 1e4
    params = (w.param1, w.param2, w.param3, w.param4, w.x / scale, w.y / scale, w.z)
    return m.Command(w.command, params, w.target_system, w.target_component)


def _from_heartbeat(w: Any) -> m.Heartbeat:
    armed = bool(w.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
    return m.Heartbeat(w.autopilot, w.type, armed, w.custom_mode, w.system_status, w.base_mode)


def _from_mission_item(w: Any) -> m.MissionItem:
    params = (w.param1, w.param2, w.param3, w.param4)
    x, y = w.x, w.y
    if w.get_type() == "MISSION_ITEM_INT":
        x, y = (math.nan if k == _OPEN else k / 1e7 for k in (w.x, w.y))
    return m.MissionItem(
        w.target_system, w.target_component, w.seq, w.frame, w.command, w.current,
        w.autocontinue, params, x, y, w.z, w.mission_type,
    )  # fmt: skip


def _from_system_status(w: Any) -> m.SystemStatus:
    return m.SystemStatus(
        w.onboard_control_sensors_present, w.onboard_control_sensors_enabled,
        w.onboard_control_sensors_health, w.voltage_battery / 1e3, w.current_battery / 100,
        w.battery_remaining / 100, w.load / 1000,
    )  # fmt: skip


FROM_WIRE: dict[int, Callable[[Any], m.Message]] = {
    mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET: lambda w: m.RateSetpoint(
        w.time_boot_ms / 1e3,
        _array(*flu_frd(w.body_roll_rate, w.body_pitch_rate, w.body_yaw_rate)),
        w.thrust, w.target_system, w.target_component, w.type_mask,
    ),
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: _from_heartbeat,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: lambda w: m.Attitude(
        w.time_boot_ms / 1e3,
        np.array(quaternion_enu_ned((w.q1, w.q2, w.q3, w.q4))),
        _array(*flu_frd(w.rollspeed, w.pitchspeed, w.yawspeed)),
    ),
    mavlink.MAVLINK_MSG_ID_ATTITUDE: _from_attitude_euler,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: lambda w: m.LocalPosition(
        w.time_boot_ms / 1e3, _array(*enu_ned(w.x, w.y, w.z)), _array(*enu_ned(w.vx, w.vy, w.vz))
    ),
    mavlink.MAVLINK_MSG_ID_ODOMETRY: _from_odometry,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _from_global_position,
    mavlink.MAVLINK_MSG_ID_COMMAND_LONG: lambda w: m.Command(
        w.command,
        (w.param1, w.param2, w.param3, w.param4, w.param5, w.param6, w.param7),
        w.target_system, w.target_component, w.confirmation,
    ),
    mavlink.MAVLINK_MSG_ID_COMMAND_INT: _from_command_int,
    mavlink.MAVLINK_MSG_ID_COMMAND_ACK: lambda w: m.CommandAck(
        w.command, w.result, w.target_system, w.target_component
    ),
    mavlink.MAVLINK_MSG_ID_SET_MODE: lambda w: m.SetMode(
        w.target_system, w.base_mode, w.custom_mode
    ),
    mavlink.MAVLINK_MSG_ID_STATUSTEXT: lambda w: m.StatusText(w.severity, _text(w.text)),
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: _from_system_status,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: lambda w: m.BatteryStatus(
        w.voltages[0] / 1e3, w.current_battery / 100, w.battery_remaining / 100
    ),
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: lambda w: m.ExtendedSystemState(w.landed_state),
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: lambda w: m.HomePosition(
        w.latitude / 1e7, w.longitude / 1e7, w.altitude / 1e3, _array(*enu_ned(w.x, w.y, w.z))
    ),
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: lambda w: m.GpsRaw(
        w.time_usec / 1e6, w.fix_type, w.lat / 1e7, w.lon / 1e7, w.alt / 1e3,
        w.satellites_visible, w.vel / 100, yaw_from_heading(math.radians(w.cog / 100)),
    ),
    mavlink.MAVLINK_MSG_ID_GPS_INPUT: lambda w: m.GpsInput(
        w.time_usec / 1e6, w.fix_type, w.lat / 1e7, w.lon / 1e7, w.alt,
        _gps_velocity(w), w.satellites_visible,
    ),
    mavlink.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS: lambda w: m.HilActuators(
        w.time_usec / 1e6, tuple(w.controls), bool(w.mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
    ),
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: lambda w: m.EstimatorStatus(
        w.time_usec / 1e6, w.flags, w.pos_horiz_accuracy, w.pos_vert_accuracy
    ),
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: lambda w: m.AutopilotVersion(
        w.capabilities, w.flight_sw_version, w.uid
    ),
    mavlink.MAVLINK_MSG_ID_TIMESYNC: lambda w: m.TimeSync(w.tc1, w.ts1),
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: lambda w: m.SystemTime(
        w.time_boot_ms / 1e3, w.time_unix_usec / 1e6
    ),
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ: lambda w: m.ParamRequestRead(
        w.target_system, w.target_component, _text(w.param_id), w.param_index
    ),
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: lambda w: m.ParamRequestList(
        w.target_system, w.target_component
    ),
    mavlink.MAVLINK_MSG_ID_PARAM_SET: lambda w: m.ParamSet(
        w.target_system, w.target_component, _text(w.param_id), w.param_value, w.param_type
    ),
    mavlink.MAVLINK_MSG_ID_PARAM_VALUE: lambda w: m.ParamValue(
        _text(w.param_id), w.param_value, w.param_type, w.param_count, w.param_index
    ),
    mavlink.MAVLINK_MSG_ID_MISSION_COUNT: lambda w: m.MissionCount(
        w.target_system, w.target_component, w.count, w.mission_type
    ),
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: lambda w: m.MissionRequestList(
        w.target_system, w.target_component, w.mission_type
    ),
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST: lambda w: m.MissionRequest(
        w.target_system, w.target_component, w.seq, w.mission_type
    ),
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT: lambda w: m.MissionRequest(
        w.target_system, w.target_component, w.seq, w.mission_type
    ),
    mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT: _from_mission_item,
    mavlink.MAVLINK_MSG_ID_MISSION_ITEM: _from_mission_item,
    mavlink.MAVLINK_MSG_ID_MISSION_ACK: lambda w: m.MissionAck(
        w.target_system, w.target_component, w.type, w.mission_type
    ),
    mavlink.MAVLINK_MSG_ID_MISSION_SET_CURRENT: lambda w: m.MissionSetCurrent(
        w.target_system, w.target_component, w.seq
    ),
    mavlink.MAVLINK_MSG_ID_MISSION_CLEAR_ALL: lambda w: m.MissionClearAll(
        w.target_system, w.target_component, w.mission_type
    ),
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: lambda w: m.MissionCurrent(w.seq),
    mavlink.MAVLINK_MSG_ID_MISSION_ITEM_REACHED: lambda w: m.MissionItemReached(w.seq),
    mavlink.MAVLINK_MSG_ID_REQUEST_DATA_STREAM: lambda w: m.RequestDataStream(
        w.target_system, w.target_component, w.req_stream_id, w.req_message_rate,
        bool(w.start_stop),
    ),
    mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL: lambda w: m.FileTransfer(
        w.target_system, w.target_component, bytes(w.payload)
    ),
}  # fmt: skip
