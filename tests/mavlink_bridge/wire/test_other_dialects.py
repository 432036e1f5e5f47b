"""Frames of messages that this project does not know: skipped whole, and counted apart."""

import hashlib
import struct

import pytest

from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.messages import Heartbeat, Source
from mavlink_bridge.wire.signing import Signing
from mavlink_bridge.wire.udp import UdpEndpoint

KEY, NOW = bytes(range(32)), 400_000_000_0000
VEHICLE, MESSAGE = Source(1, 1), 0xEEEEE
BODY = bytes(range(60, 90))


def beats(count):
    """HEARTBEAT frames of the vehicle, sequence numbers from 0 on."""
    codec = Codec(1, 1)
    return [codec.encode([Heartbeat(12, 2, True, 0, 4)]) for _ in range(count)]


def unknown(sequence, source=VEHICLE, body=BODY, stamp=None, key=KEY):
    """A frame by mavlink.io/en/guide/serialization; its checksum cannot be verified."""
    head = bytes([len(body), stamp is not None, 0, sequence, source.system, source.component])
    frame = b"\xfd" + head + MESSAGE.to_bytes(3, "little") + body + struct.pack("<H", 0x1234)
    if stamp is None:
        return frame
    frame += b"\0" + stamp.to_bytes(6, "little")
    return frame + hashlib.sha256(key + frame).digest()[:6]


def read(codec, packet, whole):
    return codec.decode_datagram(packet) if whole else codec.decode(packet)


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("between", [b"", b"\n", b"boot: 7.3 V\r\n"])
def test_between_the_vehicles_frames_it_is_skipped_by_its_length(between, whole):
    codec, known = Codec(1, 191, [VEHICLE]), beats(3)
    packet = known[0] + unknown(1) + between + known[2]
    received = read(codec, packet, whole)
    assert [r.message.armed for r in received] == [True, True]
    assert sum(r.missing for r in received) == 0  # it explains the gap in the numbers
    assert (codec.statistics.unknown, codec.statistics.bad_bytes) == (1, len(between))


@pytest.mark.parametrize("whole", [True, False])
def test_a_frame_within_garbage_that_looks_like_one_is_found(whole):
    """Forty bytes that begin like a long frame of a stranger would swallow the heartbeats."""
    codec, known = Codec(1, 191, [VEHICLE]), beats(2)
    packet = unknown(0, Source(9, 9), b"\0" * 200)[:40] + known[0] + known[1] + b"\n" * 200
    assert len(read(codec, packet, whole)) == 2
    assert codec.statistics.unknown == 0


def test_one_of_a_sender_that_is_not_heard_is_foreign():
    codec = Codec(1, 191, [VEHICLE])
    codec.decode_datagram(unknown(0, Source(2, 1)))
    assert (codec.statistics.foreign, codec.statistics.unknown) == (1, 0)


@pytest.mark.parametrize(
    ("stamps", "key", "expected"),
    [
        ([NOW + 1], KEY, (1, 0, 0)),
        ([None], KEY, (0, 1, 0)),
        ([NOW + 1], bytes(32), (0, 1, 0)),
        ([NOW + 1, NOW + 1], KEY, (1, 0, 1)),
    ],
)
def test_with_signing_only_a_signed_one_explains_a_gap(stamps, key, expected):
    """Forged frames of an unknown kind would hide how many of the vehicle's get lost."""
    codec = Codec(1, 191, [VEHICLE], Signing(KEY, NOW))
    for n, stamp in enumerate(stamps):
        assert codec.decode_datagram(unknown(n, stamp=stamp, key=key)) == []
    s = codec.statistics
    assert (s.unknown, s.unsigned, s.replayed) == expected
    assert s.bad_bytes == 0


def test_one_alone_makes_no_address_the_vehicles():
    """Without a checksum that holds, anything may have been said by anybody."""
    vehicle, stranger = UdpEndpoint(local=("127.0.0.1", 0)), UdpEndpoint(local=("127.0.0.1", 0))
    ours = UdpEndpoint(local=("127.0.0.1", 0))
    link = Link(ours, Codec(1, 191, [VEHICLE]), VEHICLE)
    port = ours._socket.getsockname()[1]
    stranger._socket.sendto(unknown(0), ("127.0.0.1", port))
    link.wait(1.0)
    assert link.receive() == []
    assert link.address == ""
    vehicle._socket.sendto(beats(1)[0], ("127.0.0.1", port))
    link.wait(1.0)
    assert len(link.receive()) == 1
    assert link.address.endswith(str(vehicle._socket.getsockname()[1]))
    for end in (vehicle, stranger, ours):
        end.close()


@pytest.mark.parametrize(
    ("number", "after", "frames"), [(1, b"boot", 1), (99, b"boot", 0), (99, b"", 1)]
)
def test_it_is_one_where_a_frame_comes_next_or_its_number_does(number, after, frames):
    codec, known = Codec(1, 191, [VEHICLE]), beats(2)
    codec.decode_datagram(known[0])
    codec.decode_datagram(unknown(number) + after + known[1])
    assert codec.statistics.unknown == frames
