"""Attitude, position and velocity of a vehicle, to and from MAVLink: `messages.state`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import (
    enu_ned,
    euler_from_quaternion,
    flu_frd,
    quaternion_enu_ned,
    quaternion_from_euler,
    rotation_matrix,
)
from mavlink_bridge.wire import messages as m
from mavlink_bridge.wire.dialect import common as mavlink
from mavlink_bridge.wire.dialect.axes import body_rates, frd, ned, vector
from mavlink_bridge.wire.dialect.layout import NUMBERS, message
from mavlink_bridge.wire.dialect.units import UNKNOWN_HEADING, course, int16, milliseconds

_FLIP = np.array([1.0, -1.0, -1.0])  # FRD ↔ FLU, NED ↔ north-west-up
_ENU_OF_NWU = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # NWU → ENU
_NED_FRAMES = (mavlink.MAV_FRAME_LOCAL_NED,)
_BODY_FRAMES = (mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_FRD)
_UNKNOWN_COVARIANCE = (math.nan,) * 21
_NO_RATES = (0.0,) * 9  # the last of a covariance's upper triangle, behind the velocity's
# Indices in the upper triangle of a covariance (6,6), row by row.
_DIAGONAL = (0, 6, 11, 15, 18, 20)
_of_diagonal = itemgetter(*_DIAGONAL)
_of_place = itemgetter(0, 1, 2, 6, 7, 11)  # its first three rows and columns


def _attitude_to_wire(a: m.Attitude) -> Any:
    return message("ATTITUDE_QUATERNION")(
        milliseconds(a.time), *quaternion_enu_ned(a.q_wb), *frd(a.omega)
    )


def _attitude_from_wire(w: Any) -> m.Attitude:
    q = np.array(quaternion_enu_ned((w.q1, w.q2, w.q3, w.q4)))
    return m.Attitude(w.time_boot_ms / 1e3, q, body_rates(w))


def _euler_attitude_to_wire(a: m.EulerAttitude) -> Any:
    angles = euler_from_quaternion(quaternion_enu_ned(a.q_wb))
    return message("ATTITUDE")(milliseconds(a.time), *angles, *frd(a.omega))


def _euler_attitude_from_wire(w: Any) -> m.EulerAttitude:
    q = np.array(quaternion_enu_ned(quaternion_from_euler(w.roll, w.pitch, w.yaw)))
    return m.EulerAttitude(w.time_boot_ms / 1e3, q, body_rates(w))


def _attitude_target_to_wire(a: m.AttitudeTarget) -> Any:
    roll_rate, pitch_rate, yaw_rate = frd(a.omega)
    return message("ATTITUDE_TARGET")(
        time_boot_ms=milliseconds(a.time),
        type_mask=a.type_mask,
        q=quaternion_enu_ned(a.q_wb),
        body_roll_rate=roll_rate,
        body_pitch_rate=pitch_rate,
        body_yaw_rate=yaw_rate,
        thrust=a.thrust,
    )


def _attitude_target_from_wire(w: Any) -> m.AttitudeTarget:
    q = np.array(quaternion_enu_ned(w.q))
    omega = vector(*flu_frd(w.body_roll_rate, w.body_pitch_rate, w.body_yaw_rate))
    return m.AttitudeTarget(w.time_boot_ms / 1e3, q, omega, w.thrust, w.type_mask)


def _local_position_to_wire(lp: m.LocalPosition) -> Any:
    return message("LOCAL_POSITION_NED")(milliseconds(lp.time), *ned(lp.p), *ned(lp.v))


def _local_position_from_wire(w: Any) -> m.LocalPosition:
    p, v = enu_ned(w.x, w.y, w.z), enu_ned(w.vx, w.vy, w.vz)
    return m.LocalPosition(w.time_boot_ms / 1e3, vector(*p), vector(*v))


def _odometry_to_wire(o: m.Odometry) -> Any:
    x, y, z = ned(o.p)
    rotation = rotation_matrix(o.q_wb)
    vx, vy, vz = frd(rotation.T @ o.v)
    roll_rate, pitch_rate, yaw_rate = frd(o.omega)
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
    turn = _FLIP * rotation
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = ((turn.T * o.velocity_sigma**2) @ turn).tolist()
    return (xx, xy, xz, 0.0, 0.0, 0.0, yy, yz, 0.0, 0.0, 0.0, zz, *_NO_RATES)


def _odometry_from_wire(w: Any) -> m.Odometry:
    """Convert ODOMETRY, whose velocity is along the axes of the body or of the world.

    A velocity that is not finite, or turned by an attitude that is not, is NaN.
    """
    q = quaternion_enu_ned(w.q)
    known = w.frame_id in _NED_FRAMES and w.child_frame_id in (*_NED_FRAMES, *_BODY_FRAMES)
    p = vector(*enu_ned(w.x, w.y, w.z)) if known else _no_vector()
    turn = _ENU_OF_NWU if w.child_frame_id not in _BODY_FRAMES else _rotation(q)
    pose = _sigmas(w.pose_covariance)
    return m.Odometry(
        w.time_usec / 1e6,
        p,
        _turned(turn, flu_frd(w.vx, w.vy, w.vz)),
        np.array(q),
        body_rates(w),
        position_sigma=None if pose is None else vector(pose[1], pose[0], pose[2]),
        velocity_sigma=_velocity_sigma(w.velocity_covariance, turn),
        attitude_sigma=None if pose is None else np.array(pose[3:]),
        resets=w.reset_counter,
        estimator=w.estimator_type,
        quality=w.quality,
    )


def _no_vector() -> Vector:
    return np.full(3, math.nan)


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


def _global_position_to_wire(g: m.GlobalPosition) -> Any:
    vx, vy, vz = ned(g.v)
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


def _global_position_from_wire(w: Any) -> m.GlobalPosition:
    return m.GlobalPosition(
        w.time_boot_ms / 1e3,
        w.lat / 1e7,
        w.lon / 1e7,
        w.alt / 1e3,
        w.relative_alt / 1e3,
        vector(*enu_ned(w.vx / 100, w.vy / 100, w.vz / 100)),
        None if w.hdg == UNKNOWN_HEADING else math.radians(w.hdg / 100),
    )


def _home_to_wire(h: m.HomePosition) -> Any:
    x, y, z = ned(h.p)
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


def _home_from_wire(w: Any) -> m.HomePosition:
    p = vector(*enu_ned(w.x, w.y, w.z))
    return m.HomePosition(w.latitude / 1e7, w.longitude / 1e7, w.altitude / 1e3, p)


def _estimator_to_wire(e: m.EstimatorStatus) -> Any:
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


def _estimator_from_wire(w: Any) -> m.EstimatorStatus:
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


TO_WIRE: dict[type, Callable[[Any], Any]] = {
    m.Attitude: _attitude_to_wire,
    m.EulerAttitude: _euler_attitude_to_wire,
    m.AttitudeTarget: _attitude_target_to_wire,
    m.LocalPosition: _local_position_to_wire,
    m.Odometry: _odometry_to_wire,
    m.GlobalPosition: _global_position_to_wire,
    m.HomePosition: _home_to_wire,
    m.EstimatorStatus: _estimator_to_wire,
}

FROM_WIRE: dict[int, Callable[[Any], m.Message]] = {
    NUMBERS["ATTITUDE_QUATERNION"]: _attitude_from_wire,
    NUMBERS["ATTITUDE"]: _euler_attitude_from_wire,
    NUMBERS["ATTITUDE_TARGET"]: _attitude_target_from_wire,
    NUMBERS["LOCAL_POSITION_NED"]: _local_position_from_wire,
    NUMBERS["ODOMETRY"]: _odometry_from_wire,
    NUMBERS["GLOBAL_POSITION_INT"]: _global_position_from_wire,
    NUMBERS["HOME_POSITION"]: _home_from_wire,
    NUMBERS["ESTIMATOR_STATUS"]: _estimator_from_wire,
}
