"""The emulated PX4: names and values as PX4 1.16 has them."""

from __future__ import annotations

from collections.abc import Mapping

from sitl_sim.vehicles.firmware.flavour import INT32, REAL32, Flavour, Loss, Mode, Settings


def _px4_settings(p: Mapping[str, float]) -> Settings:
    actions = {3: Loss.RETURN, 4: Loss.LAND, 5: Loss.HOLD}
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
        loss_action=actions.get(int(p["COM_OBL_RC_ACT"]), Loss.HOLD),
        loss_action_time=p["COM_FAIL_ACT_T"],
        disarm_landed=p["COM_DISARM_LAND"],
        disarm_preflight=p["COM_DISARM_PRFLT"],
        battery_low=p["BAT_LOW_THR"],
        battery_critical=p["BAT_CRIT_THR"],
        battery_action={2: Loss.LAND, 3: Loss.RETURN}.get(int(p["COM_LOW_BAT_ACT"]), Loss.HOLD),
        battery_compensated=bool(p["MC_BAT_SCALE_EN"]),
    )


def _px4_mode(main: int, sub: int = 0) -> int:
    return main << 16 | sub << 24


# Message id → Hz, as sent without being asked.
_COMPANION_STREAMS: dict[int, float] = {
    **{0: 1, 1: 2, 2: 1, 24: 2, 31: 50, 30: 50, 32: 50, 33: 10},
    **{147: 1, 230: 2, 242: 0.5, 245: 5},
}
_GCS_STREAMS: dict[int, float] = {
    **{0: 1, 1: 2, 24: 2, 31: 10, 30: 10, 32: 10, 33: 5},
    **{42: 1, 147: 1, 230: 1, 242: 0.5, 245: 2},
}

PX4 = Flavour(
    name="px4",
    autopilot=12,
    sw_version=0x011000FF,  # 1.16.0
    modes={
        Mode.HOLD: _px4_mode(4, 3),
        Mode.TAKEOFF: _px4_mode(4, 2),
        Mode.OFFBOARD: _px4_mode(6),
        Mode.LAND: _px4_mode(4, 6),
        Mode.RETURN: _px4_mode(4, 5),
        Mode.MISSION: _px4_mode(4, 4),
        Mode.POSITION: _px4_mode(3),
        Mode.ALTITUDE: _px4_mode(2),
        Mode.STABILIZED: _px4_mode(7),
    },
    also={
        _px4_mode(1): Mode.STABILIZED,  # manual
        _px4_mode(5): Mode.STABILIZED,  # acro: no sticks here, so it holds as well
        _px4_mode(4, 1): Mode.HOLD,  # ready
    },
    settings=_px4_settings,
    armable=frozenset(set(Mode) - {Mode.LAND, Mode.RETURN}),
    # MAV_PROTOCOL_CAPABILITY: mission float and int, command int, parameters bytewise, attitude
    # target, MAVLink 2; not files, not position targets.
    capabilities=0x1 | 0x4 | 0x8 | 0x10 | 0x40 | 0x2000,
    parameters={
        "BAT1_CAPACITY": (REAL32, 1500.0),
        "BAT1_N_CELLS": (INT32, 4),
        "BAT_CRIT_THR": (REAL32, 0.07),
        "BAT_LOW_THR": (REAL32, 0.15),
        "COM_DISARM_LAND": (REAL32, 2.0),
        "COM_DISARM_PRFLT": (REAL32, 10.0),
        "COM_FAIL_ACT_T": (REAL32, 5.0),
        "COM_LOW_BAT_ACT": (INT32, 0),
        "COM_OBL_RC_ACT": (INT32, 4),
        "COM_OF_LOSS_T": (REAL32, 1.0),
        "COM_RC_IN_MODE": (INT32, 4),
        "MAV_COMP_ID": (INT32, 1),
        "MAV_SYS_ID": (INT32, 1),
        "MAV_TYPE": (INT32, 2),
        "MC_BAT_SCALE_EN": (INT32, 1),
        "MIS_TAKEOFF_ALT": (REAL32, 2.5),
        "MPC_LAND_CRWL": (REAL32, 0.3),
        "MPC_LAND_SPEED": (REAL32, 0.7),
        "MPC_THR_HOVER": (REAL32, 0.33),
        "MPC_TKO_SPEED": (REAL32, 1.5),
        "MPC_XY_CRUISE": (REAL32, 5.0),
        "MPC_Z_VEL_MAX_DN": (REAL32, 1.5),
        "MPC_Z_VEL_MAX_UP": (REAL32, 3.0),
        "NAV_ACC_RAD": (REAL32, 2.0),
        "NAV_DLL_ACT": (INT32, 0),
        "NAV_MC_ALT_RAD": (REAL32, 0.8),
        "RTL_RETURN_ALT": (REAL32, 10.0),
        "SYS_AUTOSTART": (INT32, 4001),
        "THR_MDL_FAC": (REAL32, 1.0),
    },
    streams={"companion": _COMPANION_STREAMS, "gcs": _GCS_STREAMS},
)
