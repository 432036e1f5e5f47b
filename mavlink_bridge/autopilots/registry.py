"""The autopilots by name, and whether the one on the line is the one in the config."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal, Protocol

from mavlink_bridge.autopilots.ardupilot import ArduPilot
from mavlink_bridge.autopilots.betaflight import Betaflight
from mavlink_bridge.autopilots.px4 import Px4
from mavlink_bridge.wire.messages import (
    AutopilotVersion,
    Heartbeat,
    Message,
    ParamValue,
)

AutopilotName = Literal["px4", "ardupilot", "betaflight"]
ADAPTERS: dict[str, type[Px4] | type[ArduPilot] | type[Betaflight]] = {
    "px4": Px4,
    "ardupilot": ArduPilot,
    "betaflight": Betaflight,
}
_KINDS = {ADAPTERS[name].autopilot: name for name in ADAPTERS}


class Autopilot(Protocol):
    """Requests to one vehicle, as messages to send; each in the words of its autopilot.

    autopilot: MAV_AUTOPILOT. up_in: the mode in which a finished take-off leaves it.
    """

    autopilot: int
    up_in: str

    def request_streams(self) -> list[Message]:
        """Ask for attitude and position, and for what `objection` looks at."""
        ...

    def objection(self, heartbeat: Heartbeat, parameters: dict[str, float]) -> str:
        """Why it cannot be flown as it is set up; empty where it can."""
        ...

    def arm(self) -> list[Message]:
        """Arm."""
        ...

    def takeoff(self, altitude: float) -> list[Message]:
        """Climb to `altitude` [m] above the ground."""
        ...

    def offboard(self) -> list[Message]:
        """Take setpoints from the companion."""
        ...

    def hold(self) -> list[Message]:
        """Stop and stay."""
        ...

    def land(self) -> list[Message]:
        """Land here and disarm."""
        ...

    def mode(self, heartbeat: Heartbeat) -> str:
        """hold, takeoff, rtl, land, offboard, or other: a pilot's."""
        ...


def adapter(name: str, system: int) -> Autopilot:
    """The adapter of this name for one vehicle."""
    return ADAPTERS[name](system)


class Identity:
    """What the vehicle says of itself, against what the config says of it."""

    def __init__(self, name: str, system: int) -> None:
        self._name, self._system = name, system
        self._adapter = adapter(name, system)
        self.heartbeat: Heartbeat | None = None
        self.version = ""
        self._parameters: dict[str, float] = {}

    def hear(self, messages: Iterable[Message]) -> None:
        """Take the vehicle's own messages; a parameter that is no number is as good as none."""
        for m in messages:
            if isinstance(m, Heartbeat):
                self.heartbeat = m
            elif isinstance(m, AutopilotVersion):
                n = m.flight_sw_version
                self.version = f"{n >> 24}.{n >> 16 & 0xFF}.{n >> 8 & 0xFF}"
            elif isinstance(m, ParamValue) and math.isfinite(m.value):
                self._parameters[m.name] = m.value

    def objection(self) -> str:
        """Why this vehicle is not to be flown by this config, one line; empty where it is."""
        if self.heartbeat is None:
            return ""
        kind = self.heartbeat.autopilot
        if kind != self._adapter.autopilot:
            found = _KINDS.get(kind, f"unknown (MAV_AUTOPILOT {kind})")
            version = f" {self.version}" if self.version else ""
            return (
                f"vehicle {self._system} is {found}{version}, but link.autopilot: {self._name}; "
                f"valid: {', '.join(ADAPTERS)}"
            )
        why = self._adapter.objection(self.heartbeat, self._parameters)
        return f"vehicle {self._system} ({self._name}): {why}" if why else ""
