"""Requests that every autopilot understands; a subclass adds its numbers and its exceptions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from mavlink_bridge.wire.ids import AutopilotId, CommandId, ComponentId, ModeFlag
from mavlink_bridge.wire.messages import Command, Heartbeat, Message, ParamRequestRead

_PARAMETERS = 7  # of a COMMAND_LONG
_STREAM_OFF = -1.0  # interval of SET_MESSAGE_INTERVAL


@dataclass(frozen=True)
class Autopilot:
    """Requests to one vehicle, as messages to send; each as its autopilot expects it.

    system: MAVLink system id of the vehicle.

    Class attributes: autopilot: MAV_AUTOPILOT in its HEARTBEAT. mode_after_takeoff: mode of the
    vehicle after a take-off. modes: custom_mode by the name of the mode. streams: rate [Hz] by
    message id, None to switch a stream off. hover_parameter: name of the parameter that holds the
    hover thrust; curve_parameter: that of the share of thrust that it takes to go with the square
    of the motors' speed; empty where there is none.
    """

    system: int
    autopilot: ClassVar[AutopilotId]
    mode_after_takeoff: ClassVar[str]
    modes: ClassVar[Mapping[str, int]]
    streams: ClassVar[Mapping[int, float | None]] = {}
    hover_parameter: ClassVar[str] = ""
    curve_parameter: ClassVar[str] = ""

    def request_streams(self) -> list[Message]:
        """Request attitude, position and thrust, and the parameters that matter in flight."""
        intervals: list[Message] = [
            self._command(
                CommandId.SET_MESSAGE_INTERVAL,
                float(message_id),
                1e6 / rate_hz if rate_hz else _STREAM_OFF,
            )
            for message_id, rate_hz in self.streams.items()
        ]
        names = [name for name in (self.hover_parameter, self.curve_parameter) if name]
        return intervals + [self._read_parameter(name) for name in names]

    def inhibit_reason(self, heartbeat: Heartbeat, parameters: Mapping[str, float]) -> str:
        """Return why the vehicle must not fly as it is set up; empty where it may."""
        return ""

    def arm(self) -> list[Message]:
        """Arm; a vehicle that is not ready refuses with STATUSTEXT."""
        return [self._command(CommandId.COMPONENT_ARM_DISARM, 1.0)]

    def takeoff(self, altitude: float) -> list[Message]:
        """Climb to `altitude` [m] above the take-off point and hold."""
        return [self._command(CommandId.NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, altitude)]

    def offboard(self) -> list[Message]:
        """Take setpoints from the companion, whose stream must already run."""
        return [self._set_mode("offboard")]

    def hold(self) -> list[Message]:
        """Stop and hold the position; the vehicle ignores setpoints from then on."""
        return [self._set_mode("hold")]

    def land(self) -> list[Message]:
        """Land at the present position and disarm."""
        return [self._set_mode("land")]

    def rtl(self) -> list[Message]:
        """Return to where it took off; nothing where the autopilot has no such mode."""
        return [self._set_mode("rtl")] if "rtl" in self.modes else []

    def mode(self, heartbeat: Heartbeat) -> str:
        """Return hold, takeoff, rtl, land or offboard; 'other' for a pilot's mode."""
        for name, number in self.modes.items():
            if heartbeat.custom_mode == number:
                return name
        return "other"

    def _read_parameter(self, name: str) -> ParamRequestRead:
        return ParamRequestRead(self.system, ComponentId.AUTOPILOT1, name, -1)

    def asked_mode(self, request: Command) -> str:
        """Return the name of the mode that a DO_SET_MODE asks for; its number where it has none."""
        for name in self.modes:
            if self._set_mode(name).params == request.params:
                return name
        return f"{request.params[1]:.0f}"

    def _set_mode(self, name: str) -> Command:
        return self._command(
            CommandId.DO_SET_MODE, ModeFlag.CUSTOM_MODE_ENABLED, *self._mode_parameters(name)
        )

    def _mode_parameters(self, name: str) -> tuple[float, ...]:
        """Return parameters 2 and on of DO_SET_MODE."""
        return (self.modes[name],)

    def _command(self, command: CommandId, *parameters: float) -> Command:
        padded = (*parameters, *(0.0,) * (_PARAMETERS - len(parameters)))
        return Command(int(command), padded, self.system)  # type: ignore[arg-type]
