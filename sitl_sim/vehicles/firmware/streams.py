"""Telemetry: how each message is made from a vehicle's estimate."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from mavlink_bridge.shared.frames import euler_from_quaternion
from mavlink_bridge.wire.ids import GpsFix, MessageId, ModeFlag, SystemState, VehicleType
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
    Ping,
    SystemStatus,
    SystemTime,
    TimeSync,
)
from sitl_sim.vehicles.firmware.flavour import Mode
from sitl_sim.vehicles.firmware.ids import EstimatorFlag, Sensor
from sitl_sim.vehicles.firmware.unit import Unit

SENSORS = {
    "gyro": int(Sensor.GYRO),
    "accelerometer": int(Sensor.ACCEL),
    "magnetometer": int(Sensor.MAG),
    "gps": int(Sensor.GPS),
}
ARMABLE = int(Sensor.PREARM_CHECK)
PRESENT = int(
    Sensor.GYRO
    | Sensor.ACCEL
    | Sensor.MAG
    | Sensor.ABSOLUTE_PRESSURE
    | Sensor.GPS
    | Sensor.ANGULAR_RATE_CONTROL
    | Sensor.ATTITUDE_STABILIZATION
    | Sensor.YAW_POSITION
    | Sensor.Z_ALTITUDE_CONTROL
    | Sensor.XY_POSITION_CONTROL
    | Sensor.MOTOR_OUTPUTS
    | Sensor.AHRS
    | Sensor.BATTERY
    | Sensor.PREARM_CHECK
)
# A geofence is not present, but never breached either: MAVProxy would report a breach.
HEALTHY = PRESENT | int(Sensor.GEOFENCE)
# No dead reckoning; without GPS neither horizontal velocity nor position.
ESTIMATES = int(
    EstimatorFlag.ATTITUDE
    | EstimatorFlag.VELOCITY_HORIZ
    | EstimatorFlag.VELOCITY_VERT
    | EstimatorFlag.POS_HORIZ_REL
    | EstimatorFlag.POS_HORIZ_ABS
    | EstimatorFlag.POS_VERT_ABS
    | EstimatorFlag.PRED_POS_HORIZ_REL
    | EstimatorFlag.PRED_POS_HORIZ_ABS
)
ESTIMATES_WITHOUT_GPS = int(
    EstimatorFlag.ATTITUDE | EstimatorFlag.VELOCITY_VERT | EstimatorFlag.POS_VERT_ABS
)
ALWAYS = int(ModeFlag.CUSTOM_MODE_ENABLED | ModeFlag.STABILIZE_ENABLED)
PILOTED = int(ModeFlag.MANUAL_INPUT_ENABLED)
AUTOMATIC = int(ModeFlag.GUIDED_ENABLED | ModeFlag.AUTO_ENABLED)
ARMED = int(ModeFlag.SAFETY_ARMED)
GPS_DATE = 1_767_225_600.0  # s, 1 January 2026, Unix time
UID = 0x5157_0000  # plus the system id


def heartbeat(u: Unit) -> Message:
    """Make HEARTBEAT."""
    c = u.commander
    flying = c.armed and not c.landed
    if c.failsafe:
        status = SystemState.CRITICAL
    elif not c.armed and not c.armable and u.flavour.reports_events:
        status = SystemState.UNINIT
    else:
        status = SystemState.ACTIVE if flying else SystemState.STANDBY
    piloted = c.mode in (Mode.POSITION, Mode.ALTITUDE, Mode.STABILIZED)
    base = ALWAYS | (PILOTED if piloted else AUTOMATIC) | (ARMED if c.armed else 0)
    kind = VehicleType.QUADROTOR
    return Heartbeat(u.flavour.autopilot, kind, c.armed, u.custom_mode, status, base)


def system_status(u: Unit) -> Message:
    """Make SYS_STATUS."""
    c = u.commander
    bad = sum(SENSORS[name] for name in c.failed) | (0 if c.armable or c.armed else ARMABLE)
    voltage, current, remaining = _battery(u)
    return SystemStatus(PRESENT, PRESENT, HEALTHY & ~bad, voltage, current, remaining, 0.2)


def attitude(u: Unit) -> Attitude:
    """Make ATTITUDE_QUATERNION."""
    e, i = u.guidance.est, u.i
    return Attitude(u.time_boot, u.frame.attitude(e.q[i]), e.omega[i].copy())


def euler_attitude(u: Unit) -> EulerAttitude:
    """Make ATTITUDE."""
    exact = attitude(u)
    return EulerAttitude(exact.time, exact.q_wb, exact.omega)


def local_position(u: Unit) -> Message | None:
    """Make LOCAL_POSITION_NED; none without a position."""
    if not u.guidance.position_ok:
        return None
    e, i = u.guidance.est, u.i
    return LocalPosition(u.time_boot, u.frame.point(e.p[i]), u.frame.vector(e.v[i]))


def odometry(u: Unit) -> Odometry | None:
    """Make ODOMETRY; none without a position."""
    if not u.guidance.position_ok:
        return None
    e, a = u.guidance.est, attitude(u)
    p, v = u.frame.point(e.p[u.i]), u.frame.vector(e.v[u.i])
    return Odometry(u.time_boot, p, v, a.q_wb, a.omega)


def global_position(u: Unit) -> GlobalPosition | None:
    """Make GLOBAL_POSITION_INT; none without a position."""
    if not u.guidance.position_ok:
        return None
    e, i = u.guidance.est, u.i
    lat, lon, alt = u.frame.to_geo(e.p[i])
    _, _, yaw = euler_from_quaternion(e.q[i])
    north = math.pi / 2 - (yaw - u.frame.yaw)
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
    """Make GPS_RAW_INT."""
    e, i = u.guidance.est, u.i
    lat, lon, alt = u.frame.to_geo(e.p[i])
    v = u.frame.vector(e.v[i])
    course = math.atan2(v[1], v[0])  # ENU yaw: the codec turns it into a compass course
    ok = u.guidance.position_ok
    fix, satellites = (GpsFix.FIX_3D, 14) if ok else (GpsFix.NO_GPS, 0)
    return GpsRaw(u.time_boot, fix, lat, lon, alt, satellites, math.hypot(v[0], v[1]), course)


def home_position(u: Unit) -> Message:
    """Make HOME_POSITION."""
    home = np.array(u.guidance.home)
    return HomePosition(*u.frame.to_geo(home), u.frame.point(home))


def estimator_status(u: Unit) -> Message:
    """Make ESTIMATOR_STATUS."""
    flags = ESTIMATES if u.guidance.position_ok else ESTIMATES_WITHOUT_GPS
    return EstimatorStatus(u.time_boot, flags, 0.1, 0.15)


def system_time(u: Unit) -> Message:
    """Make SYSTEM_TIME; the date is that of the emulated GPS, the same in every flight."""
    date = GPS_DATE + u.now_us * 1e-6 if u.guidance.position_ok else 0.0
    return SystemTime(u.time_boot, date)


def mission_current(u: Unit) -> Message:
    """Make MISSION_CURRENT."""
    return MissionCurrent(u.guidance.mission_seq)


def battery_status(u: Unit) -> Message:
    """Make BATTERY_STATUS."""
    return BatteryStatus(*_battery(u))


def _battery(u: Unit) -> tuple[float, float, float]:
    """Return voltage [V], current [A] and remaining 0…1 as told; -1 A: not measured (PX4)."""
    voltage, current, remaining = u.battery()
    return voltage, current if u.flavour.current_known else -1.0, remaining


def ping(u: Unit) -> Message:
    """Make PING, which asks for an answer."""
    u.pings += 1
    return Ping(u.time_boot, u.pings)


def time_sync(u: Unit) -> Message:
    """Make TIMESYNC, which asks for an answer."""
    return TimeSync(0, u.boot_ns)


def autopilot_version(u: Unit) -> Message:
    """Make AUTOPILOT_VERSION."""
    return AutopilotVersion(u.flavour.capabilities, u.flavour.sw_version, UID + u.system)


def extended_system_state(u: Unit) -> Message:
    """Make EXTENDED_SYS_STATE."""
    return ExtendedSystemState(int(u.commander.landed_state))


BUILDERS: dict[int, Callable[[Unit], Message | None]] = {
    MessageId.HEARTBEAT: heartbeat,
    MessageId.SYS_STATUS: system_status,
    MessageId.SYSTEM_TIME: system_time,
    MessageId.PING: ping,
    MessageId.TIMESYNC: time_sync,
    MessageId.GPS_RAW_INT: gps_raw,
    MessageId.ATTITUDE: euler_attitude,
    MessageId.ATTITUDE_QUATERNION: attitude,
    MessageId.LOCAL_POSITION_NED: local_position,
    MessageId.GLOBAL_POSITION_INT: global_position,
    MessageId.MISSION_CURRENT: mission_current,
    MessageId.BATTERY_STATUS: battery_status,
    MessageId.AUTOPILOT_VERSION: autopilot_version,
    MessageId.ESTIMATOR_STATUS: estimator_status,
    MessageId.HOME_POSITION: home_position,
    MessageId.EXTENDED_SYS_STATE: extended_system_state,
    MessageId.ODOMETRY: odometry,
}
