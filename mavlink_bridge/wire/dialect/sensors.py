"""GPS fixes, ranges, and sensors of simulated vehicles, to and from MAVLink: `messages.sensors`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import (
    enu_ned,
    heading_from_yaw,
    quaternion_enu_ned,
    yaw_from_heading,
)
from mavlink_bridge.wire import messages as m
from mavlink_bridge.wire.dialect import common as mavlink
from mavlink_bridge.wire.dialect.axes import body_rates, frd, ned, vector
from mavlink_bridge.wire.dialect.layout import NUMBERS, message
from mavlink_bridge.wire.dialect.units import clipped, course, int16, milliseconds

_ALL_FIELDS = 0x1FFF  # fields_updated of HIL_SENSOR
_UNKNOWN_VARIANCE = 255  # cm², of DISTANCE_SENSOR


def _gps_raw_to_wire(g: m.GpsRaw) -> Any:
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


def _gps_raw_from_wire(w: Any) -> m.GpsRaw:
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


def _distance_to_wire(d: m.DistanceSensor) -> Any:
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


def _distance_from_wire(w: Any) -> m.DistanceSensor:
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


def _gps_input_to_wire(g: m.GpsInput) -> Any:
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


def _gps_input_from_wire(w: Any) -> m.GpsInput:
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
    v = vector(*enu_ned(w.vn, w.ve, w.vd))
    return v[:2] if w.ignore_flags & mavlink.GPS_INPUT_IGNORE_FLAG_VEL_VERT else v


def _hil_sensor_to_wire(s: m.HilSensor) -> Any:
    return message("HIL_SENSOR")(
        round(s.time * 1e6),
        *frd(s.force),
        *frd(s.omega),
        *frd(s.magnetic),
        abs_pressure=s.pressure,
        diff_pressure=0.0,
        pressure_alt=s.altitude,
        temperature=25.0,
        fields_updated=_ALL_FIELDS,
    )


def _hil_gps_to_wire(g: m.HilGps) -> Any:
    vn, ve, vd = (int16(a * 100) for a in ned(g.v))
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


def _actuators_from_wire(w: Any) -> m.HilActuators:
    armed = bool(w.mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
    return m.HilActuators(w.time_usec / 1e6, tuple(w.controls), armed)


def _hil_state_from_wire(w: Any) -> m.HilState:
    return m.HilState(
        w.time_usec / 1e6,
        np.array(quaternion_enu_ned(w.attitude_quaternion)),
        body_rates(w),
        w.lat / 1e7,
        w.lon / 1e7,
        w.alt / 1e3,
        vector(*enu_ned(w.vx / 100, w.vy / 100, w.vz / 100)),
    )


TO_WIRE: dict[type, Callable[[Any], Any]] = {
    m.GpsRaw: _gps_raw_to_wire,
    m.DistanceSensor: _distance_to_wire,
    m.GpsInput: _gps_input_to_wire,
    m.HilSensor: _hil_sensor_to_wire,
    m.HilGps: _hil_gps_to_wire,
}

FROM_WIRE: dict[int, Callable[[Any], m.Message]] = {
    NUMBERS["GPS_RAW_INT"]: _gps_raw_from_wire,
    NUMBERS["DISTANCE_SENSOR"]: _distance_from_wire,
    NUMBERS["GPS_INPUT"]: _gps_input_from_wire,
    NUMBERS["HIL_ACTUATOR_CONTROLS"]: _actuators_from_wire,
    NUMBERS["HIL_STATE_QUATERNION"]: _hil_state_from_wire,
}
