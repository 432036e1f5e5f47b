"""Makes mavlink_bridge/wire/dialect/common.py of pymavlink's common dialect: `make dialect`.

    python -m tests.mavlink_bridge.wire.dialect_file > FILE

pymavlink's own module of it holds classes for 210 messages and a description of every number; a
companion that imports it waits 0.1 s and takes 11 MB more, and uses sixty messages.
"""

import inspect
import sys

from pymavlink.dialects.v20 import common as theirs

# Enumerations whose numbers the translations use.
ENUMERATIONS = (
    "GPS_FIX_TYPE",
    "GPS_INPUT_IGNORE_FLAGS",
    "MAV_BATTERY_FUNCTION",
    "MAV_BATTERY_TYPE",
    "MAV_FRAME",
    "MAV_MODE_FLAG",
)
_HEAD = '''"""Messages of MAVLink's common dialect, and numbers of some of its enumerations.

`make dialect` writes this file from pymavlink's common.xml (MIT licence): do not edit it. Each row:
id, name, extra byte of the checksum, format of the payload, fields in the order of the standard,
fields in the order of the wire, number of extension fields.
"""
'''


def text():
    """The whole file."""
    lines = [_HEAD]
    for enumeration in ENUMERATIONS:
        for number, entry in theirs.enums[enumeration].items():
            if not entry.name.endswith("_ENUM_END"):
                lines.append(f"{entry.name} = {number}")
    lines += ["", "MESSAGES = ("]
    for number, kind in sorted(theirs.mavlink_map.items()):
        lines.append(f"    {_row(number, kind)!r},")
    return "\n".join([*lines, ")", ""])


def _row(number, kind):
    parameters = inspect.signature(kind.__init__).parameters.values()
    extensions = sum(p.default is not inspect.Parameter.empty for p in parameters)
    fields, wire = " ".join(kind.fieldnames), " ".join(kind.ordered_fieldnames)
    return number, kind.msgname, kind.crc_extra, kind.unpacker.format, fields, wire, extensions


if __name__ == "__main__":
    sys.stdout.write(text())
