"""Telemetry: how each message is made from a vehicle's estimate."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from mavlink_bridge.shared.frames import euler_from_quaternion
from mavlink_bridge.wire.ids import (
    DistanceSensorType,
    EstimatorType,
    GpsFix,
    MessageId,
    ModeFlag,
    SensorRotation,
    SystemState,
    VehicleType,
)
from mavlink_bridge.wire.messages import (
    Attitude,
    AttitudeTarget,
    AutopilotVersion,
    BatteryStatus,
    DistanceSensor,
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
from sitl_sim.vehicles.rangefinder import RANGE_MAX, RANGE_MIN, range_sigma

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
ABSOLUTE = int(EstimatorFlag.POS_HORIZ_ABS | EstimatorFlag.PRED_POS_HORIZ_ABS)
UNKNOWN_DOP = 655.35  # eph and epv of GPS_RAW_INT without a fix
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
    s = u.sample()
    return Attitude(s.time, u.frame.attitude(s.q), s.omega.copy())


def euler_attitude(u: Unit) -> EulerAttitude:
    """Make ATTITUDE."""
    exact = attitude(u)
    return EulerAttitude(exact.time, exact.q_wb, exact.omega)


def attitude_target(u: Unit) -> AttitudeTarget:
    """Make ATTITUDE_TARGET: rates and thrust that the inner loop follows; attitude as it is."""
    sp, q = u.guidance.sp, u.frame.attitude(u.sample().q)
    thrust = float(sp.thrust[u.i]) if u.commander.armed else 0.0
    return AttitudeTarget(u.time_boot, q, sp.omega[u.i].copy(), thrust)


def local_position(u: Unit) -> Message | None:
    """Make LOCAL_POSITION_NED; none without a position."""
    if not u.guidance.position_ok:
        return None
    s = u.sample()
    return LocalPosition(s.time, u.frame.point(s.p), u.frame.vector(s.v))


def odometry(u: Unit) -> Odometry | None:
    """Make ODOMETRY; none without a position."""
    if not u.guidance.position_ok:
        return None
    s, i = u.sample(), u.i
    return Odometry(
        s.time,
        u.frame.point(s.p),
        u.frame.vector(s.v),
        u.frame.attitude(s.q),
        s.omega.copy(),
        position_sigma=u.errors.position_sigma[i].copy(),
        velocity_sigma=u.errors.velocity_sigma[i].copy(),
        attitude_sigma=u.errors.attitude_sigma[i].copy(),
        resets=int(u.errors.resets[i]) & 0xFF,
        estimator=EstimatorType.AUTOPILOT,
        quality=100,
    )


def global_position(u: Unit) -> GlobalPosition | None:
    """Make GLOBAL_POSITION_INT; none without a position."""
    if not u.guidance.position_ok:
        return None
    s = u.sample()
    lat, lon, alt = u.frame.to_geo(s.p)
    _, _, yaw = euler_from_quaternion(s.q)
    north = math.pi / 2 - (yaw - u.frame.yaw)
    return GlobalPosition(
        s.time,
        lat,
        lon,
        alt,
        float(s.p[2]) - u.guidance.home[2],
        u.frame.vector(s.v),
        north % (2 * math.pi),
    )


def gps_raw(u: Unit) -> Message:
    """Make GPS_RAW_INT."""
    s, e, i = u.sample(), u.errors, u.i
    lat, lon, alt = u.frame.to_geo(s.p)
    v = u.frame.vector(s.v)
    course = math.atan2(v[1], v[0])  # ENU yaw: the codec turns it into a compass course
    ok = u.guidance.position_ok
    fix, satellites = (e.fix(i), u.grade.satellites) if ok else (GpsFix.NO_GPS, 0)
    speed, known = math.hypot(v[0], v[1]), fix >= GpsFix.FIX_3D
    return GpsRaw(
        s.time,
        fix,
        lat,
        lon,
        alt,
        satellites,
        speed,
        course,
        *((0.8, 1.2) if known else (UNKNOWN_DOP, UNKNOWN_DOP)),
        float(e.position_sigma[i, 0]) if known else 0.0,
        float(e.position_sigma[i, 2]) if known else 0.0,
        float(e.velocity_sigma[i, 0]) if known else 0.0,
    )


def distance_sensor(u: Unit) -> Message | None:
    """Make DISTANCE_SENSOR, looking down; none where the airframe has no rangefinder."""
    if not u.rangefinder:
        return None
    s = u.sample()
    distance = u.measured_range(s)
    echo = math.isfinite(distance)
    return DistanceSensor(
        s.time,
        min(max(distance, RANGE_MIN), RANGE_MAX),
        RANGE_MIN,
        RANGE_MAX,
        SensorRotation.DOWN,
        DistanceSensorType.LASER,
        range_sigma(distance) if echo else 0.0,
        100 if echo else 1,
    )


def home_position(u: Unit) -> Message:
    """Make HOME_POSITION."""
    home = np.array(u.guidance.home)
    return HomePosition(*u.frame.to_geo(home), u.frame.point(home))


def estimator_status(u: Unit) -> Message:
    """Make ESTIMATOR_STATUS."""
    flags, e, i = ESTIMATES, u.errors, u.i
    if not u.guidance.position_ok:
        flags = ESTIMATES_WITHOUT_GPS
    elif not u.grade.absolute:
        flags = ESTIMATES & ~ABSOLUTE
    return EstimatorStatus(
        u.time_boot,
        flags,
        float(e.position_sigma[i, 0]),
        float(e.position_sigma[i, 2]),
        horizontal_ratio=float(e.horizontal_ratio[i]),
        magnetometer_ratio=float(e.heading_ratio[i]),
    )


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
    MessageId.ATTITUDE_TARGET: attitude_target,
    MessageId.LOCAL_POSITION_NED: local_position,
    MessageId.GLOBAL_POSITION_INT: global_position,
    MessageId.MISSION_CURRENT: mission_current,
    MessageId.BATTERY_STATUS: battery_status,
    MessageId.AUTOPILOT_VERSION: autopilot_version,
    MessageId.ESTIMATOR_STATUS: estimator_status,
    MessageId.HOME_POSITION: home_position,
    MessageId.EXTENDED_SYS_STATE: extended_system_state,
    MessageId.ODOMETRY: odometry,
    MessageId.DISTANCE_SENSOR: distance_sensor,
}
