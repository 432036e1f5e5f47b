"""How much a tick reads: each bound at its last packet, byte and message."""

import pytest

from mavlink_bridge.wire.allowance import Allowance, Claim, Newest, Packet

A, B, C = ("10.0.0.1", 1), ("10.0.0.2", 1), ("10.0.0.2", 2)


def test_a_tick_reads_what_the_documentation_says():
    assert Allowance() == Allowance(
        packets=2048,
        bytes=4 * 1024 * 1024,
        messages=300,
        of_strangers=37,
        doubtful_packets=32,
        doubtful_bytes=8192,
    )


@pytest.mark.parametrize("what", ["packets", "bytes", "messages"])
@pytest.mark.parametrize(("left", "spent"), [(1, False), (0, True), (-5, True)])
def test_nothing_more_is_read_once_one_of_the_bounds_is_reached(what, left, spent):
    assert Allowance(**{what: left}).spent is spent


def test_strangers_and_doubtful_packets_do_not_end_the_reading():
    assert not Allowance(of_strangers=0, doubtful_packets=0, doubtful_bytes=0).spent


def test_so_many_doubtful_packets_are_looked_through():
    allowance = Allowance()
    assert [allowance.take_doubtful(1) for _ in range(33)] == [True] * 32 + [False]


@pytest.mark.parametrize(("size", "number"), [(8192, 1), (8191, 2), (4096, 2), (1000, 9)])
def test_so_many_bytes_of_doubtful_packets_are_looked_through(size, number):
    allowance = Allowance()
    taken = [allowance.take_doubtful(size) for _ in range(number + 1)]
    assert taken == [True] * number + [False]


def added(newest, *packets):
    """Numbers of the packets that are dropped as each is added; packets: (address, size)."""
    return [
        [p.number for p in newest.add(Packet(n, bytes(size), place, Claim.ACCEPTED))]
        for n, (place, size) in enumerate(packets)
    ]


def test_who_sends_most_loses_the_oldest_of_its_own():
    newest = Newest.of_strangers()  # 4096 bytes
    dropped = added(newest, (A, 500), (B, 1500), (C, 500), (B, 1500), (A, 500))
    assert dropped == [[], [], [], [], [1]]
    assert [p.number for p in newest.packets] == [0, 2, 3, 4]


def test_room_for_one_packet_may_cost_several():
    newest = Newest.of_strangers()
    assert added(newest, (A, 100), (B, 2000), (B, 1900), (C, 4000)) == [[], [], [], [3]]
    newest = Newest.of_strangers()
    assert added(newest, (A, 100), (B, 2000), (B, 1996), (C, 1950)) == [[], [], [], [1]]
    newest = Newest.of_strangers()
    assert added(newest, (A, 100), (B, 1000), (B, 1000), (B, 1996), (A, 2100))[-1] == [
        1,
        2,
        0,
    ]


def test_bytes_are_counted_to_the_last_and_again_after_a_loss():
    newest = Newest(8)
    assert added(newest, (A, 2048), (A, 2048), (A, 1), (A, 2047)) == [[], [], [0], []]
    assert added(newest, (A, 1))[0] == [1]


def test_one_packet_is_kept_however_large():
    newest = Newest()
    assert added(newest, (A, 60000), (A, 10), (A, 60000)) == [[], [0], [1]]


def test_the_vehicle_loses_its_oldest_whoever_sends_most():
    newest = Newest()  # 32 KiB
    assert added(newest, (A, 1000), (B, 31000), (B, 1000)) == [[], [], [0]]
    assert newest.by_address is False
