"""ArduCopter: guided mode for setpoints and for take-off, and the parameter GUID_OPTIONS.

Source: GCS_MAVLink_Copter.cpp, mode_guided.cpp. A take-off is a command inside guided mode and
leaves the vehicle there. Thrust is a climb rate unless GUID_OPTIONS has bit 3.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mavlink_bridge.autopilots.base import Autopilot
from mavlink_bridge.wire.ids import AutopilotId, MessageId
from mavlink_bridge.wire.messages import Heartbeat, Message

MODES = {"offboard": 4, "hold": 17, "land": 9, "rtl": 6}  # GUIDED, BRAKE, LAND, RTL
_GUIDED_NOGPS = 20
_THRUST_AS_THRUST = 1 << 3  # bit of GUID_OPTIONS
_STREAMS: dict[int, float | None] = {
    MessageId.ATTITUDE_QUATERNION: 50.0,
    MessageId.LOCAL_POSITION_NED: 50.0,
    MessageId.ATTITUDE_TARGET: 20.0,
    MessageId.SYS_STATUS: 2.0,
    MessageId.GPS_RAW_INT: 2.0,
    MessageId.GLOBAL_POSITION_INT: 5.0,
    MessageId.EXTENDED_SYS_STATE: 2.0,
    MessageId.HOME_POSITION: 0.5,
}


@dataclass(frozen=True)
class ArduPilot(Autopilot):
    """Requests to one ArduCopter."""

    autopilot = AutopilotId.ARDUPILOTMEGA
    mode_after_takeoff = "offboard"
    modes = MODES
    streams = _STREAMS
    hover_parameter = "MOT_THST_HOVER"
    curve_parameter = "MOT_THST_EXPO"

    def request_streams(self) -> list[Message]:
        """Request the streams, and the parameter that gives thrust its meaning."""
        return [*super().request_streams(), self._read_parameter("GUID_OPTIONS")]

    def inhibit_reason(self, heartbeat: Heartbeat, parameters: Mapping[str, float]) -> str:
        """Return why the vehicle must not fly: thrust would be a climb rate; else empty."""
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
        """Arm in guided mode; a vehicle that is not ready refuses with STATUSTEXT."""
        return [self._set_mode("offboard"), *super().arm()]

    def mode(self, heartbeat: Heartbeat) -> str:
        """Return the mode's name; guided without GPS takes setpoints too."""
        if heartbeat.custom_mode == _GUIDED_NOGPS:
            return "offboard"
        return super().mode(heartbeat)
