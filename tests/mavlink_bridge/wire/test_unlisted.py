"""Tables of messages that the generated dialect leaves out."""

import binascii

import pytest

from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.dialect.unlisted import ComponentInformationBasicMessage, EventMessage
from mavlink_bridge.wire.messages import ComponentInformation

NAMES = {"event_id": "id"}  # as the standard calls the field


@pytest.mark.parametrize("kind", [EventMessage, ComponentInformationBasicMessage])
def test_checksums_extra_byte_follows_from_the_table(kind):
    """As https://mavlink.io/en/guide/serialization.html#crc_extra has it: CRC-16/MCRF4XX."""
    told = kind.msgname.encode() + b" "
    for name, type_, length in kind.table:
        told += f"{type_} {NAMES.get(name, name)} ".encode()
        told += bytes([length]) if length else b""
    reverse = bytes(int(f"{byte:08b}"[::-1], 2) for byte in told)
    crc = int(f"{binascii.crc_hqx(reverse, 0xFFFF):016b}"[::-1], 2)
    assert (crc & 0xFF) ^ (crc >> 8) == kind.crc_extra


def test_names_that_are_too_long_end_with_a_zero():
    told = ComponentInformation(1.0, 0, "v" * 40, "m" * 40, "s" * 40, "n" * 40)
    (heard,) = Codec(1, 1).decode(Codec(1, 191).encode([told]))
    m = heard.message
    assert (m.vendor, m.model, m.software) == ("v" * 31, "m" * 31, "s" * 23)
    assert m.serial == "n" * 31
