"""One UDP port: its peer, the vehicle's own queue, and what is left where the kernel refuses."""

import contextlib
import itertools
import socket

import pytest

from mavlink_bridge.wire import udp
from mavlink_bridge.wire.udp import EndpointError, UdpEndpoint

HERE = ("127.0.0.1", 0)


@pytest.fixture
def ports():
    """A function that opens a socket of its own on the loopback."""
    with contextlib.ExitStack() as stack:

        def make():
            port = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            port.bind(HERE)
            return port

        yield make


@pytest.fixture
def ours():
    with contextlib.closing(UdpEndpoint(local=HERE)) as endpoint:
        yield endpoint


def to(endpoint, port, *packets):
    for data in packets:
        port.sendto(data, ("127.0.0.1", endpoint.port))


def came(endpoint, **options):
    """Each datagram that has arrived, and its sender."""
    return [(data, endpoint.sender) for data in endpoint.receive(**options)]


def test_datagrams_come_in_order_each_with_its_sender(ours, ports):
    a, b = ports(), ports()
    to(ours, a, b"1")
    to(ours, b, b"2")
    to(ours, a, b"", b"3")
    at, bt = a.getsockname(), b.getsockname()
    assert came(ours) == [(b"1", at), (b"2", bt), (b"", at), (b"3", at)]
    assert came(ours) == []


def test_a_datagram_may_be_as_large_as_udp_allows(ours, ports):
    to(ours, ports(), bytes(65507))
    ((data, _),) = came(ours)
    assert len(data) == 65507


def test_what_came_before_the_address_was_pinned_is_kept_in_order(ours, ports):
    vehicle, other = ports(), ports()
    to(ours, vehicle, b"1")
    to(ours, other, b"2")
    to(ours, vehicle, b"3")
    ours.pin(vehicle.getsockname())
    to(ours, vehicle, b"4")
    v, o = vehicle.getsockname(), other.getsockname()
    assert came(ours) == [(b"1", v), (b"2", o), (b"3", v), (b"4", v)]


def test_strangers_come_first_and_few_and_only_where_they_are_asked_for(ours, ports, monkeypatch):
    vehicle, other = ports(), ports()
    ours.pin(vehicle.getsockname())
    to(ours, vehicle, b"own")
    to(ours, other, *(b"%d" % n for n in range(5)))
    monkeypatch.setattr(udp, "_STRANGERS", 2)
    assert [data for data, _ in came(ours, strangers=False)] == [b"own"]
    to(ours, vehicle, b"next")
    assert [data for data, _ in came(ours)] == [b"0", b"1", b"next"]
    assert [data for data, _ in came(ours)] == [b"2", b"3"]


def test_strangers_have_a_small_queue_once_the_vehicle_is_pinned(ours, ports):
    vehicle, other = ports(), ports()
    ours.pin(vehicle.getsockname())
    to(ours, other, *[bytes(1000)] * 1000)
    to(ours, vehicle, *[bytes(1000)] * 100)
    number, strangers = len(came(ours, strangers=False)), len(came(ours))
    assert number == 100
    assert 10 < strangers < 256


def test_only_what_the_vehicle_sends_wakes_who_waits(ours, ports):
    vehicle, other = ports(), ports()
    unpinned = ours.fileno()
    ours.pin(vehicle.getsockname())
    assert ours.fileno() not in (unpinned, -1)
    first = ours.fileno()
    ours.pin(other.getsockname())
    ours.send(b"to the new one")
    assert other.recv(64) == b"to the new one"
    assert ours.fileno() != unpinned
    to(ours, vehicle, b"old")
    to(ours, other, b"new")
    assert [data for data, _ in came(ours, strangers=False)] == [b"new"]
    assert first >= 0


def test_where_the_vehicle_gets_no_queue_of_its_own_one_for_all_is_left(ours, ports):
    vehicle, other = ports(), ports()
    common = ours.fileno()
    for _ in range(2):
        ours.pin(("255.255.255.255", 9))  # connect() refuses a broadcast address
        assert ours.fileno() == common
        to(ours, vehicle, b"a")
        to(ours, other, b"b")
        assert [data for data, _ in came(ours)] == [b"a", b"b"]
    ours.pin(vehicle.getsockname())
    assert ours.fileno() != common
    ours.pin(("255.255.255.255", 9))  # so that it has none any more
    assert ours.fileno() == common
    to(ours, vehicle, b"c")
    assert [data for data, _ in came(ours)] == [b"c"]


@pytest.mark.parametrize("address", ["vehicle", ("255.255.255.255", 9)])
def test_no_other_may_bind_the_port_after_an_address_was_pinned(ours, ports, address):
    ours.pin(ports().getsockname() if address == "vehicle" else address)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as thief:
        thief.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with pytest.raises(OSError, match="Address already in use"):
            thief.bind(("127.0.0.1", ours.port))


def test_a_given_peer_stays_whoever_is_pinned_or_answered(ports):
    peer, other = ports(), ports()
    with contextlib.closing(UdpEndpoint(remote=peer.getsockname())) as endpoint:
        endpoint.send(b"hello")
        assert peer.recvfrom(64) == (b"hello", ("127.0.0.1", endpoint.port))
        to(endpoint, other, b"stray")
        assert [data for data, _ in came(endpoint)] == [b"stray"]
        endpoint.answer_sender()
        assert endpoint.remote == peer.getsockname()
        endpoint.pin(other.getsockname())
        assert endpoint.remote == peer.getsockname()


def test_the_peer_is_the_last_sender_that_is_answered(ours, ports):
    a = ports()
    assert not ours.send(b"nobody")
    to(ours, a, b"x")
    assert [data for data, _ in came(ours)] == [b"x"]
    assert not ours.send(b"nobody yet")
    ours.answer_sender()
    assert ours.send(b"y")
    assert a.recv(64) == b"y"


def test_what_cannot_be_sent_is_told(ours, ports):
    ours.pin(ports().getsockname())
    assert not ours.send(bytes(70000))
    assert ours.send(bytes(60000))


class Line:
    """A socket that raises errors, then has packets."""

    def __init__(self, *results):
        self._results = iter(results)

    def recvmsg(self, size, notes):
        result = next(self._results, BlockingIOError())
        if isinstance(result, Exception):
            raise result
        return result, [], 0, ("127.0.0.1", 1)


@pytest.mark.parametrize(("errors", "packets"), [(15, [b"a"]), (16, [])])
def test_packets_that_found_no_listener_hide_no_later_one_unless_too_many(ours, errors, packets):
    line = Line(*itertools.repeat(ConnectionRefusedError(), errors), b"a")
    assert list(ours._read(line)) == packets


def test_errors_count_in_each_reading_anew(ours):
    line = Line(
        *([ConnectionRefusedError()] * 15), BlockingIOError(), ConnectionRefusedError(), b"a"
    )
    assert list(ours._read(line)) == []
    assert list(ours._read(line)) == [b"a"]


def test_a_port_that_is_taken_is_named(ours):
    with pytest.raises(EndpointError) as caught:
        UdpEndpoint(local=("127.0.0.1", ours.port))
    assert str(caught.value) == f"UDP 127.0.0.1:{ours.port} cannot be bound: Address already in use"


def test_closing_frees_the_port(ports):
    endpoint = UdpEndpoint(local=HERE)
    port = endpoint.port
    endpoint.pin(ports().getsockname())
    endpoint.close()
    assert endpoint.fileno() == -1
    with contextlib.closing(UdpEndpoint(local=("127.0.0.1", port))) as again:
        assert again.port == port
