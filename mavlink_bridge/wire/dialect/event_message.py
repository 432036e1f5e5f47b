"""EVENT (410), which the generated dialect leaves out as work in progress, and PX4 sends.

Source: https://mavlink.io/en/messages/common.html#EVENT. Importing this module teaches the
generated dialect the message.
"""

from __future__ import annotations

import struct
from typing import Any, ClassVar

from mavlink_bridge.wire.dialect import common as mavlink

_ARGUMENTS = 40  # bytes


class EventMessage(mavlink.MAVLink_message):  # type: ignore[misc]  # generated, read without types
    """EVENT in the form of the generated messages; `event_id` is the field `id`."""

    id = 410
    msgname = "EVENT"
    fieldnames: ClassVar[list[str]] = [
        "destination_component",
        "destination_system",
        "event_id",
        "event_time_boot_ms",
        "sequence",
        "log_levels",
        "arguments",
    ]
    ordered_fieldnames: ClassVar[list[str]] = [
        "event_id",
        "event_time_boot_ms",
        "sequence",
        "destination_component",
        "destination_system",
        "log_levels",
        "arguments",
    ]
    fieldtypes: ClassVar[list[str]] = [*["uint8_t"] * 2, *["uint32_t"] * 2, "uint16_t"] + [
        "uint8_t"
    ] * 2
    fielddisplays_by_name: ClassVar[dict[str, str]] = {}
    fieldenums_by_name: ClassVar[dict[str, str]] = {}
    fieldunits_by_name: ClassVar[dict[str, str]] = {}
    native_format = bytearray(b"<IIHBBBB")
    orders: ClassVar[list[int]] = [3, 4, 0, 1, 2, 5, 6]
    lengths: ClassVar[list[int]] = [1, 1, 1, 1, 1, 1, _ARGUMENTS]
    array_lengths: ClassVar[list[int]] = [0, 0, 0, 0, 0, 0, _ARGUMENTS]
    crc_extra = 160
    unpacker = struct.Struct(f"<IIHBBB{_ARGUMENTS}B")
    instance_field = None
    instance_offset = -1

    def __init__(
        self,
        destination_component: int,
        destination_system: int,
        event_id: int,
        event_time_boot_ms: int,
        sequence: int,
        log_levels: int,
        arguments: bytes | list[int],
    ) -> None:
        super().__init__(self.id, self.msgname)
        self._fieldnames = self.fieldnames
        self._instance_field, self._instance_offset = None, -1
        self.event_id = event_id
        self.event_time_boot_ms = event_time_boot_ms
        self.sequence = sequence
        self.destination_component = destination_component
        self.destination_system = destination_system
        self.log_levels = log_levels
        self.arguments = list(bytes(arguments).ljust(_ARGUMENTS, b"\0")[:_ARGUMENTS])

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """Return the frame."""
        payload = self.unpacker.pack(
            self.event_id,
            self.event_time_boot_ms,
            self.sequence,
            self.destination_component,
            self.destination_system,
            self.log_levels,
            *self.arguments,
        )
        frame: bytes = self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1)
        return frame


mavlink.mavlink_map[EventMessage.id] = EventMessage
