"""ArduCopter: how to arm, take off, enter and leave guided control, and its climb-rate trap.

Source: GCS_MAVLink_Copter.cpp, mode_guided.cpp. Guided mode is its offboard mode; a take-off
is a command inside it and leaves it there. Thrust is a climb rate unless GUID_OPTIONS has bit 3.
"""

from __future__ import annotations

from dataclasses import dataclass

from mavlink_bridge.wire.messages import Command, CommandId, Heartbeat, Message, ParamRequestRead

ARDUPILOT = 3  # MAV_AUTOPILOT
_MODE_ENABLED = 1
MODES = {"offboard": 4, "hold": 17, "land": 9, "rtl": 6}
_GUIDED_NOGPS = 20
_ATTITUDE, _POSITION = 31, 32
STREAMS = {_ATTITUDE: 50.0, _POSITION: 50.0, 1: 2.0, 24: 2.0, 33: 5.0, 245: 2.0}
_THRUST_AS_THRUST = 8


@dataclass(frozen=True)
class ArduPilot:
    """Requests to one ArduCopter (its system id), as messages to send."""

    system: int
    autopilot = ARDUPILOT
    up_in = "offboard"  # the mode in which a finished take-off is left

    def request_streams(self) -> list[Message]:
        """Attitude and local position at 50 Hz, and the parameter that says what thrust means."""
        intervals: list[Message] = [
            self._command(CommandId.SET_MESSAGE_INTERVAL, float(m), 1e6 / rate)
            for m, rate in STREAMS.items()
        ]
        return [*intervals, ParamRequestRead(self.system, 1, "GUID_OPTIONS", -1)]

    def objection(self, heartbeat: Heartbeat, parameters: dict[str, float]) -> str:
        """Why it cannot be flown as it is set up; empty where it can."""
        options = parameters.get("GUID_OPTIONS")
        if options is None:
            return "waiting for parameter GUID_OPTIONS"
        if int(options) & _THRUST_AS_THRUST:
            return ""
        return (
            f"GUID_OPTIONS is {int(options)}: thrust would be taken as a climb rate; "
            f"set GUID_OPTIONS to {int(options) | _THRUST_AS_THRUST} (bit 3)"
        )

    def arm(self) -> list[Message]:
        """Arm in guided mode; refused with STATUSTEXT where the vehicle is not ready."""
        return [self._mode("offboard"), self._command(CommandId.COMPONENT_ARM_DISARM, 1.0)]

    def takeoff(self, altitude: float) -> list[Message]:
        """Climb to `altitude` [m] above home and hold, in guided mode."""
        return [self._command(CommandId.NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, altitude)]

    def offboard(self) -> list[Message]:
        """Take setpoints from the companion."""
        return [self._mode("offboard")]

    def hold(self) -> list[Message]:
        """Stop and stay; the companion's setpoints no longer count."""
        return [self._mode("hold")]

    def land(self) -> list[Message]:
        """Land here and disarm."""
        return [self._mode("land")]

    def mode(self, heartbeat: Heartbeat) -> str:
        """Name of the mode in a heartbeat; 'other' for those of a pilot."""
        if heartbeat.custom_mode == _GUIDED_NOGPS:
            return "offboard"
        for name, number in MODES.items():
            if heartbeat.custom_mode == number:
                return name
        return "other"

    def _mode(self, name: str) -> Command:
        return self._command(CommandId.DO_SET_MODE, _MODE_ENABLED, MODES[name])

    def _command(self, command: CommandId, *params: float) -> Command:
        padded = (*params, *(0.0,) * (7 - len(params)))
        return Command(int(command), padded, self.system)  # type: ignore[arg-type]
