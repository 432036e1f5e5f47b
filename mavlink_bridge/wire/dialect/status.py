"""Identity, health and clock of a vehicle, to and from MAVLink: `messages.status`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mavlink_bridge.wire import messages as m
from mavlink_bridge.wire.dialect import common as mavlink
from mavlink_bridge.wire.dialect.layout import NUMBERS, message
from mavlink_bridge.wire.dialect.units import clipped, int16, milliseconds, text

_MAVLINK_2 = 3  # mavlink_version of a HEARTBEAT
_NAME_BYTES = 10  # of NAMED_VALUE_FLOAT and _INT
_UNKNOWN_TEMPERATURE = 0x7FFF
_EVENT_BYTES = 40  # arguments of EVENT


def _heartbeat_to_wire(h: m.Heartbeat) -> Any:
    armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if h.armed else 0
    return message("HEARTBEAT")(
        type=h.vehicle_type,
        autopilot=h.autopilot,
        base_mode=h.base_mode | armed,
        custom_mode=h.custom_mode,
        system_status=h.system_status,
        mavlink_version=_MAVLINK_2,
    )


def _heartbeat_from_wire(w: Any) -> m.Heartbeat:
    armed = bool(w.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
    return m.Heartbeat(w.autopilot, w.type, armed, w.custom_mode, w.system_status, w.base_mode)


def _event_from_wire(w: Any) -> m.Event:
    severity = w.log_levels & 0xF  # the upper half is the level of the autopilot's own log
    return m.Event(w.event_time_boot_ms / 1e3, w.event_id, w.sequence, severity, bytes(w.arguments))


def _named_value_to_wire(v: m.NamedValue) -> Any:
    name, time = v.name.encode()[:_NAME_BYTES], milliseconds(v.time)
    if isinstance(v.value, int):
        return message("NAMED_VALUE_INT")(time, name, v.value)
    return message("NAMED_VALUE_FLOAT")(time, name, v.value)


def _named_value_from_wire(w: Any) -> m.NamedValue:
    return m.NamedValue(w.time_boot_ms / 1e3, text(w.name), w.value)


def _component_information_to_wire(c: m.ComponentInformation) -> Any:
    return message(
        "COMPONENT_INFORMATION_BASIC"
    )(
        capabilities=c.capabilities,
        time_boot_ms=milliseconds(c.time),
        time_manufacture_s=0,  # not known
        vendor_name=c.vendor.encode()[:31],  # each ends with a zero
        model_name=c.model.encode()[:31],
        software_version=c.software.encode()[:23],
        hardware_version=b"",
        serial_number=c.serial.encode()[:31],
    )


def _component_information_from_wire(w: Any) -> m.ComponentInformation:
    return m.ComponentInformation(
        w.time_boot_ms / 1e3,
        w.capabilities,
        *(
            name.decode("utf-8", "replace")
            for name in (w.vendor_name, w.model_name, w.software_version, w.serial_number)
        ),
    )


def _camera_information_to_wire(c: m.CameraInformation) -> Any:
    return message("CAMERA_INFORMATION")(
        time_boot_ms=milliseconds(c.time),
        vendor_name=list(c.vendor.encode()[:32].ljust(32, b"\0")),
        model_name=list(c.model.encode()[:32].ljust(32, b"\0")),
        firmware_version=0,
        focal_length=c.focal_length,
        sensor_size_h=c.sensor_width,
        sensor_size_v=c.sensor_height,
        resolution_h=c.width,
        resolution_v=c.height,
        lens_id=0,
        flags=c.flags,
        cam_definition_version=0,
        cam_definition_uri=b"",
    )


def _camera_information_from_wire(w: Any) -> m.CameraInformation:
    return m.CameraInformation(
        w.time_boot_ms / 1e3,
        bytes(w.vendor_name).rstrip(b"\0").decode("utf-8", "replace"),
        bytes(w.model_name).rstrip(b"\0").decode("utf-8", "replace"),
        w.focal_length,
        w.sensor_size_h,
        w.sensor_size_v,
        w.resolution_h,
        w.resolution_v,
        w.flags,
    )


def _system_status_to_wire(s: m.SystemStatus) -> Any:
    return message("SYS_STATUS")(
        onboard_control_sensors_present=s.present,
        onboard_control_sensors_enabled=s.enabled,
        onboard_control_sensors_health=s.health,
        load=clipped(s.load * 1000, 0, 1000),
        voltage_battery=clipped(s.voltage * 1e3, 0, 65535),
        current_battery=int16(s.current * 100),
        battery_remaining=clipped(s.remaining * 100, -1, 100),
        drop_rate_comm=0,
        errors_comm=0,
        errors_count1=0,
        errors_count2=0,
        errors_count3=0,
        errors_count4=0,
    )


def _system_status_from_wire(w: Any) -> m.SystemStatus:
    return m.SystemStatus(
        w.onboard_control_sensors_present,
        w.onboard_control_sensors_enabled,
        w.onboard_control_sensors_health,
        w.voltage_battery / 1e3,
        w.current_battery / 100,
        w.battery_remaining / 100,
        w.load / 1000,
    )


def _battery_to_wire(b: m.BatteryStatus) -> Any:
    return message("BATTERY_STATUS")(
        id=0,
        battery_function=mavlink.MAV_BATTERY_FUNCTION_UNKNOWN,
        type=mavlink.MAV_BATTERY_TYPE_LION,
        temperature=_UNKNOWN_TEMPERATURE,
        voltages=[clipped(b.voltage * 1e3, 0, 65534), *(0xFFFF,) * 9],  # the pack, no other cells
        current_battery=clipped(b.current * 100, -1, 32767),
        current_consumed=-1,
        energy_consumed=-1,
        battery_remaining=clipped(b.remaining * 100, -1, 100),
    )


def _battery_from_wire(w: Any) -> m.BatteryStatus:
    return m.BatteryStatus(w.voltages[0] / 1e3, w.current_battery / 100, w.battery_remaining / 100)


def _autopilot_version_to_wire(v: m.AutopilotVersion) -> Any:
    zeros = [0] * 8
    return message("AUTOPILOT_VERSION")(
        capabilities=v.capabilities,
        flight_sw_version=v.flight_sw_version,
        middleware_sw_version=0,
        os_sw_version=0,
        board_version=0,
        flight_custom_version=zeros,
        middleware_custom_version=zeros,
        os_custom_version=zeros,
        vendor_id=0,
        product_id=0,
        uid=v.uid,
    )


TO_WIRE: dict[type, Callable[[Any], Any]] = {
    m.Heartbeat: _heartbeat_to_wire,
    m.StatusText: lambda s: message("STATUSTEXT")(
        s.severity, s.text.encode()[:50], s.number, s.chunk
    ),
    m.Event: lambda e: message("EVENT")(
        event_id=e.event_id,
        event_time_boot_ms=milliseconds(e.time),
        sequence=e.sequence,
        destination_component=0,
        destination_system=0,
        log_levels=0xF0 | e.severity,
        arguments=e.arguments.ljust(_EVENT_BYTES, b"\0"),
    ),
    m.NamedValue: _named_value_to_wire,
    m.ComponentInformation: _component_information_to_wire,
    m.CameraInformation: _camera_information_to_wire,
    m.SystemStatus: _system_status_to_wire,
    m.BatteryStatus: _battery_to_wire,
    m.ExtendedSystemState: lambda e: message("EXTENDED_SYS_STATE")(0, e.landed_state),
    m.AutopilotVersion: _autopilot_version_to_wire,
    m.TimeSync: lambda t: message("TIMESYNC")(t.tc1, t.ts1),
    m.Ping: lambda p: message("PING")(
        round(p.time * 1e6), p.sequence, p.target_system, p.target_component
    ),
    m.SystemTime: lambda t: message("SYSTEM_TIME")(round(t.unix_time * 1e6), milliseconds(t.time)),
}

FROM_WIRE: dict[int, Callable[[Any], m.Message]] = {
    NUMBERS["HEARTBEAT"]: _heartbeat_from_wire,
    NUMBERS["STATUSTEXT"]: lambda w: m.StatusText(w.severity, text(w.text), w.id, w.chunk_seq),
    NUMBERS["EVENT"]: _event_from_wire,
    NUMBERS["NAMED_VALUE_FLOAT"]: _named_value_from_wire,
    NUMBERS["NAMED_VALUE_INT"]: _named_value_from_wire,
    NUMBERS["COMPONENT_INFORMATION_BASIC"]: _component_information_from_wire,
    NUMBERS["CAMERA_INFORMATION"]: _camera_information_from_wire,
    NUMBERS["SYS_STATUS"]: _system_status_from_wire,
    NUMBERS["BATTERY_STATUS"]: _battery_from_wire,
    NUMBERS["EXTENDED_SYS_STATE"]: lambda w: m.ExtendedSystemState(w.landed_state),
    NUMBERS["AUTOPILOT_VERSION"]: lambda w: m.AutopilotVersion(
        w.capabilities, w.flight_sw_version, w.uid
    ),
    NUMBERS["TIMESYNC"]: lambda w: m.TimeSync(w.tc1, w.ts1),
    NUMBERS["PING"]: lambda w: m.Ping(
        w.time_usec / 1e6, w.seq, w.target_system, w.target_component
    ),
    NUMBERS["SYSTEM_TIME"]: lambda w: m.SystemTime(w.time_boot_ms / 1e3, w.time_unix_usec / 1e6),
}
