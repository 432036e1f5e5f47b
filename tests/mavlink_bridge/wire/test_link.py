"""The peer of a UDP link: stray packets, forged packets, two vehicles with one id."""

import contextlib
import socket

import numpy as np
import pytest

from mavlink_bridge.wire import link as links
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.memory import MemoryEndpoint
from mavlink_bridge.wire.messages import Heartbeat, RateSetpoint, Source
from mavlink_bridge.wire.signing import Signing
from mavlink_bridge.wire.udp import UdpEndpoint
from sitl_sim.faults.catalogue import Schedule
from sitl_sim.faults.link import FaultyLine, FaultyLink

KEY, NOW = bytes(range(32)), 400_000_000_0000
HEARTBEAT = Heartbeat(12, 2, False, 0, 3)
SETPOINT = RateSetpoint(0.0, np.zeros(3), 0.3, 1)
STRAYS = {
    "garbage": b"stray",
    "a vehicle that is not allowed": Codec(9, 1).encode([HEARTBEAT]),
}


def signing(signed):
    return Signing(KEY, NOW) if signed else None


@pytest.fixture
def stray():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        yield s


@pytest.fixture
def pair():
    """Return a function that connects a listening companion and its vehicle."""
    with contextlib.ExitStack() as stack:

        def make(signed=False, kind=Link, **options):
            codec = Codec(1, 191, [Source(1, 1)], signing(signed))
            ours = kind(UdpEndpoint(local=("127.0.0.1", 0)), codec, **options)
            remote = ("127.0.0.1", ours.endpoint.port)
            vehicle = Link(UdpEndpoint(remote=remote), Codec(1, 1, signing=signing(signed)))
            for link in (ours, vehicle):
                stack.callback(link.close)
            return ours, vehicle

        yield make


def waiting(link):
    """Return the messages as soon as the first one arrives."""
    link.wait(2.0)
    return link.receive()


@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("what", STRAYS)
def test_a_stray_packet_does_not_redirect_the_stream(pair, stray, what, signed):
    ours, vehicle = pair(signed)
    here = ("127.0.0.1", ours.endpoint.port)
    stray.sendto(STRAYS[what], here)
    assert waiting(ours) == []
    ours.send([SETPOINT])
    assert ours.packets_out == 0  # no message has been accepted yet
    vehicle.send([HEARTBEAT])
    assert waiting(ours)
    stray.sendto(STRAYS[what], here)
    assert waiting(ours) == []
    ours.send([SETPOINT])
    assert len(waiting(vehicle)) == 1


def test_an_unsigned_packet_of_the_right_vehicle_does_not_redirect_the_stream(pair, stray):
    ours, vehicle = pair(signed=True)
    vehicle.send([HEARTBEAT])
    assert waiting(ours)
    stray.sendto(Codec(1, 1).encode([HEARTBEAT]), ("127.0.0.1", ours.endpoint.port))
    assert waiting(ours) == []
    ours.send([SETPOINT])
    assert len(waiting(vehicle)) == 1


def test_a_vehicle_that_returns_on_another_port_is_answered_there(pair):
    ours, vehicle = pair()
    vehicle.send([HEARTBEAT])
    assert waiting(ours)
    again = Link(UdpEndpoint(remote=("127.0.0.1", ours.endpoint.port)), Codec(1, 1))
    again.send([HEARTBEAT])
    assert waiting(ours)
    ours.send([SETPOINT])
    assert len(waiting(again)) == 1
    again.close()


def test_a_faulty_link_answers_the_accepted_sender_too(pair):
    ours, vehicle = pair(kind=FaultyLink, line=FaultyLine(Schedule([], ["drone1"], 0), 0))
    vehicle.send([HEARTBEAT])
    assert waiting(ours)
    ours.send([SETPOINT])
    assert len(waiting(vehicle)) == 1


def test_a_memory_endpoint_has_one_peer():
    end = MemoryEndpoint()
    ours, vehicle = Link(end, Codec(1, 191)), Link(MemoryEndpoint(end), Codec(1, 1))
    vehicle.send([HEARTBEAT])
    assert ours.receive()
    ours.send([SETPOINT])
    assert len(vehicle.receive()) == 1


def test_of_many_vehicles_with_one_id_two_are_named_and_sixteen_remembered(pair, monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(links.time, "monotonic", lambda: clock[0])
    ours, vehicle = pair()
    for _ in range(40):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
            s.sendto(Codec(1, 1).encode([HEARTBEAT]), ("127.0.0.1", ours.endpoint.port))
            waiting(ours)
    assert ours.problem.startswith("two vehicles with system id 1: 127.0.0.1:")
    assert ours.problem.count("127.0.0.1") == 2
    assert ours.problem.endswith(", and 14 more")
    clock[0] += 4.0
    assert ours.problem == ""
    vehicle.send([HEARTBEAT])
    waiting(ours)
    assert [len(places) for places in ours._senders.values()] == [1]


def test_what_arrives_and_what_leaves_is_tapped_with_its_direction():
    near = MemoryEndpoint()
    ours, vehicle = (
        Link(near, Codec(1, 191, [Source(1, 1)])),
        Link(MemoryEndpoint(near), Codec(1, 1)),
    )
    tapped = []
    ours.tap = lambda *packet: tapped.append(packet)
    vehicle.send([HEARTBEAT])
    assert len(ours.receive()) == 1
    ours.send([SETPOINT])
    beat = Codec(1, 1).encode([HEARTBEAT])
    assert tapped[0] == (False, beat)
    assert [out for out, _ in tapped] == [False, True]
