"""Tables of messages that pymavlink's dialect leaves out."""

import binascii
import re
import struct

import pytest

from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.dialect import FROM_WIRE
from mavlink_bridge.wire.dialect.layout import UNLISTED
from mavlink_bridge.wire.dialect.unpack import unpacked
from mavlink_bridge.wire.messages import ComponentInformation, Event

NAMES = {"event_id": "id"}  # as the standard calls the field
TYPES = {"B": "uint8_t", "H": "uint16_t", "I": "uint32_t", "Q": "uint64_t", "s": "char"}


@pytest.mark.parametrize("row", UNLISTED, ids=[row[1] for row in UNLISTED])
def test_checksums_extra_byte_follows_from_the_table(row):
    """As https://mavlink.io/en/guide/serialization.html#crc_extra has it: CRC-16/MCRF4XX."""
    _, name, extra, form, fields, wire, extensions = row
    assert (fields, extensions) == (wire, 0)
    told = name.encode() + b" "
    parts = re.findall(r"(\d*)([a-zA-Z])", form)
    for field, (length, code) in zip(wire.split(), parts, strict=True):
        told += f"{TYPES[code]} {NAMES.get(field, field)} ".encode()
        told += bytes([int(length)]) if length else b""
    reverse = bytes(int(f"{byte:08b}"[::-1], 2) for byte in told)
    crc = int(f"{binascii.crc_hqx(reverse, 0xFFFF):016b}"[::-1], 2)
    assert (crc & 0xFF) ^ (crc >> 8) == extra


def test_names_that_are_too_long_end_with_a_zero():
    told = ComponentInformation(1.0, 0, "v" * 40, "m" * 40, "s" * 40, "n" * 40)
    (heard,) = Codec(1, 1).decode(Codec(1, 191).encode([told]))
    m = heard.message
    assert (m.vendor, m.model, m.software) == ("v" * 31, "m" * 31, "s" * 23)
    assert m.serial == "n" * 31


ARGUMENTS = bytes([1, 2, 3, 4, 5]).ljust(40, b"\0")
PAYLOADS = [
    # 0xF2: for no log of the autopilot's own, and of severity 2.
    pytest.param(
        struct.pack("<IIHBBB40s", 0x0102089D, 2003, 300, 0, 0, 0xF2, ARGUMENTS),
        Event(2.003, 0x0102089D, 300, 2, ARGUMENTS),
        id="EVENT",
    ),
    pytest.param(
        struct.pack("<QII32s32s24s24s32s", 8196, 2003, 0, b"swarm", b"drone", b"0.1", b"", b"77"),
        ComponentInformation(2.003, 8196, "swarm", "drone", "0.1", "77"),
        id="COMPONENT_INFORMATION_BASIC",
    ),
]


@pytest.mark.parametrize(("payload", "message"), PAYLOADS)
def test_the_fields_are_written_and_read_in_the_order_of_the_standard(payload, message):
    frame = Codec(1, 191).encode([message])
    assert frame[10:-2] == payload.rstrip(b"\0")
    assert [r.message for r in Codec(1, 1).decode(frame)] == [message]


def test_an_event_for_the_autopilots_own_log_has_the_severity_of_the_other_half():
    payload = struct.pack("<IIHBBB40s", 7, 0, 0, 0, 0, 0x43, bytes(40))
    assert FROM_WIRE[410](unpacked(410, payload)).severity == 3


def test_arguments_of_an_event_that_are_left_out_are_zero():
    frame = Codec(1, 191).encode([Event(1.0, 7, 1, 2, b"\5")])
    assert Codec(1, 1).decode(frame)[0].message.arguments == bytes([5]).ljust(40, b"\0")


def test_a_name_that_is_no_text_is_replaced():
    payload = struct.pack("<QII32s32s24s24s32s", 0, 0, 0, *[b"\xffno \xc3\xa9"] * 5)
    read = FROM_WIRE[396](unpacked(396, payload))
    assert [read.vendor, read.model, read.software, read.serial] == ["\ufffdno é"] * 4
