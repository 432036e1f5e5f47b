"""What can differ between the emulated autopilots: modes, parameters, rules."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto

from sitl_sim.vehicles.rigid_body import Airframe


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
    mission_ends_in_hold: bool = True


@dataclass(frozen=True)
class Flavour:
    """One autopilot's ways.

    autopilot: MAV_AUTOPILOT. modes: custom_mode of each mode. also: further custom_mode values
    that it accepts, and what they fly as. parameters: name → (type, value). settings: what
    they mean. bytewise: INT32 as bits in the float. armable: modes in which it arms. initial:
    the mode after boot. stream_first: offboard wants setpoints before it is entered.
    takeoff_mode: taking off is a mode of its own. takeoff_above_sea: its altitude counts from
    the sea. split_mode: DO_SET_MODE has main and sub mode apart. bad_setpoint_stops: a setpoint
    with another type_mask ends the following. sticks: flown by RC channels, deaf to messages.
    first_item_is_home: of a mission. unsent: ids whose interval it takes without sending them.
    arm_refusal: the MAV_RESULT. streams: default streams per link, message id → Hz.
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
    initial: Mode = Mode.HOLD
    takeoff_mode: bool = True
    takeoff_above_sea: bool = True
    split_mode: bool = True
    bad_setpoint_stops: bool = False
    sticks: bool = False
    first_item_is_home: bool = False
    hover_name: str = "MPC_THR_HOVER"
    system_name: str = "MAV_SYS_ID"
    unsent: frozenset[int] = frozenset()
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
        return {
            name: value
            for name, value in (
                (self.hover_name, round(airframe.hover_thrust, 3)),
                (self.system_name, float(system)),
            )
            if name
        }
