"""Betaflight behind `mavlink-bridge betaflight`: the custom modes of the bridge.

Betaflight itself has no SET_ATTITUDE_TARGET and no take-off; the bridge adds both, and modes of
its own in custom_mode. Plain Betaflight telemetry (custom_mode 0 or 1, no bridge) reads as a
pilot's mode: the companion can watch it and not fly it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mavlink_bridge.autopilots.base import Autopilot
from mavlink_bridge.wire.ids import AutopilotId
from mavlink_bridge.wire.messages import Heartbeat

# Above the numbers of plain Betaflight.
MODES = {"hold": 101, "takeoff": 102, "land": 103, "offboard": 104}
PILOT = 100


@dataclass(frozen=True)
class Betaflight(Autopilot):
    """Requests to one bridged Betaflight; the bridge sends its streams at 50 Hz unasked."""

    autopilot = AutopilotId.GENERIC
    mode_after_takeoff = "hold"
    modes = MODES

    def inhibit_reason(self, heartbeat: Heartbeat, parameters: Mapping[str, float]) -> str:
        """Return why the vehicle must not fly: no bridge is on the line; else empty."""
        if heartbeat.custom_mode in (PILOT, *MODES.values()):
            return ""
        return "plain Betaflight telemetry takes no setpoints; start mavlink-bridge betaflight"
