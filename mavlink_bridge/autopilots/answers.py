"""What an autopilot refuses, in words: acknowledgements, parameter errors, PX4's events.

STATUSTEXT tells more, and is passed on as it is. A PX4 sends it only where a ground station's
HEARTBEAT was heard. A companion must not send one for that: it would keep the failsafe for a lost
ground station (NAV_DLL_ACT) from ever acting.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from mavlink_bridge.autopilots.base import Autopilot
from mavlink_bridge.autopilots.px4_events import Px4Events
from mavlink_bridge.wire.ids import CommandId, CommandResult, ComponentId, ParameterError
from mavlink_bridge.wire.messages import (
    Command,
    CommandAck,
    Event,
    Heartbeat,
    Message,
    ParamError,
)

_FINE = (CommandResult.ACCEPTED, CommandResult.IN_PROGRESS)
_NAMES = {
    CommandId.NAV_RETURN_TO_LAUNCH: "return",
    CommandId.NAV_LAND: "land",
    CommandId.NAV_TAKEOFF: "take-off",
    CommandId.DO_SET_MODE: "mode",
    CommandId.COMPONENT_ARM_DISARM: "arm",
    CommandId.RUN_PREARM_CHECKS: "checks",
    CommandId.SET_MESSAGE_INTERVAL: "message interval",
    CommandId.REQUEST_MESSAGE: "message",
}


class Answers:
    """Follows what one companion asks of its autopilot, and how that answers."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._events = Px4Events()
        self._asked: dict[int, Command] = {}
        self._mode = ""

    def ask(self, requests: Iterable[Message]) -> None:
        """Note what was asked last, command by command."""
        for m in requests:
            if isinstance(m, Command):
                self._asked[m.command] = m

    def refusals(self, messages: Sequence[Message]) -> list[str]:
        """Return what the vehicle's messages refuse, each with its reason."""
        told: list[str] = []
        for m in messages:
            if isinstance(m, Heartbeat):
                self._mode = self._autopilot.mode(m)
            elif isinstance(m, CommandAck):
                told.append(self._acknowledged(m))
            elif isinstance(m, ParamError):
                told.append(f"parameter {m.name or m.index}: {_name(ParameterError, m.error)}")
            elif isinstance(m, Event):
                told.append(self._events.hear(m, self._mode))
        return [words for words in told if words]

    def _acknowledged(self, m: CommandAck) -> str:
        """Return the words of a refusal to this companion; empty for others and for consent."""
        mine = m.target_system in (0, self._autopilot.system) and m.target_component in (
            0,
            ComponentId.ONBOARD_COMPUTER,
        )
        if not mine or m.result in _FINE or m.command not in self._asked:
            return ""
        return f"{self._name(self._asked[m.command])}: {_name(CommandResult, m.result)}"

    def _name(self, asked: Command) -> str:
        """Return what was asked, in words."""
        if asked.command == CommandId.DO_SET_MODE:
            return f"mode {self._autopilot.asked_mode(asked)}"
        if asked.command == CommandId.COMPONENT_ARM_DISARM and not asked.params[0]:
            return "disarm"
        if asked.command in (CommandId.SET_MESSAGE_INTERVAL, CommandId.REQUEST_MESSAGE):
            return f"{_NAMES[CommandId(asked.command)]} {asked.params[0]:.0f}"
        known = asked.command in set(CommandId)
        return _NAMES[CommandId(asked.command)] if known else f"command {asked.command}"


def _name(table: type[CommandResult] | type[ParameterError], number: int) -> str:
    """Return a number's name in lower case, else the number."""
    known = number in {member.value for member in table}
    return table(number).name.lower().replace("_", " ") if known else f"result {number}"
