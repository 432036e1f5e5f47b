"""PX4: custom modes, and a take-off whose height is a parameter.

Source: PX4 mavlink_receiver.cpp, px4_custom_mode.h. Only HEARTBEAT tells the mode: PX4
acknowledges DO_SET_MODE twice, on arrival and with what came of it, and on the ground it shows
OFFBOARD where it would not fly in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mavlink_bridge.autopilots.base import Autopilot
from mavlink_bridge.wire.ids import AutopilotId, CommandId, ComponentId, MessageId, ParameterType
from mavlink_bridge.wire.messages import Message, ParamSet

_AUTO, _OFFBOARD = 4, 6  # PX4_CUSTOM_MAIN_MODE
_TAKEOFF, _LOITER, _RTL, _LAND = 2, 3, 5, 6  # PX4_CUSTOM_SUB_MODE_AUTO


def _custom_mode(main: int, sub: int = 0) -> int:
    return main << 16 | sub << 24


MODES = {
    "hold": _custom_mode(_AUTO, _LOITER),
    "takeoff": _custom_mode(_AUTO, _TAKEOFF),
    "rtl": _custom_mode(_AUTO, _RTL),
    "land": _custom_mode(_AUTO, _LAND),
    "offboard": _custom_mode(_OFFBOARD),
}
_STREAMS: dict[int, float | None] = {
    MessageId.ATTITUDE_QUATERNION: 50.0,
    MessageId.LOCAL_POSITION_NED: 50.0,
    MessageId.ATTITUDE_TARGET: 20.0,
    # PX4 slows all streams where the line is too slow for their sum (115200 baud are).
    MessageId.ATTITUDE: None,  # would repeat ATTITUDE_QUATERNION
    MessageId.HIGHRES_IMU: None,
    MessageId.GLOBAL_POSITION_INT: 5.0,
}


@dataclass(frozen=True)
class Px4(Autopilot):
    """Requests to one PX4 vehicle."""

    autopilot = AutopilotId.PX4
    mode_after_takeoff = "hold"
    modes = MODES
    streams = _STREAMS
    hover_parameter = "MPC_THR_HOVER"
    curve_parameter = "THR_MDL_FAC"

    def arm(self) -> list[Message]:
        """Hold, then arm: after a flight in offboard PX4 is back in it, and does not arm there.

        PX4 reports its checks when they change, which may have been before this companion started;
        running them makes it report them again, and changes nothing.
        """
        checks = self._command(CommandId.RUN_PREARM_CHECKS)
        return [*self.hold(), checks, *super().arm()]

    def takeoff(self, altitude: float) -> list[Message]:
        """Climb to `altitude` [m] above the take-off point and hold; the height is a parameter."""
        height = ParamSet(
            self.system, ComponentId.AUTOPILOT1, "MIS_TAKEOFF_ALT", altitude, ParameterType.REAL32
        )
        return [height, self._command(CommandId.NAV_TAKEOFF, *(math.nan,) * 7)]

    def _mode_parameters(self, name: str) -> tuple[float, ...]:
        return MODES[name] >> 16 & 0xFF, MODES[name] >> 24 & 0xFF
