"""What differs between the emulated autopilots: modes, parameters, rules. Data only."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto

from sitl_sim.vehicle import Airframe


class Mode(Enum):
    """What a vehicle does, whatever its autopilot calls it."""

    HOLD = auto()
    TAKEOFF = auto()
    OFFBOARD = auto()
    LAND = auto()
    RETURN = auto()
    MISSION = auto()
    POSITION = auto()
    ALTITUDE = auto()
    STABILIZED = auto()


INT8, INT16, INT32, REAL32 = 2, 4, 6, 9  # MAV_PARAM_TYPE


class Loss(Enum):
    """What follows when the setpoints stop."""

    LAND = auto()
    RETURN = auto()
    HOLD = auto()
    LEVEL = auto()  # stays in offboard, level, climb rate 0 (ArduPilot's guided mode)


@dataclass(frozen=True)
class Settings:
    """A flavour's parameters as the commander understands them; SI."""

    hover: float
    thrust_curve: float
    takeoff_altitude: float
    takeoff_speed: float
    land_speed: float
    crawl_speed: float
    cruise_speed: float
    up_speed: float
    down_speed: float
    return_altitude: float
    acceptance_radius: float
    loss_time: float
    loss_action: Loss
    loss_action_time: float
    disarm_landed: float
    disarm_preflight: float
    battery_low: float
    battery_critical: float
    battery_action: Loss
    battery_compensated: bool
    thrust_is_climb: bool = False


@dataclass(frozen=True)
class Flavour:
    """One autopilot's ways.

    autopilot: MAV_AUTOPILOT. modes: custom_mode of each mode. also: further custom_mode values
    that it accepts, and what they fly as. parameters: name → (type, value). settings: what
    they mean. bytewise: INT32 as bits in the float. armable: modes in which it arms.
    stream_first: offboard wants setpoints before it is entered. takeoff_mode: taking off is a
    mode of its own. takeoff_above_sea: its altitude counts from the sea. split_mode:
    DO_SET_MODE has main and sub mode apart. first_item_is_home: of a mission. arm_refusal: the
    MAV_RESULT. streams: default streams per link, message id → Hz.
    """

    name: str
    autopilot: int
    sw_version: int
    modes: Mapping[Mode, int]
    parameters: Mapping[str, tuple[int, float]]
    settings: Callable[[Mapping[str, float]], Settings]
    armable: frozenset[Mode]
    also: Mapping[int, Mode] = field(default_factory=dict)
    bytewise: bool = True
    stream_first: bool = True
    takeoff_mode: bool = True
    takeoff_above_sea: bool = True
    split_mode: bool = True
    takes_setpoints: bool = True
    missions: bool = True
    first_item_is_home: bool = False
    commands: frozenset[int] = frozenset({20, 21, 22, 176, 300, 400, 511, 512, 520})
    hover_name: str = "MPC_THR_HOVER"
    system_name: str = "MAV_SYS_ID"
    arm_refusal: int = 1
    arm_prefix: str = "Arming denied"
    capabilities: int = 0
    streams: Mapping[str, Mapping[int, float]] = field(default_factory=dict)

    def mode_of(self, custom_mode: int) -> Mode | None:
        """The mode of this custom_mode; None where there is none."""
        for mode, value in self.modes.items():
            if value == custom_mode:
                return mode
        return self.also.get(custom_mode)

    def defaults_for(self, airframe: Airframe, system: int) -> dict[str, float]:
        """Parameters that follow from the vehicle: hover thrust and system id."""
        return {self.hover_name: round(airframe.hover_thrust, 3), self.system_name: float(system)}


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
    **{0: 1, 1: 2, 2: 1, 24: 2, 31: 50, 32: 50, 33: 10},
    **{147: 1, 230: 2, 242: 0.5, 245: 5},
}
_GCS_STREAMS: dict[int, float] = {
    **{0: 1, 1: 2, 24: 2, 30: 10, 32: 10, 33: 5},
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

FLAVOURS: dict[str, Flavour] = {"px4": PX4}


def flavour_of(name: str) -> Flavour:
    """The flavour of this name, or an error that lists the choices."""
    if name not in FLAVOURS:
        raise ValueError(f"unknown autopilot {name!r}: choose one of {', '.join(FLAVOURS)}")
    return FLAVOURS[name]
