"""Messages of common.xml that the generated dialect leaves out, in the form of its own.

EVENT is sent by PX4; COMPONENT_INFORMATION_BASIC is what the companion says of itself. Importing
this module teaches the generated dialect both.
Source: https://mavlink.io/en/messages/common.html.
"""

from __future__ import annotations

import struct
from typing import Any, ClassVar

from mavlink_bridge.wire.dialect import common as mavlink


class _Unlisted(mavlink.MAVLink_message):  # type: ignore[misc]  # generated, read without types
    """A message made of its table of fields, in the order of the wire: name, type, length.

    length: 0 where the field is no array. A text is given as bytes.
    """

    table: ClassVar[tuple[tuple[str, str, int], ...]]
    crc_extra: ClassVar[int]
    fieldnames: ClassVar[list[str]]
    ordered_fieldnames: ClassVar[list[str]]
    fieldtypes: ClassVar[list[str]]
    lengths: ClassVar[list[int]]
    unpacker: ClassVar[struct.Struct]

    def __init_subclass__(cls) -> None:
        cls.fieldnames = cls.ordered_fieldnames = [name for name, _, _ in cls.table]
        cls.fieldtypes = [kind for _, kind, _ in cls.table]
        cls.lengths = [1 if kind == "char" else max(n, 1) for _, kind, n in cls.table]
        codes = {"uint64_t": "Q", "uint32_t": "I", "uint16_t": "H", "uint8_t": "B", "char": "s"}
        cls.unpacker = struct.Struct(
            "<" + "".join(f"{n or ''}{codes[kind]}" for _, kind, n in cls.table)
        )
        mavlink.mavlink_map[cls.id] = cls

    def __init__(self, **fields: Any) -> None:
        super().__init__(self.id, self.msgname)
        self._fieldnames = self.fieldnames
        for name, kind, _ in self.table:
            setattr(self, f"_{name}_raw" if kind == "char" else name, fields[name])


class EventMessage(_Unlisted):
    """EVENT; `event_id` is the field `id`."""

    id = 410
    msgname = "EVENT"
    table = (
        ("event_id", "uint32_t", 0),
        ("event_time_boot_ms", "uint32_t", 0),
        ("sequence", "uint16_t", 0),
        ("destination_component", "uint8_t", 0),
        ("destination_system", "uint8_t", 0),
        ("log_levels", "uint8_t", 0),
        ("arguments", "uint8_t", 40),
    )
    crc_extra = 160


class ComponentInformationBasicMessage(_Unlisted):
    """COMPONENT_INFORMATION_BASIC."""

    id = 396
    msgname = "COMPONENT_INFORMATION_BASIC"
    table = (
        ("capabilities", "uint64_t", 0),
        ("time_boot_ms", "uint32_t", 0),
        ("time_manufacture_s", "uint32_t", 0),
        ("vendor_name", "char", 32),
        ("model_name", "char", 32),
        ("software_version", "char", 24),
        ("hardware_version", "char", 24),
        ("serial_number", "char", 32),
    )
    crc_extra = 50
