"""What the first frame of a packet claims to be, and how much of a flood is kept."""

import pytest

from mavlink_bridge.wire import allowance, link
from mavlink_bridge.wire.allowance import Allowance, Claim, Newest, Packet
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.memory import MemoryEndpoint
from mavlink_bridge.wire.messages import Heartbeat, Source
from mavlink_bridge.wire.signing import Signing

KEY, NOW = bytes(range(32)), 400_000_000_0000
BEAT = Heartbeat(12, 2, True, 0x00060000, 4)


def ours(signing):
    return Codec(1, 191, [Source(1, 1)], Signing(KEY, NOW) if signing else None)


def frame(system=1, key=None, at=NOW):
    return Codec(system, 1, signing=None if key is None else Signing(key, at)).encode([BEAT])


def version_1(system=1):
    """A HEARTBEAT of MAVLink 1, by pymavlink's numbers; its checksum is not looked at here."""
    return bytes([0xFE, 9, 0, system, 1, 0]) + bytes(9) + b"\x00\x00"


@pytest.mark.parametrize(
    ("packet", "claim"),
    [
        (frame(), Claim.ACCEPTED),
        (frame() + b"more", Claim.ACCEPTED),
        (frame(key=KEY), Claim.ACCEPTED),  # the signature is not needed, and not looked at
        (frame(key=KEY)[:-1], Claim.GARBAGE),  # but it is not whole
        (frame(key=KEY)[:-13], Claim.GARBAGE),
        (frame()[:-1], Claim.GARBAGE),
        (frame()[:9], Claim.GARBAGE),
        (b"", Claim.GARBAGE),
        (b"\xfc" + frame()[1:], Claim.GARBAGE),
        (frame()[:2] + b"\x02" + frame()[3:], Claim.GARBAGE),  # a flag that nobody knows
        (frame()[:12] + b"\xaa" + frame()[13:], Claim.GARBAGE),  # its checksum is wrong
        (frame(system=7), Claim.FOREIGN),
        (version_1(system=7), Claim.FOREIGN),
        (version_1(), Claim.GARBAGE),
    ],
)
def test_the_first_frame_of_a_packet(packet, claim):
    assert ours(signing=False).claim(packet) is claim


@pytest.mark.parametrize(
    ("packet", "claim"),
    [
        (frame(key=KEY), Claim.ACCEPTED),
        (frame(key=KEY) + b"more", Claim.ACCEPTED),
        (frame(), Claim.UNSIGNED),
        (version_1(), Claim.UNSIGNED),
        (frame(key=bytes(32)), Claim.UNSIGNED),
        (frame(key=KEY)[:-1] + b"\x00", Claim.UNSIGNED),
        (frame(key=KEY, at=NOW - 61 * 100_000), Claim.OLD),
        (frame(system=7, key=KEY), Claim.FOREIGN),
    ],
)
def test_the_first_frame_of_a_packet_where_signatures_count(packet, claim):
    assert ours(signing=True).claim(packet) is claim


def test_a_frame_that_comes_twice_is_old_the_second_time():
    codec, packet = ours(signing=True), frame(key=KEY)
    assert [codec.claim(packet) for _ in range(2)] == [Claim.ACCEPTED, Claim.OLD]


def test_a_tick_reads_so_many_bytes_and_the_next_one_goes_on(monkeypatch):
    monkeypatch.setattr(link, "Allowance", lambda: Allowance(bytes=100))
    vehicle = MemoryEndpoint()
    line = Link(MemoryEndpoint(vehicle), ours(signing=False), Source(1, 1))
    for _ in range(5):
        vehicle.send(bytes(40))
    read = []
    for _ in range(3):
        line.receive()
        read.append(line.packets_in)
    assert read == [3, 5, 5]
    assert line.codec.statistics.bad_bytes == 200


@pytest.mark.parametrize(("share", "kept"), [(1, 256), (8, 32)])
def test_the_newest_packets_are_kept_as_many_as_there_is_room_for(share, kept):
    newest = Newest(share)
    for n in range(kept):
        assert newest.add(Packet(n, b"x", None, Claim.ACCEPTED)) == []
    (dropped,) = newest.add(Packet(kept, b"x", None, Claim.ACCEPTED))
    assert dropped.number == 0
    assert len(newest.packets) == kept


def test_the_newest_packets_are_kept_up_to_so_many_bytes():
    size, newest = allowance._KEPT_BYTES // 4, Newest()
    for n in range(4):
        assert newest.add(Packet(n, bytes(size), None, Claim.ACCEPTED)) == []
    assert [p.number for p in newest.add(Packet(4, bytes(2 * size), None, Claim.ACCEPTED))] == [
        0,
        1,
    ]
