"""The emulated ArduCopter: names and values as ArduCopter 4.7 has them.

Its guided mode is our OFFBOARD: it holds until the first setpoint, and when setpoints stop for
GUID_TIMEOUT it levels with climb rate 0 and stays in guided mode. Thrust is a climb rate unless
GUID_OPTIONS has bit 3.
"""

from __future__ import annotations

from collections.abc import Mapping

from sitl_sim.vehicles.firmware.flavour import (
    INT8,
    INT16,
    INT32,
    REAL32,
    Flavour,
    Loss,
    Mode,
    Settings,
)

THRUST_AS_THRUST = 8  # bit 3 of GUID_OPTIONS
CENTI = 0.01  # its lengths and speeds are in cm
LANDED_DISARM = 0.1  # s


def _settings(p: Mapping[str, float]) -> Settings:
    actions = {1: Loss.LAND, 2: Loss.RETURN, 3: Loss.RETURN, 4: Loss.RETURN}
    capacity = max(p["BATT_CAPACITY"], 1.0)
    return Settings(
        hover=p["MOT_THST_HOVER"],
        thrust_curve=p["MOT_THST_EXPO"],
        takeoff_altitude=CENTI * p["PILOT_TKOFF_ALT"],
        takeoff_speed=CENTI * p["WPNAV_SPEED_UP"],
        land_speed=CENTI * p["LAND_SPEED"],
        crawl_speed=min(CENTI * p["LAND_SPEED"], 0.3),
        cruise_speed=CENTI * p["WPNAV_SPEED"],
        up_speed=CENTI * p["WPNAV_SPEED_UP"],
        down_speed=CENTI * p["WPNAV_SPEED_DN"],
        return_altitude=CENTI * p["RTL_ALT"],
        acceptance_radius=CENTI * p["WPNAV_RADIUS"],
        loss_time=p["GUID_TIMEOUT"],
        loss_action=Loss.LEVEL,
        loss_action_time=0.0,
        disarm_landed=LANDED_DISARM,
        disarm_preflight=p["DISARM_DELAY"],
        battery_low=p["BATT_LOW_MAH"] / capacity,
        battery_critical=p["BATT_CRT_MAH"] / capacity,
        battery_action=actions.get(int(p["BATT_FS_CRT_ACT"]), Loss.HOLD),
        battery_compensated=True,
        thrust_is_climb=not int(p["GUID_OPTIONS"]) & THRUST_AS_THRUST,
        mission_ends_in_hold=False,
    )


ARDUPILOT = Flavour(
    name="ardupilot",
    autopilot=3,
    sw_version=0x04070000,
    modes={
        Mode.STABILIZED: 0,
        Mode.ALTITUDE: 2,
        Mode.MISSION: 3,  # auto
        Mode.OFFBOARD: 4,  # guided
        Mode.POSITION: 5,  # loiter
        Mode.RETURN: 6,
        Mode.LAND: 9,
        Mode.HOLD: 17,  # brake
    },
    also={1: Mode.STABILIZED, 16: Mode.POSITION, 20: Mode.OFFBOARD, 21: Mode.RETURN},
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
    bytewise=False,
    stream_first=False,
    takeoff_mode=False,
    takeoff_above_sea=False,
    split_mode=False,
    bad_setpoint_stops=True,
    first_item_is_home=True,
    hover_name="MOT_THST_HOVER",
    system_name="MAV_SYSID",
    unsent=frozenset({193}),  # EKF_STATUS_REPORT: MAVSDK asks for it with its health
    arm_refusal=4,
    arm_prefix="Arm",
    # Mission float and int, parameters by value, command int, attitude target, MAVLink 2.
    capabilities=0x1 | 0x2 | 0x4 | 0x8 | 0x40 | 0x2000 | 0x20000,
    streams={"companion": {0: 1}, "gcs": {0: 1}},  # nothing else until asked
)
