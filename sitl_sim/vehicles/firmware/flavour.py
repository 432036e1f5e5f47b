"""What differs between the emulated autopilots: modes, parameters, rules."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto

from mavlink_bridge.wire.messages import CommandResult
from sitl_sim.vehicles.airframe import Airframe


class Mode(Enum):
    """What a vehicle does, by one name for all autopilots."""

    HOLD = auto()
    TAKEOFF = auto()
    OFFBOARD = auto()
    LAND = auto()
    RETURN = auto()
    MISSION = auto()
    POSITION = auto()
    ALTITUDE = auto()
    STABILIZED = auto()


class FailsafeAction(Enum):
    """What an autopilot does when setpoints stop, or its battery is empty."""

    LAND = auto()
    RETURN = auto()
    HOLD = auto()
    LEVEL = auto()  # stay in offboard, level, climb rate 0 (ArduPilot's guided mode)


@dataclass(frozen=True)
class Settings:
    """A flavour's parameters as the commander takes them; SI."""

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
    loss_action: FailsafeAction
    disarm_landed: float
    disarm_preflight: float
    battery_low: float
    battery_critical: float
    battery_action: FailsafeAction
    battery_compensated: bool
    return_cone: float = 0.0  # rad, half-angle above home in which a return climbs less; 0: none
    spool_up: float = 0.0  # s from arming until the motors may lift
    takeoff_ramp: float = 0.0  # s in which a take-off reaches its speed
    yaw_rate_max: float = math.inf
    thrust_is_climb: bool = False
    mission_ends_in_hold: bool = True


@dataclass(frozen=True)
class Flavour:
    """The behaviour of one autopilot.

    autopilot: MAV_AUTOPILOT. modes: custom_mode of each mode. mode_aliases: further custom_mode
    values that it accepts, and the modes that they fly as. parameters: name → (MAV_PARAM_TYPE,
    value). settings: from parameter values. strict_parameters: INT32 goes as bits in the float, a
    wrong type or name is answered with PARAM_ERROR, and a list ends with _HASH_CHECK. armable:
    modes in which it arms. initial: the mode after boot. stream_first: offboard is entered in the
    air, and armed in, only while setpoints come. takeoff_mode: take-off is a mode of its own.
    takeoff_above_sea: the altitude of a take-off counts from the sea. split_mode: DO_SET_MODE has
    main and sub mode apart, and is acknowledged once on arrival and once with its result.
    global_frame_only: a COMMAND_INT of another frame is refused. bad_setpoint_stops: an ill-defined
    setpoint ends offboard control; else what is not given in it is zero. sticks: flown by RC
    channels, deaf to messages. first_item_is_home: of a mission. reports_events: refusals are
    explained by EVENT. texts_need_ground: STATUSTEXT goes only where a ground station's HEARTBEAT
    was heard; else where any message was. current_known: battery current is measured. unsent:
    message ids whose interval it accepts without sending them. lacks: those it does not know.
    answers_pings: PING is answered. stands_in: it takes what is for a component of its system that
    it hears on no other link. nan_ends: commands that are never answered where they hold NaN.
    arm_unknown: MAV_RESULT of an arming that is neither 0 nor 1. armed_words: what it says once
    armed. mode_words: how it names a mode in which it does not arm. fresh_only: message ids whose
    request is denied, as the stream has just sent the newest. arm_refusal: MAV_RESULT of a refused
    request to arm. streams: default streams of each link, message id → Hz. doubt_streams: those to
    the companion where the state estimate has doubts worth telling (not in motion capture).
    """

    name: str
    autopilot: int
    sw_version: int
    modes: Mapping[Mode, int]
    parameters: Mapping[str, tuple[int, float]]
    settings: Callable[[Mapping[str, float]], Settings]
    armable: frozenset[Mode]
    mode_aliases: Mapping[int, Mode] = field(default_factory=dict)
    strict_parameters: bool = True
    stream_first: bool = True
    initial: Mode = Mode.HOLD
    takeoff_mode: bool = True
    takeoff_above_sea: bool = True
    split_mode: bool = True
    global_frame_only: bool = True
    reports_events: bool = True
    texts_need_ground: bool = True
    current_known: bool = False
    bad_setpoint_stops: bool = False
    sticks: bool = False
    first_item_is_home: bool = False
    hover_name: str = "MPC_THR_HOVER"
    system_name: str = "MAV_SYS_ID"
    unsent: frozenset[int] = frozenset()
    lacks: frozenset[int] = frozenset()
    answers_pings: bool = True
    stands_in: bool = False
    nan_ends: frozenset[int] = frozenset()
    arm_unknown: int = CommandResult.DENIED
    armed_words: str = "Armed by external command"
    mode_words: Mapping[Mode, str] = field(default_factory=dict)
    fresh_only: frozenset[int] = frozenset()
    arm_refusal: int = CommandResult.TEMPORARILY_REJECTED
    arm_prefix: str = "Arming denied"
    capabilities: int = 0
    streams: Mapping[str, Mapping[int, float]] = field(default_factory=dict)
    doubt_streams: Mapping[int, float] = field(default_factory=dict)

    def mode_of(self, custom_mode: int) -> Mode | None:
        """Return the mode of this custom_mode; None where there is none."""
        for mode, value in self.modes.items():
            if value == custom_mode:
                return mode
        return self.mode_aliases.get(custom_mode)

    def defaults_for(self, airframe: Airframe, system: int) -> dict[str, float]:
        """Return the parameters that follow from the vehicle: hover thrust and system id."""
        return {
            name: value
            for name, value in (
                (self.hover_name, round(airframe.hover_thrust, 3)),
                (self.system_name, float(system)),
            )
            if name
        }
