"""What crosses the wire, as frozen dataclasses: SI units, world ENU, body FLU, radians.

Every class has a MAVLink message of the same meaning (named in its docstring); the codec
is the only place that knows the wire's own units and frames. `time` is the sender's boot
clock in seconds.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from mavlink_bridge.shared.arrays import Vector


@dataclass(frozen=True)
class Source:
    """Who sent a message: MAVLink system and component id."""

    system: int
    component: int


@dataclass(frozen=True)
class RateCommand:
    """What the companion decides: body rates and collective acceleration.

    omega: (3,) body rates [rad/s], body FLU. c: collective acceleration [m/s²] along +z_B.
    """

    omega: Vector
    c: float


@dataclass(frozen=True)
class RateSetpoint:
    """SET_ATTITUDE_TARGET with attitude ignored (type_mask 128).

    omega: (3,) body rates [rad/s], body FLU. thrust: normalised collective thrust 0…1.
    """

    time: float
    omega: Vector
    thrust: float
    target_system: int = 0
    target_component: int = 1
    type_mask: int = 128


@dataclass(frozen=True)
class Heartbeat:
    """HEARTBEAT. custom_mode as the autopilot sends it; `armed` from base_mode."""

    autopilot: int
    vehicle_type: int
    armed: bool
    custom_mode: int
    system_status: int
    base_mode: int = 0


@dataclass(frozen=True)
class Attitude:
    """ATTITUDE_QUATERNION: q_wb (4,) w,x,y,z body→world; omega (3,) rad/s FLU."""

    time: float
    q_wb: Vector
    omega: Vector


@dataclass(frozen=True)
class EulerAttitude(Attitude):
    """ATTITUDE: the same, three angles on the wire."""


@dataclass(frozen=True)
class LocalPosition:
    """LOCAL_POSITION_NED: p (3,) m and v (3,) m/s in the vehicle's own ENU frame."""

    time: float
    p: Vector
    v: Vector


@dataclass(frozen=True)
class Odometry:
    """ODOMETRY: p (3,) m, v (3,) m/s in the own ENU frame; q_wb (4,); omega (3,) rad/s FLU.

    p is NaN where it came in a frame that says nothing of north and up.
    """

    time: float
    p: Vector
    v: Vector
    q_wb: Vector
    omega: Vector


@dataclass(frozen=True)
class GlobalPosition:
    """GLOBAL_POSITION_INT: degrees, metres; v (3,) m/s ENU; heading rad, clockwise from north."""

    time: float
    latitude_deg: float
    longitude_deg: float
    altitude: float
    relative_altitude: float
    v: Vector
    heading: float | None = None


@dataclass(frozen=True)
class VehicleState:
    """A vehicle's state at one instant of its clock; the NMPC's X without the input.

    p (3,) m ENU, v (3,) m/s ENU, q_wb (4,) w,x,y,z body→world, omega (3,) rad/s FLU.
    """

    time: float
    p: Vector
    v: Vector
    q_wb: Vector
    omega: Vector


class CommandId(IntEnum):
    """MAV_CMD values that this project sends or answers."""

    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    DO_SET_MODE = 176
    COMPONENT_ARM_DISARM = 400
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512


class CommandResult(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5


@dataclass(frozen=True)
class Command:
    """COMMAND_LONG (or COMMAND_INT, flattened): seven parameters, NaN where unused."""

    command: int
    params: tuple[float, float, float, float, float, float, float]
    target_system: int = 0
    target_component: int = 1
    confirmation: int = 0


@dataclass(frozen=True)
class CommandAck:
    """COMMAND_ACK."""

    command: int
    result: int
    target_system: int = 0
    target_component: int = 0


@dataclass(frozen=True)
class SetMode:
    """SET_MODE, the old way to change the mode, still used by ground stations."""

    target_system: int
    base_mode: int
    custom_mode: int


@dataclass(frozen=True)
class StatusText:
    """STATUSTEXT; severity as in syslog (0 emergency … 7 debug)."""

    severity: int
    text: str


@dataclass(frozen=True)
class SystemStatus:
    """SYS_STATUS: sensor bits, battery voltage [V], current [A], remaining [0…1]."""

    present: int
    enabled: int
    health: int
    voltage: float
    current: float
    remaining: float
    load: float = 0.0


@dataclass(frozen=True)
class BatteryStatus:
    """BATTERY_STATUS of battery 0."""

    voltage: float
    current: float
    remaining: float


@dataclass(frozen=True)
class ExtendedSystemState:
    """EXTENDED_SYS_STATE: landed_state 1 on ground, 2 in air, 3 taking off, 4 landing."""

    landed_state: int


@dataclass(frozen=True)
class HomePosition:
    """HOME_POSITION: where the vehicle took off; p (3,) m in its own ENU frame."""

    latitude_deg: float
    longitude_deg: float
    altitude: float
    p: Vector = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class GpsRaw:
    """GPS_RAW_INT: fix type 3 = 3-D."""

    time: float
    fix_type: int
    latitude_deg: float
    longitude_deg: float
    altitude: float
    satellites: int
    speed: float = 0.0
    course: float = 0.0


@dataclass(frozen=True)
class GpsInput:
    """GPS_INPUT: what a receiver tells an autopilot; degrees, m.

    v: m/s, (3,) ENU, (2,) where the vertical is not given, None where the horizontal is not.
    """

    time: float
    fix_type: int
    latitude_deg: float
    longitude_deg: float
    altitude: float
    v: Vector | None
    satellites: int = 12


@dataclass(frozen=True)
class HilSensor:
    """HIL_SENSOR: force (3,) m/s² and omega (3,) rad/s FLU, magnetic (3,) gauss FLU, hPa, m."""

    time: float
    force: Vector
    omega: Vector
    magnetic: Vector
    pressure: float
    altitude: float


@dataclass(frozen=True)
class HilGps:
    """HIL_GPS: a simulated receiver's fix; degrees, m, v (3,) m/s ENU."""

    time: float
    latitude_deg: float
    longitude_deg: float
    altitude: float
    v: Vector


@dataclass(frozen=True)
class HilActuators:
    """HIL_ACTUATOR_CONTROLS: what an autopilot wants of its motors, 0…1 each (16)."""

    time: float
    controls: tuple[float, ...]
    armed: bool


@dataclass(frozen=True)
class EstimatorStatus:
    """ESTIMATOR_STATUS: flags bits, position accuracies in metres."""

    time: float
    flags: int
    horizontal_accuracy: float
    vertical_accuracy: float


@dataclass(frozen=True)
class AutopilotVersion:
    """AUTOPILOT_VERSION."""

    capabilities: int
    flight_sw_version: int
    uid: int


@dataclass(frozen=True)
class TimeSync:
    """TIMESYNC: tc1 and ts1 in nanoseconds of the two clocks."""

    tc1: int
    ts1: int


@dataclass(frozen=True)
class SystemTime:
    """SYSTEM_TIME: boot time in seconds."""

    time: float
    unix_time: float = 0.0


@dataclass(frozen=True)
class ParamRequestRead:
    """PARAM_REQUEST_READ by name, or by index where index >= 0."""

    target_system: int
    target_component: int
    name: str
    index: int


@dataclass(frozen=True)
class ParamRequestList:
    """PARAM_REQUEST_LIST."""

    target_system: int
    target_component: int


@dataclass(frozen=True)
class ParamSet:
    """PARAM_SET; `value` is the raw float of the wire (INT32 may be in it bytewise)."""

    target_system: int
    target_component: int
    name: str
    value: float
    param_type: int


@dataclass(frozen=True)
class ParamValue:
    """PARAM_VALUE; `value` is the raw float of the wire."""

    name: str
    value: float
    param_type: int
    count: int
    index: int


@dataclass(frozen=True)
class MissionCount:
    """MISSION_COUNT."""

    target_system: int
    target_component: int
    count: int
    mission_type: int = 0


@dataclass(frozen=True)
class MissionRequestList:
    """MISSION_REQUEST_LIST."""

    target_system: int
    target_component: int
    mission_type: int = 0


@dataclass(frozen=True)
class MissionRequest:
    """MISSION_REQUEST_INT (or the old MISSION_REQUEST)."""

    target_system: int
    target_component: int
    seq: int
    mission_type: int = 0


@dataclass(frozen=True)
class MissionItem:
    """MISSION_ITEM_INT; x, y in degrees, z in metres."""

    target_system: int
    target_component: int
    seq: int
    frame: int
    command: int
    current: int
    autocontinue: int
    params: tuple[float, float, float, float]
    x_deg: float
    y_deg: float
    z: float
    mission_type: int = 0


@dataclass(frozen=True)
class MissionAck:
    """MISSION_ACK; result 0 = accepted."""

    target_system: int
    target_component: int
    result: int
    mission_type: int = 0


@dataclass(frozen=True)
class MissionSetCurrent:
    """MISSION_SET_CURRENT."""

    target_system: int
    target_component: int
    seq: int


@dataclass(frozen=True)
class MissionClearAll:
    """MISSION_CLEAR_ALL."""

    target_system: int
    target_component: int
    mission_type: int = 0


@dataclass(frozen=True)
class MissionCurrent:
    """MISSION_CURRENT."""

    seq: int


@dataclass(frozen=True)
class MissionItemReached:
    """MISSION_ITEM_REACHED."""

    seq: int


@dataclass(frozen=True)
class RequestDataStream:
    """REQUEST_DATA_STREAM, the old way to ask for telemetry (MAVProxy)."""

    target_system: int
    target_component: int
    stream: int
    rate_hz: float
    start: bool


@dataclass(frozen=True)
class FileTransfer:
    """FILE_TRANSFER_PROTOCOL; payload of 251 bytes."""

    target_system: int
    target_component: int
    payload: bytes


Message = (
    RateSetpoint
    | Heartbeat
    | Attitude
    | EulerAttitude
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
    | GpsInput
    | HilSensor
    | HilGps
    | HilActuators
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
)


@dataclass(frozen=True)
class Received:
    """A decoded message and who sent it.

    missing, unread: frames of this sender, since its last message, that did not come (by their
    numbers), and that came and are of no use here.
    """

    source: Source
    message: Message
    missing: int = field(default=0, compare=False)
    unread: int = field(default=0, compare=False)
