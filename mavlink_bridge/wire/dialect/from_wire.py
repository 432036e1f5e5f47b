"""MAVLink messages as message classes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import (
    enu_ned,
    flu_frd,
    quaternion_enu_ned,
    quaternion_from_euler,
    rotation_matrix,
    yaw_from_heading,
)
from mavlink_bridge.wire import messages as m
from mavlink_bridge.wire.dialect import common as mavlink
from mavlink_bridge.wire.dialect.layout import NUMBERS
from mavlink_bridge.wire.dialect.units import UNKNOWN_HEADING, UNSET_COORDINATE

_FLIP = np.array([1.0, -1.0, -1.0])  # FRD ↔ FLU, NED ↔ north-west-up
_ENU_OF_NWU = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # NWU → ENU
_NED_FRAMES = (mavlink.MAV_FRAME_LOCAL_NED,)
_BODY_FRAMES = (mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_FRD)
_GLOBAL_FRAMES = (  # x and y of COMMAND_INT are degrees · 1e7; elsewhere metres · 1e4
    mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_INT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
)


_UNKNOWN_VARIANCE = 255  # cm², of DISTANCE_SENSOR
# Indices in the upper triangle of a covariance (6,6), row by row.
_of_diagonal = itemgetter(0, 6, 11, 15, 18, 20)
_of_place = itemgetter(0, 1, 2, 6, 7, 11)  # its first three rows and columns


def _no_vector() -> Vector:
    return np.full(3, math.nan)


def _text(raw: str | bytes) -> str:
    return raw.decode("utf-8", "replace") if isinstance(raw, bytes) else raw


def _array(x: float, y: float, z: float) -> Vector:
    return np.array((x, y, z), dtype=float)


def _body_rates(w: Any) -> Vector:
    return _array(*flu_frd(w.rollspeed, w.pitchspeed, w.yawspeed))


def _rate_setpoint(w: Any) -> m.RateSetpoint:
    return m.RateSetpoint(
        w.time_boot_ms / 1e3,
        _array(*flu_frd(w.body_roll_rate, w.body_pitch_rate, w.body_yaw_rate)),
        w.thrust,
        w.target_system,
        w.target_component,
        w.type_mask,
        np.array(quaternion_enu_ned(w.q)),
    )


def _heartbeat(w: Any) -> m.Heartbeat:
    armed = bool(w.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
    return m.Heartbeat(w.autopilot, w.type, armed, w.custom_mode, w.system_status, w.base_mode)


def _attitude(w: Any) -> m.Attitude:
    q = np.array(quaternion_enu_ned((w.q1, w.q2, w.q3, w.q4)))
    return m.Attitude(w.time_boot_ms / 1e3, q, _body_rates(w))


def _euler_attitude(w: Any) -> m.EulerAttitude:
    q = np.array(quaternion_enu_ned(quaternion_from_euler(w.roll, w.pitch, w.yaw)))
    return m.EulerAttitude(w.time_boot_ms / 1e3, q, _body_rates(w))


def _attitude_target(w: Any) -> m.AttitudeTarget:
    q = np.array(quaternion_enu_ned(w.q))
    omega = _array(*flu_frd(w.body_roll_rate, w.body_pitch_rate, w.body_yaw_rate))
    return m.AttitudeTarget(w.time_boot_ms / 1e3, q, omega, w.thrust, w.type_mask)


def _local_position(w: Any) -> m.LocalPosition:
    p, v = enu_ned(w.x, w.y, w.z), enu_ned(w.vx, w.vy, w.vz)
    return m.LocalPosition(w.time_boot_ms / 1e3, _array(*p), _array(*v))


def _odometry(w: Any) -> m.Odometry:
    """Convert ODOMETRY, whose velocity is along the axes of the body or of the world.

    A velocity that is not finite, or turned by an attitude that is not, is NaN.
    """
    q = quaternion_enu_ned(w.q)
    known = w.frame_id in _NED_FRAMES and w.child_frame_id in (*_NED_FRAMES, *_BODY_FRAMES)
    p = _array(*enu_ned(w.x, w.y, w.z)) if known else _no_vector()
    turn = _ENU_OF_NWU if w.child_frame_id not in _BODY_FRAMES else _rotation(q)
    pose = _sigmas(w.pose_covariance)
    return m.Odometry(
        w.time_usec / 1e6,
        p,
        _turned(turn, flu_frd(w.vx, w.vy, w.vz)),
        np.array(q),
        _body_rates(w),
        position_sigma=None if pose is None else _array(pose[1], pose[0], pose[2]),
        velocity_sigma=_velocity_sigma(w.velocity_covariance, turn),
        attitude_sigma=None if pose is None else np.array(pose[3:]),
        resets=w.reset_counter,
        estimator=w.estimator_type,
        quality=w.quality,
    )


def _rotation(q: Sequence[float]) -> Vector | None:
    """Return the rotation matrix of a quaternion; None where it is not finite."""
    return rotation_matrix(q) if all(map(math.isfinite, q)) else None


def _turned(turn: Vector | None, along: Sequence[float]) -> Vector:
    """Return a vector (3,) turned by a matrix (3,3); NaN where there is none, or it is infinite."""
    if turn is None or not all(map(math.isfinite, along)):
        return _no_vector()
    turned: Vector = turn @ np.array(along)
    return turned


def _told(upper: Sequence[float]) -> bool:
    """Return whether the upper triangle of a covariance (6,6) is told, and is one."""
    place = all(map(math.isfinite, _of_place(upper)))
    return place and all(variance >= 0.0 for variance in _of_diagonal(upper))


def _sigmas(upper: Sequence[float]) -> list[float] | None:
    """Return the square roots (6,) of the variances."""
    return list(map(math.sqrt, _of_diagonal(upper))) if _told(upper) else None


def _velocity_sigma(upper: Sequence[float], turn: Vector | None) -> Vector | None:
    """Return the standard deviations (3,) m/s, ENU; turn: FLU axes of the message → ENU."""
    if turn is None or not _told(upper):
        return None
    xx, xy, xz, yy, yz, zz = _of_place(upper)
    turn = turn * _FLIP
    covariance = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    variances: list[float] = (turn @ covariance @ turn.T).diagonal().tolist()
    return np.array([math.sqrt(max(variance, 0.0)) for variance in variances])


def _global_position(w: Any) -> m.GlobalPosition:
    return m.GlobalPosition(
        w.time_boot_ms / 1e3,
        w.lat / 1e7,
        w.lon / 1e7,
        w.alt / 1e3,
        w.relative_alt / 1e3,
        _array(*enu_ned(w.vx / 100, w.vy / 100, w.vz / 100)),
        None if w.hdg == UNKNOWN_HEADING else math.radians(w.hdg / 100),
    )


def _command_long(w: Any) -> m.Command:
    params = (w.param1, w.param2, w.param3, w.param4, w.param5, w.param6, w.param7)
    return m.Command(w.command, params, w.target_system, w.target_component, w.confirmation)


def _command_int(w: Any) -> m.Command:
    scale = 1e7 if w.frame in _GLOBAL_FRAMES else 1e4
    params = (w.param1, w.param2, w.param3, w.param4, w.x / scale, w.y / scale, w.z)
    return m.Command(w.command, params, w.target_system, w.target_component, frame=w.frame)


def _system_status(w: Any) -> m.SystemStatus:
    return m.SystemStatus(
        w.onboard_control_sensors_present,
        w.onboard_control_sensors_enabled,
        w.onboard_control_sensors_health,
        w.voltage_battery / 1e3,
        w.current_battery / 100,
        w.battery_remaining / 100,
        w.load / 1000,
    )


def _battery(w: Any) -> m.BatteryStatus:
    return m.BatteryStatus(w.voltages[0] / 1e3, w.current_battery / 100, w.battery_remaining / 100)


def _home(w: Any) -> m.HomePosition:
    p = _array(*enu_ned(w.x, w.y, w.z))
    return m.HomePosition(w.latitude / 1e7, w.longitude / 1e7, w.altitude / 1e3, p)


def _gps_raw(w: Any) -> m.GpsRaw:
    return m.GpsRaw(
        w.time_usec / 1e6,
        w.fix_type,
        w.lat / 1e7,
        w.lon / 1e7,
        w.alt / 1e3,
        w.satellites_visible,
        w.vel / 100,
        yaw_from_heading(math.radians(w.cog / 100)),
        w.eph / 100,
        w.epv / 100,
        w.h_acc / 1e3,
        w.v_acc / 1e3,
        w.vel_acc / 1e3,
    )


def _distance(w: Any) -> m.DistanceSensor:
    return m.DistanceSensor(
        w.time_boot_ms / 1e3,
        w.current_distance / 100,
        w.min_distance / 100,
        w.max_distance / 100,
        w.orientation,
        w.type,
        math.sqrt(w.covariance) / 100 if w.covariance < _UNKNOWN_VARIANCE else 0.0,
        w.signal_quality,
    )


def _gps_input(w: Any) -> m.GpsInput:
    return m.GpsInput(
        w.time_usec / 1e6,
        w.fix_type,
        w.lat / 1e7,
        w.lon / 1e7,
        w.alt,
        _gps_input_velocity(w),
        w.satellites_visible,
    )


def _gps_input_velocity(w: Any) -> Vector | None:
    """Return the velocity [m/s, ENU] (3,), (2,) or None, as the ignore flags allow."""
    if w.ignore_flags & mavlink.GPS_INPUT_IGNORE_FLAG_VEL_HORIZ:
        return None
    v = _array(*enu_ned(w.vn, w.ve, w.vd))
    return v[:2] if w.ignore_flags & mavlink.GPS_INPUT_IGNORE_FLAG_VEL_VERT else v


def _actuators(w: Any) -> m.HilActuators:
    armed = bool(w.mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
    return m.HilActuators(w.time_usec / 1e6, tuple(w.controls), armed)


def _hil_state(w: Any) -> m.HilState:
    return m.HilState(
        w.time_usec / 1e6,
        np.array(quaternion_enu_ned(w.attitude_quaternion)),
        _body_rates(w),
        w.lat / 1e7,
        w.lon / 1e7,
        w.alt / 1e3,
        _array(*enu_ned(w.vx / 100, w.vy / 100, w.vz / 100)),
    )


def _estimator(w: Any) -> m.EstimatorStatus:
    return m.EstimatorStatus(
        w.time_usec / 1e6,
        w.flags,
        w.pos_horiz_accuracy,
        w.pos_vert_accuracy,
        w.vel_ratio,
        w.pos_horiz_ratio,
        w.pos_vert_ratio,
        w.mag_ratio,
        w.hagl_ratio,
    )


def _param_request(w: Any) -> m.ParamRequestRead:
    return m.ParamRequestRead(w.target_system, w.target_component, _text(w.param_id), w.param_index)


def _param_set(w: Any) -> m.ParamSet:
    return m.ParamSet(
        w.target_system, w.target_component, _text(w.param_id), w.param_value, w.param_type
    )


def _param_value(w: Any) -> m.ParamValue:
    return m.ParamValue(
        _text(w.param_id), w.param_value, w.param_type, w.param_count, w.param_index
    )


def _mission_request(w: Any) -> m.MissionRequest:
    floating = w.msgname == "MISSION_REQUEST"
    return m.MissionRequest(w.target_system, w.target_component, w.seq, w.mission_type, floating)


def _mission_item(w: Any) -> m.MissionItem:
    x, y = w.x, w.y
    floating = w.msgname == "MISSION_ITEM"
    if not floating:
        x, y = (math.nan if k == UNSET_COORDINATE else k / 1e7 for k in (w.x, w.y))
    return m.MissionItem(
        w.target_system,
        w.target_component,
        w.seq,
        w.frame,
        w.command,
        w.current,
        w.autocontinue,
        (w.param1, w.param2, w.param3, w.param4),
        x,
        y,
        w.z,
        w.mission_type,
        floating,
    )


def _data_stream(w: Any) -> m.RequestDataStream:
    return m.RequestDataStream(
        w.target_system,
        w.target_component,
        w.req_stream_id,
        w.req_message_rate,
        bool(w.start_stop),
    )


def _event(w: Any) -> m.Event:
    severity = w.log_levels & 0xF  # the upper half is the level of the autopilot's own log
    return m.Event(w.event_time_boot_ms / 1e3, w.event_id, w.sequence, severity, bytes(w.arguments))


def _component_information(w: Any) -> m.ComponentInformation:
    return m.ComponentInformation(
        w.time_boot_ms / 1e3,
        w.capabilities,
        *(
            name.decode("utf-8", "replace")
            for name in (w.vendor_name, w.model_name, w.software_version, w.serial_number)
        ),
    )


def _camera_information(w: Any) -> m.CameraInformation:
    return m.CameraInformation(
        w.time_boot_ms / 1e3,
        bytes(w.vendor_name).rstrip(b"\0").decode("utf-8", "replace"),
        bytes(w.model_name).rstrip(b"\0").decode("utf-8", "replace"),
        w.focal_length,
        w.sensor_size_h,
        w.sensor_size_v,
        w.resolution_h,
        w.resolution_v,
        w.flags,
    )


def _named_value(w: Any) -> m.NamedValue:
    return m.NamedValue(w.time_boot_ms / 1e3, _text(w.name), w.value)


FROM_WIRE: dict[int, Callable[[Any], m.Message]] = {
    NUMBERS["SET_ATTITUDE_TARGET"]: _rate_setpoint,
    NUMBERS["HEARTBEAT"]: _heartbeat,
    NUMBERS["ATTITUDE_QUATERNION"]: _attitude,
    NUMBERS["ATTITUDE"]: _euler_attitude,
    NUMBERS["ATTITUDE_TARGET"]: _attitude_target,
    NUMBERS["LOCAL_POSITION_NED"]: _local_position,
    NUMBERS["ODOMETRY"]: _odometry,
    NUMBERS["GLOBAL_POSITION_INT"]: _global_position,
    NUMBERS["COMMAND_LONG"]: _command_long,
    NUMBERS["COMMAND_INT"]: _command_int,
    NUMBERS["COMMAND_ACK"]: lambda w: m.CommandAck(
        w.command, w.result, w.target_system, w.target_component
    ),
    NUMBERS["SET_MODE"]: lambda w: m.SetMode(w.target_system, w.base_mode, w.custom_mode),
    NUMBERS["STATUSTEXT"]: lambda w: m.StatusText(w.severity, _text(w.text), w.id, w.chunk_seq),
    NUMBERS["SYS_STATUS"]: _system_status,
    NUMBERS["BATTERY_STATUS"]: _battery,
    NUMBERS["EXTENDED_SYS_STATE"]: lambda w: m.ExtendedSystemState(w.landed_state),
    NUMBERS["HOME_POSITION"]: _home,
    NUMBERS["GPS_RAW_INT"]: _gps_raw,
    NUMBERS["DISTANCE_SENSOR"]: _distance,
    NUMBERS["GPS_INPUT"]: _gps_input,
    NUMBERS["HIL_ACTUATOR_CONTROLS"]: _actuators,
    NUMBERS["HIL_STATE_QUATERNION"]: _hil_state,
    NUMBERS["ESTIMATOR_STATUS"]: _estimator,
    NUMBERS["AUTOPILOT_VERSION"]: lambda w: m.AutopilotVersion(
        w.capabilities, w.flight_sw_version, w.uid
    ),
    NUMBERS["TIMESYNC"]: lambda w: m.TimeSync(w.tc1, w.ts1),
    NUMBERS["SYSTEM_TIME"]: lambda w: m.SystemTime(w.time_boot_ms / 1e3, w.time_unix_usec / 1e6),
    NUMBERS["PARAM_REQUEST_READ"]: _param_request,
    NUMBERS["PARAM_REQUEST_LIST"]: lambda w: m.ParamRequestList(
        w.target_system, w.target_component
    ),
    NUMBERS["PARAM_SET"]: _param_set,
    NUMBERS["PARAM_VALUE"]: _param_value,
    NUMBERS["PARAM_ERROR"]: lambda w: m.ParamError(
        w.target_system, w.target_component, _text(w.param_id), w.param_index, w.error
    ),
    NUMBERS["EVENT"]: _event,
    NUMBERS["NAMED_VALUE_FLOAT"]: _named_value,
    NUMBERS["NAMED_VALUE_INT"]: _named_value,
    NUMBERS["COMPONENT_INFORMATION_BASIC"]: _component_information,
    NUMBERS["CAMERA_INFORMATION"]: _camera_information,
    NUMBERS["PING"]: lambda w: m.Ping(
        w.time_usec / 1e6, w.seq, w.target_system, w.target_component
    ),
    NUMBERS["MISSION_COUNT"]: lambda w: m.MissionCount(
        w.target_system, w.target_component, w.count, w.mission_type
    ),
    NUMBERS["MISSION_REQUEST_LIST"]: lambda w: m.MissionRequestList(
        w.target_system, w.target_component, w.mission_type
    ),
    NUMBERS["MISSION_REQUEST"]: _mission_request,
    NUMBERS["MISSION_REQUEST_INT"]: _mission_request,
    NUMBERS["MISSION_ITEM_INT"]: _mission_item,
    NUMBERS["MISSION_ITEM"]: _mission_item,
    NUMBERS["MISSION_ACK"]: lambda w: m.MissionAck(
        w.target_system, w.target_component, w.type, w.mission_type
    ),
    NUMBERS["MISSION_SET_CURRENT"]: lambda w: m.MissionSetCurrent(
        w.target_system, w.target_component, w.seq
    ),
    NUMBERS["MISSION_CLEAR_ALL"]: lambda w: m.MissionClearAll(
        w.target_system, w.target_component, w.mission_type
    ),
    NUMBERS["MISSION_CURRENT"]: lambda w: m.MissionCurrent(w.seq),
    NUMBERS["MISSION_ITEM_REACHED"]: lambda w: m.MissionItemReached(w.seq),
    NUMBERS["REQUEST_DATA_STREAM"]: _data_stream,
    NUMBERS["FILE_TRANSFER_PROTOCOL"]: lambda w: m.FileTransfer(
        w.target_system, w.target_component, bytes(w.payload)
    ),
}
