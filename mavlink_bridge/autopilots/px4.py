"""PX4: how to arm, take off, enter and leave offboard control, and what its modes are called.

Source: PX4 mavlink_receiver.cpp, px4_custom_mode.h. The mode is believed from HEARTBEAT alone:
PX4 acknowledges OFFBOARD even where it does not enter it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mavlink_bridge.wire.messages import Command, CommandId, Heartbeat, Message, ParamSet

PX4 = 12  # MAV_AUTOPILOT
_NAN = math.nan
_PARAM_REAL32 = 9
_MODE_ENABLED = 1
MODES = {
    "hold": 0x03040000,
    "takeoff": 0x02040000,
    "rtl": 0x05040000,
    "land": 0x06040000,
    "offboard": 0x00060000,
}
# ATTITUDE_QUATERNION and LOCAL_POSITION_NED; ATTITUDE says the former once more: off (None)
STREAMS = {31: 50.0, 32: 50.0, 30: None}


@dataclass(frozen=True)
class Px4:
    """Requests to one PX4 vehicle (its system id), as messages to send."""

    system: int
    autopilot = PX4
    up_in = "hold"  # the mode in which a finished take-off is left

    def objection(self, heartbeat: Heartbeat, parameters: dict[str, float]) -> str:
        """Why it cannot be flown as it is set up: nothing stands against any PX4."""
        return ""

    def request_streams(self) -> list[Message]:
        """Attitude and local position at 50 Hz, each once."""
        return [
            self._command(CommandId.SET_MESSAGE_INTERVAL, float(m), 1e6 / rate if rate else -1.0)
            for m, rate in STREAMS.items()
        ]

    def arm(self) -> list[Message]:
        """Arm; refused with STATUSTEXT where the vehicle is not ready."""
        return [self._command(CommandId.COMPONENT_ARM_DISARM, 1.0)]

    def takeoff(self, altitude: float) -> list[Message]:
        """Climb to `altitude` [m] above the ground and hold; the height is a parameter."""
        return [
            ParamSet(self.system, 1, "MIS_TAKEOFF_ALT", altitude, _PARAM_REAL32),
            self._command(CommandId.NAV_TAKEOFF, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN),
        ]

    def offboard(self) -> list[Message]:
        """Take setpoints from the companion; a stream of them must already run."""
        return [self._mode("offboard")]

    def hold(self) -> list[Message]:
        """Stop and stay; the companion's setpoints no longer count."""
        return [self._mode("hold")]

    def land(self) -> list[Message]:
        """Land here and disarm."""
        return [self._mode("land")]

    def mode(self, heartbeat: Heartbeat) -> str:
        """Name of the mode in a heartbeat; 'other' for those of a pilot."""
        for name, custom_mode in MODES.items():
            if heartbeat.custom_mode == custom_mode:
                return name
        return "other"

    def _mode(self, name: str) -> Command:
        main, sub = MODES[name] >> 16 & 0xFF, MODES[name] >> 24 & 0xFF
        return self._command(CommandId.DO_SET_MODE, _MODE_ENABLED, main, sub)

    def _command(self, command: CommandId, *params: float) -> Command:
        padded = (*params, *(0.0,) * (7 - len(params)))
        return Command(int(command), padded, self.system)  # type: ignore[arg-type]
