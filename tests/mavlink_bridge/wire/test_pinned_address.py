"""The address of the vehicle among other senders: setpoints go there and nowhere else."""

import socket

import numpy as np
import pytest

from mavlink_bridge.wire import link as links
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.messages import RateSetpoint, Source
from mavlink_bridge.wire.signing import Signing
from tests.mavlink_bridge.wire.hostile_packets import (
    KEY,
    ME,
    NOW,
    VEHICLE,
    companion_and_senders,
    heartbeat,
    received,
)

SETPOINT = RateSetpoint(0.0, np.zeros(3), 0.3, 1)


@pytest.fixture
def clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(links.time, "monotonic", lambda: now[0])
    return now


@pytest.fixture
def udp():
    with companion_and_senders() as ends:
        yield ends


def got(sender):
    sender.setblocking(False)
    count = 0
    try:
        while sender.recv(2000):
            count += 1
    except BlockingIOError:
        return count


@pytest.mark.row("30")
def test_every_setpoint_goes_to_the_vehicle(udp, clock, note):
    """An allowed ground station, a forger of its ids and a stranger speak all the time."""
    ours, (vehicle, ground, forger, stranger, _) = udp
    ground.send(heartbeat(Source(255, 190)))
    received(ours)
    ours.send([SETPOINT])
    assert ours.packets_out == 0  # the vehicle has not spoken yet
    for n in range(60):
        clock[0] += 0.1
        if n % 10 == 0:
            vehicle.send(heartbeat(VEHICLE, sequence=n))
            received(ours)
        for sender, source in ((ground, Source(255, 190)), (forger, VEHICLE), (stranger, ME)):
            for _ in range(20):
                sender.send(heartbeat(source))
        heard = received(ours)
        assert VEHICLE not in heard
        assert Source(255, 190) in heard  # it is allowed, and heard
        ours.send([SETPOINT])
    to_vehicle, *to_others = [got(s) for s in (vehicle, ground, forger, stranger)]
    assert to_vehicle == 60
    assert to_others == [0, 0, 0]
    assert ours.codec.statistics.strange >= 60
    assert ours.address_changes == 0
    note("setpoints to others than the vehicle, of 60", sum(to_others))


@pytest.mark.mutation
def test_row_30_fails_without_the_pinned_address(udp, clock, monkeypatch, record_property):
    """Whoever speaks last for the vehicle is its address then."""
    follow = lambda self, place, frames: self.endpoint.answer_sender() or True  # noqa: E731
    monkeypatch.setattr(Link, "_is_vehicle", follow)
    said = ""
    try:
        with pytest.raises(AssertionError) as failed:
            test_every_setpoint_goes_to_the_vehicle(udp, clock, lambda what, value: None)
        said = str(failed.traceback[-1].statement).strip()
    finally:
        record_property("without", ("the pinned address | 30", f"`{said}`"))


@pytest.mark.row("30")
@pytest.mark.parametrize(("signed", "silence"), [(False, 1.5), (True, 0.2)])
def test_a_vehicle_has_another_address_once_the_old_one_is_silent(udp, clock, signed, silence):
    ours, (vehicle, again, *_) = udp
    stamp = NOW if signed else None
    if signed:
        ours.codec._signing = Signing(KEY, NOW - 10)
    vehicle.send(heartbeat(VEHICLE, stamp))
    assert received(ours) == [VEHICLE]
    clock[0] += silence - 0.01
    again.send(heartbeat(VEHICLE, stamp and stamp + 1))
    assert received(ours) == []
    clock[0] += 0.02
    again.send(heartbeat(VEHICLE, stamp and stamp + 2))
    assert received(ours) == [VEHICLE]
    assert ours.address.endswith(f":{again.getsockname()[1]}")
    assert ours.address_changes == 1
    ours.send([SETPOINT])
    assert (got(vehicle), got(again)) == (0, 1)


def test_no_other_process_may_take_the_port_of_a_pinned_link(udp):
    ours, (vehicle, *_) = udp
    vehicle.send(heartbeat(VEHICLE))
    received(ours)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as thief:
        thief.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with pytest.raises(OSError, match="in use"):
            thief.bind(("127.0.0.1", ours.endpoint.port))
