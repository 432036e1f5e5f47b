"""Parameters, missions and file transfer, to and from MAVLink: `messages.protocols`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from mavlink_bridge.wire import messages as m
from mavlink_bridge.wire.dialect.layout import NUMBERS, message
from mavlink_bridge.wire.dialect.units import UNSET_COORDINATE, coordinate, text

_FILE_BYTES = 251  # payload of FILE_TRANSFER_PROTOCOL


def _param_request_from_wire(w: Any) -> m.ParamRequestRead:
    return m.ParamRequestRead(w.target_system, w.target_component, text(w.param_id), w.param_index)


def _param_set_from_wire(w: Any) -> m.ParamSet:
    return m.ParamSet(
        w.target_system, w.target_component, text(w.param_id), w.param_value, w.param_type
    )


def _param_value_from_wire(w: Any) -> m.ParamValue:
    return m.ParamValue(text(w.param_id), w.param_value, w.param_type, w.param_count, w.param_index)


def _mission_request_to_wire(r: m.MissionRequest) -> Any:
    fields = (r.target_system, r.target_component, r.seq, r.mission_type)
    if r.floating:
        return message("MISSION_REQUEST")(*fields)
    return message("MISSION_REQUEST_INT")(*fields)


def _mission_request_from_wire(w: Any) -> m.MissionRequest:
    floating = w.msgname == "MISSION_REQUEST"
    return m.MissionRequest(w.target_system, w.target_component, w.seq, w.mission_type, floating)


def _mission_item_to_wire(i: m.MissionItem) -> Any:
    if i.floating:
        item, x, y = message("MISSION_ITEM"), i.x_deg, i.y_deg
    else:
        item, x, y = message("MISSION_ITEM_INT"), coordinate(i.x_deg), coordinate(i.y_deg)
    return item(
        i.target_system,
        i.target_component,
        i.seq,
        i.frame,
        i.command,
        i.current,
        i.autocontinue,
        *i.params,
        x=x,
        y=y,
        z=i.z,
        mission_type=i.mission_type,
    )


def _mission_item_from_wire(w: Any) -> m.MissionItem:
    x, y = w.x, w.y
    floating = w.msgname == "MISSION_ITEM"
    if not floating:
        x, y = (math.nan if k == UNSET_COORDINATE else k / 1e7 for k in (w.x, w.y))
    return m.MissionItem(
        w.target_system,
        w.target_component,
        w.seq,
        w.frame,
        w.command,
        w.current,
        w.autocontinue,
        (w.param1, w.param2, w.param3, w.param4),
        x,
        y,
        w.z,
        w.mission_type,
        floating,
    )


TO_WIRE: dict[type, Callable[[Any], Any]] = {
    m.ParamRequestRead: lambda p: message("PARAM_REQUEST_READ")(
        p.target_system, p.target_component, p.name.encode(), p.index
    ),
    m.ParamRequestList: lambda p: message("PARAM_REQUEST_LIST")(
        p.target_system, p.target_component
    ),
    m.ParamSet: lambda p: message("PARAM_SET")(
        p.target_system, p.target_component, p.name.encode(), p.value, p.param_type
    ),
    m.ParamValue: lambda p: message("PARAM_VALUE")(
        p.name.encode(), p.value, p.param_type, p.count, p.index
    ),
    m.ParamError: lambda p: message("PARAM_ERROR")(
        p.target_system, p.target_component, p.name.encode(), p.index, p.error
    ),
    m.MissionCount: lambda c: message("MISSION_COUNT")(
        c.target_system, c.target_component, c.count, c.mission_type
    ),
    m.MissionRequestList: lambda r: message("MISSION_REQUEST_LIST")(
        r.target_system, r.target_component, r.mission_type
    ),
    m.MissionRequest: _mission_request_to_wire,
    m.MissionItem: _mission_item_to_wire,
    m.MissionAck: lambda a: message("MISSION_ACK")(
        a.target_system, a.target_component, a.result, a.mission_type
    ),
    m.MissionSetCurrent: lambda s: message("MISSION_SET_CURRENT")(
        s.target_system, s.target_component, s.seq
    ),
    m.MissionClearAll: lambda c: message("MISSION_CLEAR_ALL")(
        c.target_system, c.target_component, c.mission_type
    ),
    m.MissionCurrent: lambda c: message("MISSION_CURRENT")(c.seq),
    m.MissionItemReached: lambda r: message("MISSION_ITEM_REACHED")(r.seq),
    m.FileTransfer: lambda f: message("FILE_TRANSFER_PROTOCOL")(
        0, f.target_system, f.target_component, f.payload.ljust(_FILE_BYTES, b"\0")
    ),
}

FROM_WIRE: dict[int, Callable[[Any], m.Message]] = {
    NUMBERS["PARAM_REQUEST_READ"]: _param_request_from_wire,
    NUMBERS["PARAM_REQUEST_LIST"]: lambda w: m.ParamRequestList(
        w.target_system, w.target_component
    ),
    NUMBERS["PARAM_SET"]: _param_set_from_wire,
    NUMBERS["PARAM_VALUE"]: _param_value_from_wire,
    NUMBERS["PARAM_ERROR"]: lambda w: m.ParamError(
        w.target_system, w.target_component, text(w.param_id), w.param_index, w.error
    ),
    NUMBERS["MISSION_COUNT"]: lambda w: m.MissionCount(
        w.target_system, w.target_component, w.count, w.mission_type
    ),
    NUMBERS["MISSION_REQUEST_LIST"]: lambda w: m.MissionRequestList(
        w.target_system, w.target_component, w.mission_type
    ),
    NUMBERS["MISSION_REQUEST"]: _mission_request_from_wire,
    NUMBERS["MISSION_REQUEST_INT"]: _mission_request_from_wire,
    NUMBERS["MISSION_ITEM_INT"]: _mission_item_from_wire,
    NUMBERS["MISSION_ITEM"]: _mission_item_from_wire,
    NUMBERS["MISSION_ACK"]: lambda w: m.MissionAck(
        w.target_system, w.target_component, w.type, w.mission_type
    ),
    NUMBERS["MISSION_SET_CURRENT"]: lambda w: m.MissionSetCurrent(
        w.target_system, w.target_component, w.seq
    ),
    NUMBERS["MISSION_CLEAR_ALL"]: lambda w: m.MissionClearAll(
        w.target_system, w.target_component, w.mission_type
    ),
    NUMBERS["MISSION_CURRENT"]: lambda w: m.MissionCurrent(w.seq),
    NUMBERS["MISSION_ITEM_REACHED"]: lambda w: m.MissionItemReached(w.seq),
    NUMBERS["FILE_TRANSFER_PROTOCOL"]: lambda w: m.FileTransfer(
        w.target_system, w.target_component, bytes(w.payload)
    ),
}
