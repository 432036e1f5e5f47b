"""Message classes as MAVLink messages."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import (
    enu_ned,
    euler_from_quaternion,
    flu_frd,
    heading_from_yaw,
    quaternion_enu_ned,
    rotation_matrix,
)
from mavlink_bridge.wire import messages as m
from mavlink_bridge.wire.dialect import common as mavlink
from mavlink_bridge.wire.dialect.layout import message
from mavlink_bridge.wire.dialect.units import (
    UNKNOWN_HEADING,
    clipped,
    coordinate,
    course,
    int16,
    milliseconds,
)

_IDENTITY = (1.0, 0.0, 0.0, 0.0)
_MAVLINK_2 = 3  # mavlink_version of a HEARTBEAT
_ALL_FIELDS = 0x1FFF  # fields_updated of HIL_SENSOR
_NAME_BYTES = 10  # of NAMED_VALUE_FLOAT and _INT
_UNKNOWN_TEMPERATURE = 0x7FFF
_UNKNOWN_COVARIANCE = (math.nan,) * 21
_DIAGONAL = (0, 6, 11, 15, 18, 20)  # of a covariance (6,6), in its upper triangle
_NO_RATES = (0.0,) * 9  # the last of that triangle, behind the velocity's
_FRD = np.array([1.0, -1.0, -1.0])
_UNKNOWN_VARIANCE = 255  # cm², of DISTANCE_SENSOR
_FILE_BYTES = 251  # payload of FILE_TRANSFER_PROTOCOL
_EVENT_BYTES = 40  # arguments of EVENT


def _ned(v: Vector) -> tuple[float, float, float]:
    """Return a world vector (3,) in NED."""
    x, y, z = np.asarray(v, float).tolist()
    return enu_ned(x, y, z)


def _frd(v: Vector) -> tuple[float, float, float]:
    """Return a body vector (3,) in FRD."""
    x, y, z = np.asarray(v, float).tolist()
    return flu_frd(x, y, z)


def _rate_setpoint(s: m.RateSetpoint) -> Any:
    roll_rate, pitch_rate, yaw_rate = _frd(s.omega)
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


def _heartbeat(h: m.Heartbeat) -> Any:
    armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if h.armed else 0
    return message("HEARTBEAT")(
        type=h.vehicle_type,
        autopilot=h.autopilot,
        base_mode=h.base_mode | armed,
        custom_mode=h.custom_mode,
        system_status=h.system_status,
        mavlink_version=_MAVLINK_2,
    )


def _attitude(a: m.Attitude) -> Any:
    return message("ATTITUDE_QUATERNION")(
        milliseconds(a.time), *quaternion_enu_ned(a.q_wb), *_frd(a.omega)
    )


def _euler_attitude(a: m.EulerAttitude) -> Any:
    angles = euler_from_quaternion(quaternion_enu_ned(a.q_wb))
    return message("ATTITUDE")(milliseconds(a.time), *angles, *_frd(a.omega))


def _attitude_target(a: m.AttitudeTarget) -> Any:
    roll_rate, pitch_rate, yaw_rate = _frd(a.omega)
    return message("ATTITUDE_TARGET")(
        time_boot_ms=milliseconds(a.time),
        type_mask=a.type_mask,
        q=quaternion_enu_ned(a.q_wb),
        body_roll_rate=roll_rate,
        body_pitch_rate=pitch_rate,
        body_yaw_rate=yaw_rate,
        thrust=a.thrust,
    )


def _local_position(lp: m.LocalPosition) -> Any:
    return message("LOCAL_POSITION_NED")(milliseconds(lp.time), *_ned(lp.p), *_ned(lp.v))


def _odometry(o: m.Odometry) -> Any:
    x, y, z = _ned(o.p)
    rotation = rotation_matrix(o.q_wb)
    vx, vy, vz = _frd(rotation.T @ o.v)
    roll_rate, pitch_rate, yaw_rate = _frd(o.omega)
    return message("ODOMETRY")(
        time_usec=round(o.time * 1e6),
        frame_id=mavlink.MAV_FRAME_LOCAL_NED,
        child_frame_id=mavlink.MAV_FRAME_BODY_FRD,
        x=x,
        y=y,
        z=z,
        q=quaternion_enu_ned(o.q_wb),
        vx=vx,
        vy=vy,
        vz=vz,
        rollspeed=roll_rate,
        pitchspeed=pitch_rate,
        yawspeed=yaw_rate,
        pose_covariance=_pose_covariance(o),
        velocity_covariance=_velocity_covariance(o, rotation),
        reset_counter=o.resets & 0xFF,
        estimator_type=o.estimator,
        quality=o.quality,
    )


def _pose_covariance(o: m.Odometry) -> tuple[float, ...]:
    """Return the upper triangle, row by row, of x, y, z, roll, pitch, yaw."""
    if o.position_sigma is None or o.attitude_sigma is None:
        return _UNKNOWN_COVARIANCE
    east, north, up = o.position_sigma.tolist()
    triangle = [0.0] * len(_UNKNOWN_COVARIANCE)
    for at, sigma in zip(_DIAGONAL, (north, east, up, *o.attitude_sigma.tolist()), strict=True):
        triangle[at] = sigma**2
    return tuple(triangle)


def _velocity_covariance(o: m.Odometry, rotation: Vector) -> tuple[float, ...]:
    """Return the same of the velocity, which is along the axes of the body, and of the rates."""
    if o.velocity_sigma is None:
        return _UNKNOWN_COVARIANCE
    turn = _FRD * rotation
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = ((turn.T * o.velocity_sigma**2) @ turn).tolist()
    return (xx, xy, xz, 0.0, 0.0, 0.0, yy, yz, 0.0, 0.0, 0.0, zz, *_NO_RATES)


def _global_position(g: m.GlobalPosition) -> Any:
    vx, vy, vz = _ned(g.v)
    heading = UNKNOWN_HEADING if g.heading is None else course(math.degrees(g.heading))
    return message("GLOBAL_POSITION_INT")(
        time_boot_ms=milliseconds(g.time),
        lat=round(g.latitude_deg * 1e7),
        lon=round(g.longitude_deg * 1e7),
        alt=round(g.altitude * 1e3),
        relative_alt=round(g.relative_altitude * 1e3),
        vx=int16(vx * 100),
        vy=int16(vy * 100),
        vz=int16(vz * 100),
        hdg=heading,
    )


def _system_status(s: m.SystemStatus) -> Any:
    return message("SYS_STATUS")(
        onboard_control_sensors_present=s.present,
        onboard_control_sensors_enabled=s.enabled,
        onboard_control_sensors_health=s.health,
        load=clipped(s.load * 1000, 0, 1000),
        voltage_battery=clipped(s.voltage * 1e3, 0, 65535),
        current_battery=int16(s.current * 100),
        battery_remaining=clipped(s.remaining * 100, -1, 100),
        drop_rate_comm=0,
        errors_comm=0,
        errors_count1=0,
        errors_count2=0,
        errors_count3=0,
        errors_count4=0,
    )


def _battery(b: m.BatteryStatus) -> Any:
    return message("BATTERY_STATUS")(
        id=0,
        battery_function=mavlink.MAV_BATTERY_FUNCTION_UNKNOWN,
        type=mavlink.MAV_BATTERY_TYPE_LION,
        temperature=_UNKNOWN_TEMPERATURE,
        voltages=[clipped(b.voltage * 1e3, 0, 65534), *(0xFFFF,) * 9],  # the pack, no other cells
        current_battery=clipped(b.current * 100, -1, 32767),
        current_consumed=-1,
        energy_consumed=-1,
        battery_remaining=clipped(b.remaining * 100, -1, 100),
    )


def _home(h: m.HomePosition) -> Any:
    x, y, z = _ned(h.p)
    return message("HOME_POSITION")(
        latitude=round(h.latitude_deg * 1e7),
        longitude=round(h.longitude_deg * 1e7),
        altitude=round(h.altitude * 1e3),
        x=x,
        y=y,
        z=z,
        q=(math.nan,) * 4,
        approach_x=math.nan,
        approach_y=math.nan,
        approach_z=math.nan,
    )


def _gps_raw(g: m.GpsRaw) -> Any:
    return message("GPS_RAW_INT")(
        time_usec=round(g.time * 1e6),
        fix_type=g.fix_type,
        lat=round(g.latitude_deg * 1e7),
        lon=round(g.longitude_deg * 1e7),
        alt=round(g.altitude * 1e3),
        eph=clipped(g.hdop * 100, 0, 0xFFFF),
        epv=clipped(g.vdop * 100, 0, 0xFFFF),
        vel=clipped(g.speed * 100, 0, 65535),
        cog=course(math.degrees(heading_from_yaw(g.course))),
        satellites_visible=g.satellites,
        h_acc=clipped(g.horizontal_accuracy * 1e3, 0, 0xFFFFFFFF),
        v_acc=clipped(g.vertical_accuracy * 1e3, 0, 0xFFFFFFFF),
        vel_acc=clipped(g.speed_accuracy * 1e3, 0, 0xFFFFFFFF),
    )


def _distance(d: m.DistanceSensor) -> Any:
    return message("DISTANCE_SENSOR")(
        time_boot_ms=milliseconds(d.time),
        min_distance=clipped(d.minimum * 100, 0, 0xFFFF),
        max_distance=clipped(d.maximum * 100, 0, 0xFFFF),
        current_distance=clipped(d.distance * 100, 0, 0xFFFF),
        type=d.kind,
        id=0,
        orientation=d.orientation,
        covariance=clipped((d.sigma * 100) ** 2, 0, 254) if d.sigma else _UNKNOWN_VARIANCE,
        signal_quality=clipped(d.quality, 0, 100),
    )


def _gps_input(g: m.GpsInput) -> Any:
    given = [] if g.v is None else [float(a) for a in g.v]
    ignored = 0 if len(given) > 1 else mavlink.GPS_INPUT_IGNORE_FLAG_VEL_HORIZ
    ignored |= 0 if len(given) > 2 else mavlink.GPS_INPUT_IGNORE_FLAG_VEL_VERT
    east, north, up = (*given, 0.0, 0.0, 0.0)[:3]
    vn, ve, vd = enu_ned(east, north, up)
    return message("GPS_INPUT")(
        time_usec=round(g.time * 1e6),
        gps_id=0,
        ignore_flags=ignored,
        time_week_ms=0,
        time_week=0,
        fix_type=g.fix_type,
        lat=round(g.latitude_deg * 1e7),
        lon=round(g.longitude_deg * 1e7),
        alt=g.altitude,
        hdop=0.8,
        vdop=1.2,
        vn=vn,
        ve=ve,
        vd=vd,
        speed_accuracy=0.1,
        horiz_accuracy=0.5,
        vert_accuracy=0.8,
        satellites_visible=g.satellites,
    )


def _hil_sensor(s: m.HilSensor) -> Any:
    return message("HIL_SENSOR")(
        round(s.time * 1e6),
        *_frd(s.force),
        *_frd(s.omega),
        *_frd(s.magnetic),
        abs_pressure=s.pressure,
        diff_pressure=0.0,
        pressure_alt=s.altitude,
        temperature=25.0,
        fields_updated=_ALL_FIELDS,
    )


def _hil_gps(g: m.HilGps) -> Any:
    vn, ve, vd = (int16(a * 100) for a in _ned(g.v))
    return message("HIL_GPS")(
        time_usec=round(g.time * 1e6),
        fix_type=mavlink.GPS_FIX_TYPE_3D_FIX,
        lat=round(g.latitude_deg * 1e7),
        lon=round(g.longitude_deg * 1e7),
        alt=round(g.altitude * 1e3),
        eph=round(g.horizontal * 100),
        epv=round(g.vertical * 100),
        vel=round(math.hypot(vn, ve)),
        vn=vn,
        ve=ve,
        vd=vd,
        cog=course(math.degrees(math.atan2(ve, vn))),
        satellites_visible=12,
    )


def _estimator(e: m.EstimatorStatus) -> Any:
    return message("ESTIMATOR_STATUS")(
        time_usec=round(e.time * 1e6),
        flags=e.flags,
        vel_ratio=e.velocity_ratio,
        pos_horiz_ratio=e.horizontal_ratio,
        pos_vert_ratio=e.vertical_ratio,
        mag_ratio=e.magnetometer_ratio,
        hagl_ratio=e.height_over_ground_ratio,
        tas_ratio=0.0,
        pos_horiz_accuracy=e.horizontal_accuracy,
        pos_vert_accuracy=e.vertical_accuracy,
    )


def _autopilot_version(v: m.AutopilotVersion) -> Any:
    zeros = [0] * 8
    return message("AUTOPILOT_VERSION")(
        capabilities=v.capabilities,
        flight_sw_version=v.flight_sw_version,
        middleware_sw_version=0,
        os_sw_version=0,
        board_version=0,
        flight_custom_version=zeros,
        middleware_custom_version=zeros,
        os_custom_version=zeros,
        vendor_id=0,
        product_id=0,
        uid=v.uid,
    )


def _mission_item(i: m.MissionItem) -> Any:
    if i.floating:
        return message("MISSION_ITEM")(
            i.target_system,
            i.target_component,
            i.seq,
            i.frame,
            i.command,
            i.current,
            i.autocontinue,
            *i.params,
            x=i.x_deg,
            y=i.y_deg,
            z=i.z,
            mission_type=i.mission_type,
        )
    return message("MISSION_ITEM_INT")(
        i.target_system,
        i.target_component,
        i.seq,
        i.frame,
        i.command,
        i.current,
        i.autocontinue,
        *i.params,
        x=coordinate(i.x_deg),
        y=coordinate(i.y_deg),
        z=i.z,
        mission_type=i.mission_type,
    )


def _named_value(v: m.NamedValue) -> Any:
    name, time = v.name.encode()[:_NAME_BYTES], milliseconds(v.time)
    if isinstance(v.value, int):
        return message("NAMED_VALUE_INT")(time, name, v.value)
    return message("NAMED_VALUE_FLOAT")(time, name, v.value)


def _component_information(c: m.ComponentInformation) -> Any:
    return message(
        "COMPONENT_INFORMATION_BASIC"
    )(
        capabilities=c.capabilities,
        time_boot_ms=milliseconds(c.time),
        time_manufacture_s=0,  # not known
        vendor_name=c.vendor.encode()[:31],  # each ends with a zero
        model_name=c.model.encode()[:31],
        software_version=c.software.encode()[:23],
        hardware_version=b"",
        serial_number=c.serial.encode()[:31],
    )


def _camera_information(c: m.CameraInformation) -> Any:
    return message("CAMERA_INFORMATION")(
        time_boot_ms=milliseconds(c.time),
        vendor_name=list(c.vendor.encode()[:32].ljust(32, b"\0")),
        model_name=list(c.model.encode()[:32].ljust(32, b"\0")),
        firmware_version=0,
        focal_length=c.focal_length,
        sensor_size_h=c.sensor_width,
        sensor_size_v=c.sensor_height,
        resolution_h=c.width,
        resolution_v=c.height,
        lens_id=0,
        flags=c.flags,
        cam_definition_version=0,
        cam_definition_uri=b"",
    )


def _request(r: m.MissionRequest) -> Any:
    fields = (r.target_system, r.target_component, r.seq, r.mission_type)
    if r.floating:
        return message("MISSION_REQUEST")(*fields)
    return message("MISSION_REQUEST_INT")(*fields)


TO_WIRE: dict[type, Callable[[Any], Any]] = {
    m.RateSetpoint: _rate_setpoint,
    m.Heartbeat: _heartbeat,
    m.Attitude: _attitude,
    m.EulerAttitude: _euler_attitude,
    m.AttitudeTarget: _attitude_target,
    m.LocalPosition: _local_position,
    m.Odometry: _odometry,
    m.GlobalPosition: _global_position,
    m.SystemStatus: _system_status,
    m.BatteryStatus: _battery,
    m.HomePosition: _home,
    m.GpsRaw: _gps_raw,
    m.DistanceSensor: _distance,
    m.GpsInput: _gps_input,
    m.EstimatorStatus: _estimator,
    m.HilSensor: _hil_sensor,
    m.HilGps: _hil_gps,
    m.AutopilotVersion: _autopilot_version,
    m.StatusText: lambda s: message("STATUSTEXT")(
        s.severity, s.text.encode()[:50], s.number, s.chunk
    ),
    m.ParamValue: lambda p: message("PARAM_VALUE")(
        p.name.encode(), p.value, p.param_type, p.count, p.index
    ),
    m.MissionItem: _mission_item,
    m.Command: lambda c: message("COMMAND_LONG")(
        c.target_system, c.target_component, c.command, c.confirmation, *c.params
    ),
    m.CommandAck: lambda a: message("COMMAND_ACK")(
        a.command, a.result, 0, 0, a.target_system, a.target_component
    ),
    m.SetMode: lambda s: message("SET_MODE")(s.target_system, s.base_mode, s.custom_mode),
    m.ExtendedSystemState: lambda e: message("EXTENDED_SYS_STATE")(0, e.landed_state),
    m.TimeSync: lambda t: message("TIMESYNC")(t.tc1, t.ts1),
    m.SystemTime: lambda t: message("SYSTEM_TIME")(round(t.unix_time * 1e6), milliseconds(t.time)),
    m.ParamRequestRead: lambda p: message("PARAM_REQUEST_READ")(
        p.target_system, p.target_component, p.name.encode(), p.index
    ),
    m.ParamRequestList: lambda p: message("PARAM_REQUEST_LIST")(
        p.target_system, p.target_component
    ),
    m.ParamSet: lambda p: message("PARAM_SET")(
        p.target_system, p.target_component, p.name.encode(), p.value, p.param_type
    ),
    m.ParamError: lambda p: message("PARAM_ERROR")(
        p.target_system, p.target_component, p.name.encode(), p.index, p.error
    ),
    m.Event: lambda e: message("EVENT")(
        event_id=e.event_id,
        event_time_boot_ms=milliseconds(e.time),
        sequence=e.sequence,
        destination_component=0,
        destination_system=0,
        log_levels=0xF0 | e.severity,
        arguments=e.arguments.ljust(_EVENT_BYTES, b"\0"),
    ),
    m.NamedValue: _named_value,
    m.ComponentInformation: _component_information,
    m.CameraInformation: _camera_information,
    m.Ping: lambda p: message("PING")(
        round(p.time * 1e6), p.sequence, p.target_system, p.target_component
    ),
    m.MissionCount: lambda c: message("MISSION_COUNT")(
        c.target_system, c.target_component, c.count, c.mission_type
    ),
    m.MissionRequestList: lambda r: message("MISSION_REQUEST_LIST")(
        r.target_system, r.target_component, r.mission_type
    ),
    m.MissionRequest: _request,
    m.MissionAck: lambda a: message("MISSION_ACK")(
        a.target_system, a.target_component, a.result, a.mission_type
    ),
    m.MissionSetCurrent: lambda s: message("MISSION_SET_CURRENT")(
        s.target_system, s.target_component, s.seq
    ),
    m.MissionClearAll: lambda c: message("MISSION_CLEAR_ALL")(
        c.target_system, c.target_component, c.mission_type
    ),
    m.MissionCurrent: lambda c: message("MISSION_CURRENT")(c.seq),
    m.MissionItemReached: lambda r: message("MISSION_ITEM_REACHED")(r.seq),
    m.RequestDataStream: lambda r: message("REQUEST_DATA_STREAM")(
        r.target_system, r.target_component, r.stream, round(r.rate_hz), int(r.start)
    ),
    m.FileTransfer: lambda f: message("FILE_TRANSFER_PROTOCOL")(
        0, f.target_system, f.target_component, f.payload.ljust(_FILE_BYTES, b"\0")
    ),
}
