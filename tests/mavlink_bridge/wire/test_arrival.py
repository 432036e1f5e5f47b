"""When a datagram arrived, however long it waits to be read."""

import contextlib
import itertools
import socket
import struct
import time

import numpy as np
import pytest

from mavlink_bridge.wire import arrival
from mavlink_bridge.wire.arrival import ArrivalClock, stamp_arrivals
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.memory import MemoryEndpoint
from mavlink_bridge.wire.messages import Attitude, Heartbeat, Source
from mavlink_bridge.wire.udp import UdpEndpoint

WAITED = 0.12  # s
CLOSE = 0.03  # s, on a machine with much else to do


@pytest.fixture
def ours():
    with contextlib.closing(UdpEndpoint(local=("127.0.0.1", 0))) as endpoint:
        yield endpoint


@pytest.fixture
def vehicle(ours):
    with contextlib.closing(UdpEndpoint(remote=("127.0.0.1", ours.port))) as endpoint:
        yield endpoint


def test_datagrams_that_waited_are_dated_by_when_they_arrived(ours, vehicle):
    sent = []
    for data in (b"1", b"2", b"3"):
        sent.append(time.monotonic())
        vehicle.send(data)
        time.sleep(WAITED)
    came = [(data, ours.arrived) for data in ours.receive()]
    assert [data for data, _ in came] == [b"1", b"2", b"3"]
    for at, (_, arrived) in zip(sent, came, strict=True):
        assert at - 1e-3 <= arrived <= at + CLOSE
    assert ours.stamps


def test_so_are_those_of_a_pinned_address_and_those_that_came_before_it_was_pinned(ours, vehicle):
    first = time.monotonic()
    vehicle.send(b"1")
    time.sleep(WAITED)
    ours.pin(("127.0.0.1", vehicle.port))
    second = time.monotonic()
    vehicle.send(b"2")
    time.sleep(WAITED)
    (one, two) = [ours.arrived for _ in ours.receive()]
    assert one == pytest.approx(first, abs=CLOSE)
    assert two == pytest.approx(second, abs=CLOSE)


def test_each_message_of_a_link_has_the_time_of_its_packet(ours, vehicle):
    link, wire, sent = Link(ours, Codec(2, 1), Source(1, 1)), Codec(1, 1), []
    for n in range(2):
        sent.append(time.monotonic())
        level = Attitude(float(n), np.array([1.0, 0, 0, 0]), np.zeros(3))
        vehicle.send(wire.encode([Heartbeat(12, 2, False, n, 4), level]))
        time.sleep(WAITED)
    heard = [r.arrived for r in link.receive()]
    assert heard == [heard[0], heard[0], heard[2], heard[2]]
    assert heard[0] == pytest.approx(sent[0], abs=CLOSE)
    assert heard[2] == pytest.approx(sent[1], abs=CLOSE)
    assert link.stamps


def test_what_comes_without_a_stamp_has_no_time():
    ours = MemoryEndpoint()
    MemoryEndpoint(ours).send(Codec(1, 1).encode([Heartbeat(12, 2, False, 0, 4)]))
    link = Link(ours, Codec(2, 1))
    (heard,) = link.receive()
    assert heard.arrived is None
    assert not link.stamps


def stamp(wall):
    """Ancillary data of a datagram that arrived at a wall time [ns]."""
    return [(socket.SOL_SOCKET, 35, struct.pack("@ll", *divmod(wall, 10**9)))]


@pytest.fixture
def clocks(monkeypatch):
    """Both clocks [s], set by the test: [monotonic, wall]."""
    now = [100.0, 1000.0]
    monkeypatch.setattr(arrival.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(arrival.time, "clock_gettime", lambda clock: now[1])
    return now


@pytest.mark.parametrize("by", [-3600.0, -0.05, 0.05, 3600.0])
def test_where_the_wall_clock_was_set_no_stamp_is_believed_once(clocks, by):
    clock = ArrivalClock()
    clocks[:] = [100.1, 1000.1 + by]
    clock.look()
    assert clock.arrived(stamp(1000_060_000_000)) == 100.1
    clocks[:] = [100.2, 1000.2 + by]
    clock.look()
    before = stamp(round((1000.17 + by) * 1e9))
    assert clock.arrived(before) == pytest.approx(100.17)


def test_a_wall_clock_that_is_slewed_is_followed(clocks):
    clock, arrived = ArrivalClock(), []
    for n in range(1, 100):
        clocks[:] = [100.0 + n, 1000.0 + 1.0005 * n]
        clock.look()
        arrived.append(clock.arrived(stamp(round((clocks[1] - 0.5) * 1e9))))
    assert arrived == pytest.approx([99.5 + n for n in range(1, 100)])


def test_nothing_arrives_after_it_was_read_and_notes_of_other_kinds_are_none(clocks):
    clock = ArrivalClock()
    clock.look()
    assert clock.arrived(stamp(1000_500_000_000)) == 100.0
    assert clock.arrived([]) == 100.0
    assert clock.arrived([(socket.SOL_SOCKET, 36, b"")]) == 100.0


def test_a_socket_that_cannot_stamp_says_so():
    closed = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    closed.close()
    assert not stamp_arrivals(closed)


def test_times_of_one_reading_never_go_back(ours, vehicle):
    for n in range(50):
        vehicle.send(b"%d" % n)
    times = [ours.arrived for _ in ours.receive()]
    assert len(times) == 50
    assert all(a <= b for a, b in itertools.pairwise(times))
