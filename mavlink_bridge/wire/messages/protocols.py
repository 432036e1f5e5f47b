"""The parameter, mission and file transfer protocols."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ParamRequestRead:
    """PARAM_REQUEST_READ by name, or by index where index ≥ 0."""

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
    """PARAM_SET; `value` is the raw float of the wire (an INT32 may be in it bytewise)."""

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
class ParamError:
    """PARAM_ERROR: why a parameter was not read or set; error: MAV_PARAM_ERROR."""

    target_system: int
    target_component: int
    name: str
    index: int
    error: int


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
    """MISSION_REQUEST_INT, or where `floating` the deprecated MISSION_REQUEST."""

    target_system: int
    target_component: int
    seq: int
    mission_type: int = 0
    floating: bool = False


@dataclass(frozen=True)
class MissionItem:
    """MISSION_ITEM_INT, or where `floating` the old MISSION_ITEM; x, y in degrees, z in metres."""

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
    floating: bool = False


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
class FileTransfer:
    """FILE_TRANSFER_PROTOCOL; payload of 251 bytes."""

    target_system: int
    target_component: int
    payload: bytes
