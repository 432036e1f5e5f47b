"""A real Betaflight behind `mavlink-bridge betaflight`: what its modes are called, what to ask.

Betaflight itself has no SET_ATTITUDE_TARGET and no take-off; the bridge gives it both, and
modes of its own, which stand in custom_mode. Plain Betaflight telemetry (custom_mode 0 or 1,
no bridge) reads as a pilot's mode: it can be watched and not flown.
"""

from __future__ import annotations

from dataclasses import dataclass

from mavlink_bridge.wire.messages import Command, CommandId, Heartbeat, Message

GENERIC = 0  # MAV_AUTOPILOT
# Above what plain Betaflight sends.
MODES = {"hold": 101, "takeoff": 102, "land": 103, "offboard": 104}
PILOT = 100


@dataclass(frozen=True)
class Betaflight:
    """Requests to one bridged Betaflight (its system id), as messages to send."""

    system: int
    autopilot = GENERIC
    up_in = "hold"  # the mode in which a finished take-off is left

    def request_streams(self) -> list[Message]:
        """Nothing: the bridge sends attitude and position at 50 Hz by itself."""
        return []

    def objection(self, heartbeat: Heartbeat, parameters: dict[str, float]) -> str:
        """Why it cannot be flown as it is set up; empty where it can."""
        if heartbeat.custom_mode in (PILOT, *MODES.values()):
            return ""
        return "plain Betaflight telemetry takes no setpoints; start mavlink-bridge betaflight"

    def arm(self) -> list[Message]:
        """Arm by the AUX channel; refused with STATUSTEXT where the controller says no."""
        return [self._command(CommandId.COMPONENT_ARM_DISARM, 1.0)]

    def takeoff(self, altitude: float) -> list[Message]:
        """Climb to `altitude` [m] above the ground and hold."""
        return [self._command(CommandId.NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, altitude)]

    def offboard(self) -> list[Message]:
        """Take setpoints from the companion; a stream of them must already run."""
        return [self._mode("offboard")]

    def hold(self) -> list[Message]:
        """Stop and stay."""
        return [self._mode("hold")]

    def land(self) -> list[Message]:
        """Land here and disarm."""
        return [self._mode("land")]

    def mode(self, heartbeat: Heartbeat) -> str:
        """Name of the mode in a heartbeat; 'other' for those of a pilot."""
        for name, number in MODES.items():
            if heartbeat.custom_mode == number:
                return name
        return "other"

    def _mode(self, name: str) -> Command:
        return self._command(CommandId.DO_SET_MODE, 1.0, MODES[name])

    def _command(self, command: CommandId, *params: float) -> Command:
        padded = (*params, *(0.0,) * (7 - len(params)))
        return Command(int(command), padded, self.system)  # type: ignore[arg-type]
