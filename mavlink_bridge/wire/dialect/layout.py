"""How the payload of each message is laid out: fields by name, in the order of the wire.

The tables are those of `common.py`, and of messages that pymavlink's dialect leaves out: EVENT is
sent by PX4; COMPONENT_INFORMATION_BASIC is what the companion says of itself.
Source: https://mavlink.io/en/guide/serialization.html and messages/common.html.
"""

from __future__ import annotations

import re
import struct
from collections import namedtuple
from functools import cache
from typing import Any

from mavlink_bridge.wire.dialect.common import MESSAGES

Row = tuple[int, str, int, str, str, str, int]
# The field `id` of EVENT is `event_id` here.
_EVENT = (
    "event_id event_time_boot_ms sequence destination_component destination_system log_levels "
    "arguments"
)
_INFORMATION = (
    "capabilities time_boot_ms time_manufacture_s vendor_name model_name software_version "
    "hardware_version serial_number"
)
UNLISTED: tuple[Row, ...] = (
    (410, "EVENT", 160, "<IIHBBB40B", _EVENT, _EVENT, 0),
    (
        396,
        "COMPONENT_INFORMATION_BASIC",
        50,
        "<QII32s32s24s24s32s",
        _INFORMATION,
        _INFORMATION,
        0,
    ),
)
_ROWS: dict[int, Row] = {row[0]: row for row in (*MESSAGES, *UNLISTED)}
NUMBERS = {row[1]: row[0] for row in _ROWS.values()}
CRC_EXTRA = {row[0]: row[2] for row in _ROWS.values()}


class Layout:
    """A payload's format; made where the first message of its kind comes or goes.

    form: of all values. lengths: how many values each field has, in the order of the wire. flat: no
    field is an array. texts: indices of fields that are text. sent: a named tuple of the fields in
    the order of the standard, extensions zero where they are left out; its `layout` is this one.
    order: places in it of the fields in the order of the wire. read: a named tuple of the fields
    in that order, with `msgname`.
    """

    def __init__(self, message_id: int) -> None:
        self.number, name, _, form, fields, wire, extensions = _ROWS[message_id]
        self.form = struct.Struct(form)
        names, read = fields.split(), wire.split()
        parts = re.findall(r"(\d*)([a-zA-Z])", form)
        self.lengths = [1 if code == "s" else int(count or 1) for count, code in parts]
        self.texts = [n for n, (_, code) in enumerate(parts) if code in "sc"]
        self.flat = max(self.lengths) == 1
        self.order = [names.index(field) for field in read]
        make: Any = namedtuple  # names are known to run-time alone
        self.read: Any = make(name, read)
        self.read.msgname = name
        left_out = names[len(names) - extensions :]
        zeros = [self._zero(read.index(field)) for field in left_out]
        self.sent: Any = make(name, names, defaults=zeros)
        self.sent.layout = self

    def _zero(self, n: int) -> Any:
        """Return the value of a field that is left out."""
        if n in self.texts:
            return b""
        return (0,) * self.lengths[n] if self.lengths[n] > 1 else 0


layout = cache(Layout)


@cache
def message(name: str) -> Any:
    """Return the named tuple that makes the fields of a message to send."""
    return layout(NUMBERS[name]).sent
