"""Fields of payloads, compared with pymavlink's own decoding."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from mavlink_bridge.wire import codec
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.dialect import FROM_WIRE
from mavlink_bridge.wire.dialect.unpack import unpacked
from mavlink_bridge.wire.messages import Heartbeat

UNLISTED = {396, 410}  # pymavlink does not know them; test_unlisted.py checks their tables


def test_all_but_unlisted_ones_are_compared():
    assert FROM_WIRE.keys() - mavlink.mavlink_map.keys() <= UNLISTED


@pytest.mark.parametrize("message_id", sorted(FROM_WIRE.keys() - UNLISTED))
@pytest.mark.parametrize("cut", [0, 3])
def test_fields_are_those_of_pymavlink(message_id, cut):
    kind = mavlink.mavlink_map[message_id]
    size = kind.unpacker.size
    payload = np.random.default_rng(message_id).integers(1, 127, size, np.uint8).tobytes()
    payload = payload[: max(size - cut, 1)]  # zeros at the end are not sent
    frame = bytearray([0xFD, len(payload), 0, 0, 7, 1, 1, *message_id.to_bytes(3, "little")])
    crc = mavlink.x25crc(bytes(frame[1:]) + payload + bytes([kind.crc_extra])).crc
    theirs = mavlink.MAVLink(None).decode(frame + payload + crc.to_bytes(2, "little"))
    ours = unpacked(message_id, payload)
    assert ours.msgname == theirs.get_type()
    for name in kind.fieldnames:
        value, expected = getattr(ours, name), getattr(theirs, name)
        value = value.decode() if isinstance(value, bytes) else value
        assert np.array_equal(value, expected, equal_nan=not isinstance(expected, str)), name


def test_a_text_ends_at_its_first_zero():
    assert unpacked(253, b"\x04abc\0def").text == b"abc"  # STATUSTEXT


def test_a_frame_that_is_repeated_is_converted_once(monkeypatch):
    made = []
    monkeypatch.setattr(codec, "unpacked", lambda *a: made.append(a) or unpacked(*a))
    sender, reader = Codec(1, 1), Codec(2, 1)
    frames = [sender.encode([Heartbeat(12, 2, False, n, 4)]) for n in range(3)]
    heard = [r for data in frames * 5 for r in reader.decode_datagram(data)]
    assert [r.message.custom_mode for r in heard] == [0, 1, 2] * 5
    assert len(made) == 3
