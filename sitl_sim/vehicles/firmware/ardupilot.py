"""The emulated ArduCopter: names and values as in ArduCopter 4.7.

Its guided mode is `Mode.OFFBOARD` here: it holds until the first setpoint, and when setpoints
stop for GUID_TIMEOUT it levels with climb rate 0 and stays in guided mode. Thrust is a climb rate
unless GUID_OPTIONS has bit 3.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum

from mavlink_bridge.wire.ids import AutopilotId, Capability, CommandId, MessageId, ParameterType
from mavlink_bridge.wire.messages import CommandResult
from sitl_sim.vehicles.firmware.flavour import FailsafeAction, Flavour, Mode, Settings

INT8, INT16, INT32, REAL32 = (
    ParameterType.INT8,
    ParameterType.INT16,
    ParameterType.INT32,
    ParameterType.REAL32,
)

THRUST_AS_THRUST = 8  # bit 3 of GUID_OPTIONS
CENTI = 0.01  # its lengths and speeds are in cm
LANDED_DISARM = 0.1  # s
ARMING_DELAY = 2.0  # s for which the motors stand still once armed
TAKEOFF_RAMP = 1.0  # s; measured: 2 m up 2.7 s after the request, 3.9 s after arming


class CopterMode(IntEnum):
    """ArduCopter's custom modes (ArduCopter/mode.h)."""

    STABILIZE = 0
    ACRO = 1
    ALT_HOLD = 2
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9
    POSHOLD = 16
    BRAKE = 17
    GUIDED_NOGPS = 20
    SMART_RTL = 21


def _settings(p: Mapping[str, float]) -> Settings:
    land, home = FailsafeAction.LAND, FailsafeAction.RETURN
    actions = {1: land, 2: home, 3: home, 4: home}
    capacity = max(p["BATT_CAPACITY"], 1.0)
    return Settings(
        hover=p["MOT_THST_HOVER"],
        thrust_curve=p["MOT_THST_EXPO"],
        takeoff_altitude=CENTI * p["PILOT_TKOFF_ALT"],
        takeoff_speed=CENTI * p["WPNAV_SPEED_UP"],
        spool_up=ARMING_DELAY,
        takeoff_ramp=TAKEOFF_RAMP,
        land_speed=CENTI * p["LAND_SPEED"],
        crawl_speed=min(CENTI * p["LAND_SPEED"], 0.3),
        cruise_speed=CENTI * p["WPNAV_SPEED"],
        up_speed=CENTI * p["WPNAV_SPEED_UP"],
        down_speed=CENTI * p["WPNAV_SPEED_DN"],
        return_altitude=CENTI * p["RTL_ALT"],
        acceptance_radius=CENTI * p["WPNAV_RADIUS"],
        loss_time=p["GUID_TIMEOUT"],
        loss_action=FailsafeAction.LEVEL,
        disarm_landed=LANDED_DISARM,
        disarm_preflight=p["DISARM_DELAY"],
        battery_low=p["BATT_LOW_MAH"] / capacity,
        battery_critical=p["BATT_CRT_MAH"] / capacity,
        battery_action=actions.get(int(p["BATT_FS_CRT_ACT"]), FailsafeAction.HOLD),
        battery_compensated=True,
        thrust_is_climb=not int(p["GUID_OPTIONS"]) & THRUST_AS_THRUST,
        mission_ends_in_hold=False,
    )


ARDUPILOT = Flavour(
    name="ardupilot",
    autopilot=AutopilotId.ARDUPILOTMEGA,
    sw_version=0x04070000,
    modes={
        Mode.STABILIZED: CopterMode.STABILIZE,
        Mode.ALTITUDE: CopterMode.ALT_HOLD,
        Mode.MISSION: CopterMode.AUTO,
        Mode.OFFBOARD: CopterMode.GUIDED,
        Mode.POSITION: CopterMode.LOITER,
        Mode.RETURN: CopterMode.RTL,
        Mode.LAND: CopterMode.LAND,
        Mode.HOLD: CopterMode.BRAKE,
    },
    mode_aliases={
        CopterMode.ACRO: Mode.STABILIZED,
        CopterMode.POSHOLD: Mode.POSITION,
        CopterMode.GUIDED_NOGPS: Mode.OFFBOARD,
        CopterMode.SMART_RTL: Mode.RETURN,
    },
    initial=Mode.STABILIZED,
    parameters={
        "ARMING_CHECK": (INT32, 1),
        "BATT_CAPACITY": (INT32, 1500),
        "BATT_CRT_MAH": (REAL32, 105.0),
        "BATT_FS_CRT_ACT": (INT8, 0),
        "BATT_LOW_MAH": (REAL32, 225.0),
        "DISARM_DELAY": (INT8, 10),
        "FRAME_CLASS": (INT8, 1),
        "FRAME_TYPE": (INT8, 1),
        "FS_GCS_ENABLE": (INT8, 0),
        "FS_OPTIONS": (INT32, 16),
        "GUID_OPTIONS": (INT32, 0),
        "GUID_TIMEOUT": (REAL32, 3.0),
        "LAND_SPEED": (INT16, 50),
        "MAV_SYSID": (INT16, 1),
        "MOT_THST_EXPO": (REAL32, 1.0),
        "MOT_THST_HOVER": (REAL32, 0.33),
        "PILOT_TKOFF_ALT": (REAL32, 250.0),
        "RTL_ALT": (INT32, 1500),
        "WPNAV_RADIUS": (REAL32, 200.0),
        "WPNAV_SPEED": (REAL32, 500.0),
        "WPNAV_SPEED_DN": (REAL32, 150.0),
        "WPNAV_SPEED_UP": (REAL32, 250.0),
    },
    settings=_settings,
    armable=frozenset({Mode.STABILIZED, Mode.ALTITUDE, Mode.OFFBOARD, Mode.POSITION}),
    strict_parameters=False,
    stream_first=False,
    takeoff_mode=False,
    takeoff_above_sea=False,
    split_mode=False,
    global_frame_only=False,
    reports_events=False,
    texts_need_ground=False,
    current_known=True,
    bad_setpoint_stops=True,
    first_item_is_home=True,
    hover_name="MOT_THST_HOVER",
    system_name="MAV_SYSID",
    unsent=frozenset({MessageId.EKF_STATUS_REPORT}),  # MAVSDK requests it with its health
    # The SITL ends with a floating point exception; the emulated one goes on, and does not answer.
    nan_ends=frozenset(
        {CommandId.NAV_TAKEOFF, CommandId.COMPONENT_ARM_DISARM, CommandId.REQUEST_MESSAGE}
    ),
    lacks=frozenset(
        {MessageId.ODOMETRY, MessageId.ESTIMATOR_STATUS, MessageId.TIMESYNC, MessageId.PING}
    ),
    answers_pings=False,
    stands_in=True,
    arm_unknown=CommandResult.UNSUPPORTED,
    armed_words="Arming motors",
    mode_words={Mode.HOLD: "BRAKE", Mode.RETURN: "RTL", Mode.MISSION: "AUTO"},
    arm_refusal=CommandResult.FAILED,
    arm_prefix="Arm",
    capabilities=int(
        Capability.MISSION_FLOAT
        | Capability.MISSION_INT
        | Capability.COMMAND_INT
        | Capability.PARAM_FLOAT
        | Capability.PARAM_ENCODE_C_CAST
        | Capability.SET_ATTITUDE_TARGET
        | Capability.MAVLINK2
    ),
    # Nothing else until it is requested.
    streams={"companion": {MessageId.HEARTBEAT: 1}, "gcs": {MessageId.HEARTBEAT: 1}},
)
