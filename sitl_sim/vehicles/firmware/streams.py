"""Telemetry: which message when on which link, and how it is made from a vehicle's estimate."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from mavlink_bridge.wire.messages import (
    Attitude,
    AutopilotVersion,
    BatteryStatus,
    EstimatorStatus,
    EulerAttitude,
    ExtendedSystemState,
    GlobalPosition,
    GpsRaw,
    Heartbeat,
    HomePosition,
    LocalPosition,
    Message,
    MissionCurrent,
    Odometry,
    SystemStatus,
    SystemTime,
)
from sitl_sim.vehicles.firmware.flavour import Mode
from sitl_sim.vehicles.firmware.guidance import heading
from sitl_sim.vehicles.firmware.schedule import HEARTBEAT
from sitl_sim.vehicles.firmware.unit import Unit

QUADROTOR = 2  # MAV_TYPE
STANDBY, ACTIVE, CRITICAL = 3, 4, 5  # MAV_STATE
# MAV_SYS_STATUS_SENSOR
GYRO, ACCELEROMETER, MAGNETOMETER, BAROMETER, GPS = 0x1, 0x2, 0x4, 0x8, 0x20
CONTROLS = 0x400 | 0x800 | 0x1000 | 0x2000 | 0x4000 | 0x8000  # rates … motor outputs
GEOFENCE = 0x100000  # not present, but never breached either: MAVProxy would say so
AHRS, BATTERY, ARMABLE = 0x200000, 0x2000000, 0x10000000
SENSORS = {"gyro": GYRO, "accelerometer": ACCELEROMETER, "magnetometer": MAGNETOMETER, "gps": GPS}
PRESENT = (
    GYRO | ACCELEROMETER | MAGNETOMETER | BAROMETER | GPS | CONTROLS | AHRS | BATTERY | ARMABLE
)
# ESTIMATOR_STATUS_FLAGS: attitude, velocities, positions, no dead reckoning; without GPS less.
ESTIMATES, ESTIMATES_WITHOUT_GPS = (
    0x1 | 0x2 | 0x4 | 0x8 | 0x10 | 0x20 | 0x100 | 0x200,
    0x1 | 0x4 | 0x20,
)
CUSTOM_MODE, GUIDED, STABILIZE, MANUAL, ARMED = 1, 8 | 4, 16, 64, 128  # MAV_MODE_FLAG
UID = 0x5157_0000  # plus the system id


def heartbeat(u: Unit) -> Message:
    """HEARTBEAT."""
    c = u.commander
    status = CRITICAL if c.failsafe else ACTIVE if c.armed and not c.landed else STANDBY
    pilot = c.mode in (Mode.POSITION, Mode.ALTITUDE, Mode.STABILIZED)
    base = CUSTOM_MODE | STABILIZE | (MANUAL if pilot else GUIDED) | (ARMED if c.armed else 0)
    return Heartbeat(u.flavour.autopilot, QUADROTOR, c.armed, u.custom_mode, status, base)


def system_status(u: Unit) -> Message:
    """SYS_STATUS."""
    c = u.commander
    bad = sum(SENSORS[name] for name in c.failed) | (0 if c.armable or c.armed else ARMABLE)
    voltage, current, remaining = u.battery()
    return SystemStatus(
        PRESENT, PRESENT, (PRESENT | GEOFENCE) & ~bad, voltage, current, remaining, 0.2
    )


def attitude(u: Unit) -> Attitude:
    """ATTITUDE_QUATERNION."""
    e, i = u.guidance.est, u.i
    return Attitude(u.time_boot, u.frame.attitude(e.q[i]), e.omega[i].copy())


def euler_attitude(u: Unit) -> EulerAttitude:
    """ATTITUDE."""
    exact = attitude(u)
    return EulerAttitude(exact.time, exact.q_wb, exact.omega)


def local_position(u: Unit) -> Message | None:
    """LOCAL_POSITION_NED; none without a position."""
    if not u.guidance.position_ok:
        return None
    e, i = u.guidance.est, u.i
    return LocalPosition(u.time_boot, u.frame.point(e.p[i]), u.frame.vector(e.v[i]))


def odometry(u: Unit) -> Odometry | None:
    """ODOMETRY; none without a position."""
    if not u.guidance.position_ok:
        return None
    e, a = u.guidance.est, attitude(u)
    p, v = u.frame.point(e.p[u.i]), u.frame.vector(e.v[u.i])
    return Odometry(u.time_boot, p, v, a.q_wb, a.omega)


def global_position(u: Unit) -> GlobalPosition | None:
    """GLOBAL_POSITION_INT; none without a position."""
    if not u.guidance.position_ok:
        return None
    e, i = u.guidance.est, u.i
    lat, lon, alt = u.frame.to_geo(e.p[i])
    north = math.pi / 2 - (heading(e.q[i]) - u.frame.yaw)
    return GlobalPosition(
        u.time_boot,
        lat,
        lon,
        alt,
        float(e.p[i, 2]) - u.guidance.home[2],
        u.frame.vector(e.v[i]),
        north % (2 * math.pi),
    )


def gps_raw(u: Unit) -> Message:
    """GPS_RAW_INT."""
    e, i = u.guidance.est, u.i
    lat, lon, alt = u.frame.to_geo(e.p[i])
    v = u.frame.vector(e.v[i])
    course = math.atan2(v[1], v[0])  # ENU yaw: the codec turns it into a compass course
    fix, satellites = (3, 14) if u.guidance.position_ok else (0, 0)
    return GpsRaw(u.time_boot, fix, lat, lon, alt, satellites, math.hypot(v[0], v[1]), course)


def home_position(u: Unit) -> Message:
    """HOME_POSITION."""
    home = np.array(u.guidance.home)
    return HomePosition(*u.frame.to_geo(home), u.frame.point(home))


def estimator_status(u: Unit) -> Message:
    """ESTIMATOR_STATUS."""
    flags = ESTIMATES if u.guidance.position_ok else ESTIMATES_WITHOUT_GPS
    return EstimatorStatus(u.time_boot, flags, 0.1, 0.15)


def system_time(u: Unit) -> Message:
    """SYSTEM_TIME."""
    return SystemTime(u.time_boot)


def mission_current(u: Unit) -> Message:
    """MISSION_CURRENT."""
    return MissionCurrent(u.guidance.mission_seq)


def battery_status(u: Unit) -> Message:
    """BATTERY_STATUS."""
    return BatteryStatus(*u.battery())


def autopilot_version(u: Unit) -> Message:
    """AUTOPILOT_VERSION."""
    return AutopilotVersion(u.flavour.capabilities, u.flavour.sw_version, UID + u.system)


def extended_system_state(u: Unit) -> Message:
    """EXTENDED_SYS_STATE."""
    return ExtendedSystemState(int(u.commander.landed_state))


BUILDERS: dict[int, Callable[[Unit], Message | None]] = {
    HEARTBEAT: heartbeat,
    1: system_status,
    2: system_time,
    24: gps_raw,
    30: euler_attitude,
    31: attitude,
    32: local_position,
    33: global_position,
    42: mission_current,
    147: battery_status,
    148: autopilot_version,
    230: estimator_status,
    242: home_position,
    245: extended_system_state,
    331: odometry,
}
