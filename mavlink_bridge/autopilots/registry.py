"""Autopilot adapters by name, and a check of the vehicle on the line against the config."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal

from mavlink_bridge.autopilots.ardupilot import ArduPilot
from mavlink_bridge.autopilots.base import Autopilot
from mavlink_bridge.autopilots.betaflight import Betaflight
from mavlink_bridge.autopilots.px4 import Px4
from mavlink_bridge.wire.messages import AutopilotVersion, Heartbeat, Message, ParamValue

__all__ = ["ADAPTERS", "Autopilot", "AutopilotName", "Identity", "adapter"]

AutopilotName = Literal["px4", "ardupilot", "betaflight"]
ADAPTERS: dict[str, type[Autopilot]] = {
    "px4": Px4,
    "ardupilot": ArduPilot,
    "betaflight": Betaflight,
}
_NAMES: dict[int, str] = {kind.autopilot: name for name, kind in ADAPTERS.items()}


def adapter(name: str, system: int) -> Autopilot:
    """Return the adapter of this name for the vehicle with this MAVLink system id."""
    return ADAPTERS[name](system)


class Identity:
    """The vehicle's own account of its autopilot, compared with the config."""

    def __init__(self, name: str, system: int) -> None:
        self._name, self._system = name, system
        self.adapter = adapter(name, system)
        self.heartbeat: Heartbeat | None = None
        self.version = ""
        self._parameters: dict[str, float] = {}

    def hear(self, messages: Iterable[Message]) -> None:
        """Read the vehicle's messages; a parameter that is not finite is ignored."""
        for m in messages:
            if isinstance(m, Heartbeat):
                self.heartbeat = m
            elif isinstance(m, AutopilotVersion):
                n = m.flight_sw_version
                self.version = f"{n >> 24}.{n >> 16 & 0xFF}.{n >> 8 & 0xFF}"
            elif isinstance(m, ParamValue) and math.isfinite(m.value):
                self._parameters[m.name] = m.value

    def parameter(self, name: str) -> float | None:
        """Return a parameter's value as the wire has it; None before the vehicle told it."""
        return self._parameters.get(name)

    @property
    def hover_thrust(self) -> float | None:
        """The hover thrust that the autopilot's own parameter holds; None where unknown."""
        return self.parameter(self.adapter.hover_parameter)

    @property
    def thrust_curve(self) -> float | None:
        """The autopilot's own share of quadratic thrust, 0…1; None where unknown."""
        return self.parameter(self.adapter.curve_parameter)

    def inhibit_reason(self) -> str:
        """Return why this config must not fly this vehicle, one line; empty where it may."""
        if self.heartbeat is None:
            return ""
        number = self.heartbeat.autopilot
        if number != self.adapter.autopilot:
            found = _NAMES.get(number, f"unknown (MAV_AUTOPILOT {number})")
            version = f" {self.version}" if self.version else ""
            return (
                f"vehicle {self._system} is {found}{version}, but link.autopilot: {self._name}; "
                f"valid: {', '.join(ADAPTERS)}"
            )
        reason = self.adapter.inhibit_reason(self.heartbeat, self._parameters)
        return f"vehicle {self._system} ({self._name}): {reason}" if reason else ""
