"""Messages on the wire, as frozen dataclasses: SI units, world ENU, body FLU, radians.

Every class has a MAVLink message of the same meaning (named in its docstring); the codec
is the only place that knows the wire's own units and frames. `time` is the sender's boot
clock in seconds.
"""

from mavlink_bridge.wire.ids import CommandId, CommandResult
from mavlink_bridge.wire.messages.envelope import Message, Received, Source
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
)
from mavlink_bridge.wire.messages.setpoints import (
    Command,
    CommandAck,
    RateCommand,
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
    VehicleState,
)
from mavlink_bridge.wire.messages.status import (
    AutopilotVersion,
    BatteryStatus,
    ExtendedSystemState,
    Heartbeat,
    StatusText,
    SystemStatus,
    SystemTime,
    TimeSync,
)

__all__ = [
    "Attitude",
    "AttitudeTarget",
    "AutopilotVersion",
    "BatteryStatus",
    "Command",
    "CommandAck",
    "CommandId",
    "CommandResult",
    "DistanceSensor",
    "EstimatorStatus",
    "EulerAttitude",
    "ExtendedSystemState",
    "FileTransfer",
    "GlobalPosition",
    "GpsInput",
    "GpsRaw",
    "Heartbeat",
    "HilActuators",
    "HilGps",
    "HilSensor",
    "HomePosition",
    "LocalPosition",
    "Message",
    "MissionAck",
    "MissionClearAll",
    "MissionCount",
    "MissionCurrent",
    "MissionItem",
    "MissionItemReached",
    "MissionRequest",
    "MissionRequestList",
    "MissionSetCurrent",
    "Odometry",
    "ParamRequestList",
    "ParamRequestRead",
    "ParamSet",
    "ParamValue",
    "RateCommand",
    "RateSetpoint",
    "Received",
    "RequestDataStream",
    "SetMode",
    "Source",
    "StatusText",
    "SystemStatus",
    "SystemTime",
    "TimeSync",
    "VehicleState",
]
