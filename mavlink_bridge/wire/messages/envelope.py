"""The union of all messages, and a received message with its sender."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from mavlink_bridge.wire.messages.protocols import (
    FileTransfer,
    MissionAck,
    MissionClearAll,
    MissionCount,
    MissionCurrent,
    MissionItem,
    MissionItemReached,
    MissionRequest,
    MissionRequestList,
    MissionSetCurrent,
    ParamError,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    ParamValue,
)
from mavlink_bridge.wire.messages.sensors import (
    DistanceSensor,
    GpsInput,
    GpsRaw,
    HilActuators,
    HilGps,
    HilSensor,
    HilState,
)
from mavlink_bridge.wire.messages.setpoints import (
    Command,
    CommandAck,
    RateSetpoint,
    RequestDataStream,
    SetMode,
)
from mavlink_bridge.wire.messages.state import (
    Attitude,
    AttitudeTarget,
    EstimatorStatus,
    EulerAttitude,
    GlobalPosition,
    HomePosition,
    LocalPosition,
    Odometry,
)
from mavlink_bridge.wire.messages.status import (
    AutopilotVersion,
    BatteryStatus,
    CameraInformation,
    ComponentInformation,
    Event,
    ExtendedSystemState,
    Heartbeat,
    NamedValue,
    Ping,
    StatusText,
    SystemStatus,
    SystemTime,
    TimeSync,
)


class Source(NamedTuple):
    """Sender of a message: MAVLink system and component id."""

    system: int
    component: int


Message = (
    RateSetpoint
    | Heartbeat
    | Attitude
    | EulerAttitude
    | AttitudeTarget
    | LocalPosition
    | Odometry
    | GlobalPosition
    | Command
    | CommandAck
    | SetMode
    | StatusText
    | SystemStatus
    | BatteryStatus
    | ExtendedSystemState
    | HomePosition
    | GpsRaw
    | DistanceSensor
    | GpsInput
    | HilSensor
    | HilGps
    | HilActuators
    | HilState
    | EstimatorStatus
    | AutopilotVersion
    | TimeSync
    | SystemTime
    | ParamRequestRead
    | ParamRequestList
    | ParamSet
    | ParamValue
    | MissionCount
    | MissionRequestList
    | MissionRequest
    | MissionItem
    | MissionAck
    | MissionSetCurrent
    | MissionClearAll
    | MissionCurrent
    | MissionItemReached
    | RequestDataStream
    | FileTransfer
    | ParamError
    | Event
    | NamedValue
    | CameraInformation
    | ComponentInformation
    | Ping
)


@dataclass(frozen=True)
class Received:
    """A decoded message and its sender.

    missing, unread: frames of this sender since its last message. Missing frames are gaps in its
    sequence numbers; unread frames arrived and hold nothing that this project uses. arrived: s,
    CLOCK_MONOTONIC, when it came to this machine; None: not known, it came just now. Of all that is
    decided, the vehicle's clock alone depends on it.
    """

    source: Source
    message: Message
    missing: int = field(default=0, compare=False)
    unread: int = field(default=0, compare=False)
    arrived: float | None = field(default=None, compare=False)
