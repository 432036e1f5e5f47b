"""The emulated PX4: names, values and manners as in PX4 1.17."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import IntEnum

from mavlink_bridge.wire.ids import AutopilotId, MessageId, ParameterType
from sitl_sim.vehicles.firmware.flavour import FailsafeAction, Flavour, Mode, Settings

INT32, REAL32 = ParameterType.INT32, ParameterType.REAL32


class MainMode(IntEnum):
    """PX4's main modes (px4_custom_mode.h)."""

    MANUAL = 1
    ALTCTL = 2
    POSCTL = 3
    AUTO = 4
    ACRO = 5
    OFFBOARD = 6
    STABILIZED = 7


class AutoMode(IntEnum):
    """Sub-modes of MainMode.AUTO (px4_custom_mode.h)."""

    READY = 1
    TAKEOFF = 2
    LOITER = 3
    MISSION = 4
    RTL = 5
    LAND = 6


def _px4_settings(p: Mapping[str, float]) -> Settings:
    land, home, hold = FailsafeAction.LAND, FailsafeAction.RETURN, FailsafeAction.HOLD
    # 0 to 2 give the vehicle to a pilot's sticks; without any it returns.
    on_loss = {0: home, 1: home, 2: home, 3: home, 4: land, 5: hold}
    on_empty = {2: land, 3: home}
    return Settings(
        hover=p["MPC_THR_HOVER"],
        thrust_curve=p["THR_MDL_FAC"],
        takeoff_altitude=p["MIS_TAKEOFF_ALT"],
        takeoff_speed=p["MPC_TKO_SPEED"],
        land_speed=p["MPC_LAND_SPEED"],
        crawl_speed=p["MPC_LAND_CRWL"],
        cruise_speed=p["MPC_XY_CRUISE"],
        up_speed=p["MPC_Z_VEL_MAX_UP"],
        down_speed=p["MPC_Z_VEL_MAX_DN"],
        return_altitude=p["RTL_RETURN_ALT"],
        acceptance_radius=p["NAV_ACC_RAD"],
        loss_time=p["COM_OF_LOSS_T"],
        loss_action=on_loss.get(int(p["COM_OBL_RC_ACT"]), hold),
        disarm_landed=p["COM_DISARM_LAND"],
        disarm_preflight=p["COM_DISARM_PRFLT"],
        battery_low=p["BAT_LOW_THR"],
        battery_critical=p["BAT_CRIT_THR"],
        battery_action=on_empty.get(int(p["COM_LOW_BAT_ACT"]), hold),
        battery_compensated=bool(p["MC_BAT_SCALE_EN"]),
        return_cone=math.radians(p["RTL_CONE_ANG"]),
        spool_up=p["COM_SPOOLUP_TIME"],
        takeoff_ramp=p["MPC_TKO_RAMP_T"],
        yaw_rate_max=math.radians(p["MC_YAWRATE_MAX"]),
    )


def _custom_mode(main: MainMode, sub: AutoMode | None = None) -> int:
    return main << 16 | (sub or 0) << 24


def _auto(sub: AutoMode) -> int:
    return _custom_mode(MainMode.AUTO, sub)


# Message id → Hz, as sent without a request by the mode "onboard", and to ground stations.
_COMPANION_STREAMS: dict[int, float] = {
    MessageId.HEARTBEAT: 1,
    MessageId.SYS_STATUS: 5,
    MessageId.SYSTEM_TIME: 1,
    MessageId.PING: 1,
    MessageId.GPS_RAW_INT: 8,
    MessageId.ATTITUDE: 100,
    MessageId.ATTITUDE_TARGET: 10,
    MessageId.ATTITUDE_QUATERNION: 50,
    MessageId.LOCAL_POSITION_NED: 30,
    MessageId.GLOBAL_POSITION_INT: 50,
    MessageId.MISSION_CURRENT: 1,
    MessageId.TIMESYNC: 10,
    MessageId.BATTERY_STATUS: 0.5,
    MessageId.ESTIMATOR_STATUS: 1,
    MessageId.HOME_POSITION: 0.5,
    MessageId.EXTENDED_SYS_STATE: 5,
    MessageId.ODOMETRY: 30,
}
# As on PX4's onboard link.
_DOUBT_STREAMS: dict[int, float] = {
    MessageId.ODOMETRY: 30,
    MessageId.DISTANCE_SENSOR: 10,
    MessageId.ESTIMATOR_STATUS: 5,
    MessageId.GPS_RAW_INT: 5,
}
_GCS_STREAMS: dict[int, float] = {
    MessageId.HEARTBEAT: 1,
    MessageId.SYS_STATUS: 1,
    MessageId.PING: 0.1,
    MessageId.GPS_RAW_INT: 5,
    MessageId.ATTITUDE: 15,
    MessageId.ATTITUDE_QUATERNION: 10,
    MessageId.ATTITUDE_TARGET: 2,
    MessageId.LOCAL_POSITION_NED: 1,
    MessageId.GLOBAL_POSITION_INT: 5,
    MessageId.MISSION_CURRENT: 1,
    MessageId.BATTERY_STATUS: 0.5,
    MessageId.ESTIMATOR_STATUS: 0.5,
    MessageId.HOME_POSITION: 0.5,
    MessageId.EXTENDED_SYS_STATE: 1,
}

PX4 = Flavour(
    name="px4",
    autopilot=AutopilotId.PX4,
    sw_version=0x011100FF,  # 1.17.0
    modes={
        Mode.HOLD: _auto(AutoMode.LOITER),
        Mode.TAKEOFF: _auto(AutoMode.TAKEOFF),
        Mode.OFFBOARD: _custom_mode(MainMode.OFFBOARD),
        Mode.LAND: _auto(AutoMode.LAND),
        Mode.RETURN: _auto(AutoMode.RTL),
        Mode.MISSION: _auto(AutoMode.MISSION),
        Mode.POSITION: _custom_mode(MainMode.POSCTL),
        Mode.ALTITUDE: _custom_mode(MainMode.ALTCTL),
        Mode.STABILIZED: _custom_mode(MainMode.STABILIZED),
    },
    mode_aliases={
        _custom_mode(MainMode.MANUAL): Mode.STABILIZED,
        _custom_mode(MainMode.ACRO): Mode.STABILIZED,  # there are no sticks, so it holds as well
        _auto(AutoMode.READY): Mode.HOLD,
    },
    settings=_px4_settings,
    armable=frozenset(set(Mode) - {Mode.LAND, Mode.RETURN}),
    fresh_only=frozenset(
        {
            MessageId.GPS_RAW_INT,
            MessageId.ATTITUDE_QUATERNION,
            MessageId.LOCAL_POSITION_NED,
            MessageId.GLOBAL_POSITION_INT,
            MessageId.MISSION_CURRENT,
            MessageId.ODOMETRY,
        }
    ),
    unsent=frozenset({MessageId.HIGHRES_IMU}),
    capabilities=0xE8FF,
    parameters={
        "BAT1_CAPACITY": (REAL32, 1500.0),
        "BAT1_N_CELLS": (INT32, 4),
        "BAT_CRIT_THR": (REAL32, 0.07),
        "BAT_LOW_THR": (REAL32, 0.15),
        "COM_DISARM_LAND": (REAL32, 2.0),
        "COM_DISARM_PRFLT": (REAL32, 10.0),
        "COM_FAIL_ACT_T": (REAL32, 5.0),
        "COM_LOW_BAT_ACT": (INT32, 0),
        "COM_OBL_RC_ACT": (INT32, 0),
        "COM_OF_LOSS_T": (REAL32, 1.0),
        "COM_RC_IN_MODE": (INT32, 1),
        "COM_SPOOLUP_TIME": (REAL32, 1.0),
        "MAV_COMP_ID": (INT32, 1),
        "MAV_SYS_ID": (INT32, 1),
        "MAV_TYPE": (INT32, 2),
        "MC_BAT_SCALE_EN": (INT32, 1),
        "MC_YAWRATE_MAX": (REAL32, 200.0),
        "MIS_TAKEOFF_ALT": (REAL32, 2.5),
        "MPC_LAND_CRWL": (REAL32, 0.3),
        "MPC_LAND_SPEED": (REAL32, 0.7),
        "MPC_THR_HOVER": (REAL32, 0.33),
        "MPC_TKO_RAMP_T": (REAL32, 3.0),
        "MPC_TKO_SPEED": (REAL32, 1.5),
        "MPC_XY_CRUISE": (REAL32, 5.0),
        "MPC_Z_VEL_MAX_DN": (REAL32, 1.5),
        "MPC_Z_VEL_MAX_UP": (REAL32, 3.0),
        "NAV_ACC_RAD": (REAL32, 2.0),
        "NAV_DLL_ACT": (INT32, 0),
        "NAV_MC_ALT_RAD": (REAL32, 0.8),
        "RTL_CONE_ANG": (INT32, 45),
        "RTL_RETURN_ALT": (REAL32, 30.0),
        "SYS_AUTOSTART": (INT32, 4001),
        "THR_MDL_FAC": (REAL32, 1.0),
    },
    streams={"companion": _COMPANION_STREAMS, "gcs": _GCS_STREAMS},
    doubt_streams=_DOUBT_STREAMS,
)
