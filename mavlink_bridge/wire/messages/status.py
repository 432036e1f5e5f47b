"""Identity, health and clock of a vehicle."""

from __future__ import annotations

from dataclasses import dataclass


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
class StatusText:
    """STATUSTEXT; severity as in syslog (0 emergency … 7 debug).

    A text of more than 50 bytes comes in chunks with one `number`, not 0; chunk: which.
    """

    severity: int
    text: str
    number: int = 0
    chunk: int = 0


@dataclass(frozen=True)
class Event:
    """EVENT: what an autopilot reports by number; `arguments` is 40 bytes, by the event's kind.

    severity: as in syslog (0 emergency … 7 debug), 8 for a report between programs, 9 for none.
    """

    time: float
    event_id: int
    sequence: int
    severity: int
    arguments: bytes


@dataclass(frozen=True)
class NamedValue:
    """NAMED_VALUE_INT where the value is an int, else NAMED_VALUE_FLOAT; name: ≤ 10 characters."""

    time: float
    name: str
    value: float | int


@dataclass(frozen=True)
class ComponentInformation:
    """COMPONENT_INFORMATION_BASIC: what a component is; capabilities as in AUTOPILOT_VERSION."""

    time: float
    capabilities: int
    vendor: str
    model: str
    software: str
    serial: str


@dataclass(frozen=True)
class CameraInformation:
    """CAMERA_INFORMATION: lens and picture of a camera.

    focal_length, sensor_width, sensor_height: mm, NaN where unknown. width, height: pixels.
    """

    time: float
    vendor: str
    model: str
    focal_length: float
    sensor_width: float
    sensor_height: float
    width: int
    height: int
    flags: int


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
    """BATTERY_STATUS of battery 0: voltage [V], current [A], remaining [0…1]."""

    voltage: float
    current: float
    remaining: float


@dataclass(frozen=True)
class ExtendedSystemState:
    """EXTENDED_SYS_STATE: landed_state 1 on ground, 2 in air, 3 taking off, 4 landing."""

    landed_state: int


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
class Ping:
    """PING: a request where the target is 0, else its answer; time: s, of the one who asks."""

    time: float
    sequence: int
    target_system: int = 0
    target_component: int = 0


@dataclass(frozen=True)
class SystemTime:
    """SYSTEM_TIME: boot clock and Unix time [s]."""

    time: float
    unix_time: float = 0.0
