"""What a link counts: packets, refusals by their kind, reconnections, ages."""

import math

import numpy as np
import pytest

from mavlink_bridge.wire import link as links
from mavlink_bridge.wire.allowance import Allowance, Claim
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link, parse_endpoint
from mavlink_bridge.wire.memory import MemoryEndpoint
from mavlink_bridge.wire.messages import Attitude, Heartbeat, RateSetpoint, Source
from mavlink_bridge.wire.udp import EndpointError

HEARTBEAT = Heartbeat(12, 2, False, 0, 3)
SETPOINT = RateSetpoint(0.0, np.zeros(3), 0.3, 1)
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


VEHICLE = Source(1, 1)


def pair(allow=(VEHICLE,)):
    """Our link, and the other end of its line."""
    other = MemoryEndpoint()
    return Link(MemoryEndpoint(other), Codec(1, 191, list(allow))), other


def test_packets_are_counted_both_ways():
    line, other = pair()
    vehicle = Codec(1, 1)
    for _ in range(3):
        other.send(vehicle.encode([HEARTBEAT]))
    assert len(line.receive()) == 3
    line.send([SETPOINT, HEARTBEAT])  # in one packet
    line.send([SETPOINT])
    line.send([])
    assert (line.packets_in, line.packets_out) == (3, 2)
    assert len(list(other.receive())) == 2


def test_packets_that_are_passed_on_are_counted_and_tapped():
    line, other = pair()
    tapped = []
    line.tap = lambda sent, data: tapped.append((sent, data))
    for data in (b"one", b"two"):
        other.send(data)
    assert list(line.receive_packets()) == [b"one", b"two"]
    line.send_packets([b"three", b"four"])
    assert (line.packets_in, line.packets_out) == (2, 2)
    assert tapped == [(False, b"one"), (False, b"two"), (True, b"three"), (True, b"four")]


def test_what_nobody_takes_is_not_counted_as_sent():
    alone = Link(MemoryEndpoint(), Codec(1, 191))
    alone.tap = lambda sent, data: pytest.fail("nothing was sent")
    alone.send([HEARTBEAT])
    assert alone.packets_out == 0


def test_what_is_beyond_the_doubtful_share_is_counted_by_its_kind(monkeypatch):
    monkeypatch.setattr(links, "Allowance", lambda: Allowance(doubtful_packets=0))
    line, other = pair()
    foreign = Codec(9, 1).encode([HEARTBEAT])
    for data in (b"garbage", foreign, foreign, b"xx", foreign):
        other.send(data)
    assert line.receive() == []
    statistics = line.codec.statistics
    assert (statistics.bad_bytes, statistics.foreign, statistics.dropped) == (9, 3, 0)
    assert line.packets_in == 5


@pytest.mark.parametrize(
    ("claim", "name", "count"),
    [
        (Claim.GARBAGE, "bad_bytes", 70),
        (Claim.OLD, "replayed", 3),
        (Claim.FOREIGN, "foreign", 3),
        (Claim.UNSIGNED, "unsigned", 3),
        (Claim.ACCEPTED, "dropped", 70),
    ],
)
def test_refused_packets_are_counted_under_one_name(claim, name, count):
    codec = Codec(1, 191)
    codec.refuse(claim, 2, 50)
    codec.refuse(claim, 1, 20)
    found = vars(codec.statistics)
    assert {k: v for k, v in found.items() if v} == {name: count}


def test_a_frame_of_an_unknown_message_is_found_with_its_bytes():
    known = Codec(1, 1).encode([HEARTBEAT])
    unknown = bytearray(known)
    unknown[7:10] = (54321).to_bytes(3, "little")
    codec = Codec(1, 191)
    (frame,) = codec.frames(bytes(unknown))
    assert (frame.source, frame.sequence, frame.message_id) == (Source(1, 1), 0, 54321)
    assert frame.data == bytes(unknown)
    assert not frame.verified
    assert codec.read([frame]) == []
    assert codec.statistics.unknown == 1


def test_ages_are_by_sender_and_kind(monkeypatch):
    now = [50.0]
    monkeypatch.setattr(links.time, "monotonic", lambda: now[0])
    line, other = pair(allow=[Source(1, 1), Source(1, 2)])
    assert line.age(Heartbeat, 1) == math.inf
    other.send(Codec(1, 1).encode([HEARTBEAT, Attitude(0.0, LEVEL, np.zeros(3))]))
    line.receive()
    now[0] += 1.5
    other.send(Codec(1, 2).encode([HEARTBEAT]))
    line.receive()
    now[0] += 1.0
    assert (line.age(Heartbeat, 1), line.age(Attitude, 1)) == (2.5, 2.5)
    assert (line.age(Heartbeat, 1, 2), line.age(Attitude, 1, 2)) == (1.0, math.inf)
    assert line.age(Heartbeat, 2) == math.inf


def test_a_tick_makes_so_many_messages_the_newest(monkeypatch):
    monkeypatch.setattr(links, "Allowance", lambda: Allowance(messages=3))
    line, other = pair()
    vehicle = Codec(1, 1)
    for n in range(5):
        other.send(vehicle.encode([Attitude(float(n), LEVEL, np.zeros(3))]))
    assert [r.message.time for r in line.receive()] == [2.0, 3.0, 4.0]
    assert line.spent
    other.send(vehicle.encode([Attitude(9.0, LEVEL, np.zeros(3))]))
    assert line.receive(renew=False) == []  # it has read what it may
    assert [r.message.time for r in line.receive()] == [9.0]
    assert not line.spent


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("udpin:0.0.0.0:14540", ("udpin", "0.0.0.0", 14540)),
        ("udpout:fc.local:65535", ("udpout", "fc.local", 65535)),
        ("tcp:127.0.0.1:0", ("tcp", "127.0.0.1", 0)),
        ("serial:/dev/ttyAMA0:921600", ("serial", "/dev/ttyAMA0", 921600)),
        (
            "serial:/dev/serial/by-id/usb-x:y:115200",
            ("serial", "/dev/serial/by-id/usb-x:y", 115200),
        ),
    ],
)
def test_an_endpoint_is_a_kind_a_place_and_a_number(name, parts):
    assert parse_endpoint(name) == parts


@pytest.mark.parametrize(
    "name",
    ["", "udpin", "udpin:14540", "udpin::14540", "udp:h:1", "tcp:h:", "tcp:h:-1", "tcp:h:65536",
     "tcp:h:1.5", "udpout:a..b:1", "serial:/dev/x", "serial::115200", "serial:/dev/x:9601"],
)  # fmt: skip
def test_what_is_no_endpoint_is_refused_with_the_valid_forms(name):
    with pytest.raises(EndpointError) as caught:
        parse_endpoint(name)
    text = str(caught.value)
    assert "udpin:HOST:PORT, udpout:HOST:PORT" in text or "57600, 115200" in text
