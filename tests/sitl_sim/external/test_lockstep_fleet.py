"""A fleet in lockstep: time, relay, boot; scripted autopilots stand in for real ones."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from sitl_sim.external import lockstep_fleet
from sitl_sim.external.external_sitl import ExternalError
from sitl_sim.external.lockstep_fleet import LockstepFleet
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.rigid_body import Vehicles

ARMABLE = 0x10000000
# EVENT (410) of PX4 1.17, which this project does not decode: v2 frame, not to be altered
EVENT = bytes.fromhex("fd0600002a01019a0100010203040506aabb")


class Link:
    """An autopilot's link in memory; heard from the start."""

    heard = True

    def __init__(self):
        self.out, self.sent, self.delay = [], [], 0

    def receive(self):
        if self.delay:
            self.delay -= 1
            return []
        packets, self.out = self.out, []
        return packets

    def send(self, data):
        self.sent.append(data)

    def wait(self, timeout):
        self.waited = timeout

    def close(self):
        pass


class Scripted:
    """An autopilot that knows its place, and answers, as told."""

    period, name, folder, connected, alive = 0.004, "px4", "runs/x", True, True
    located = answers = True

    def __init__(self):
        self.command = np.full(4, 0.8)
        self.links = {"companion": Link(), "gcs": Link()}
        self.times, self.closed = [], False
        self._mav = mavlink.MAVLink(None, 1, 1)

    def send(self, time, i, state):
        self.times.append(round(time, 6))
        messages = [mavlink.MAVLink_sys_status_message(ARMABLE, ARMABLE, ARMABLE, *[0] * 10)]
        if self.located:
            messages.append(mavlink.MAVLink_local_position_ned_message(1, *[0.0] * 6))
        self.links["gcs"].out = [b"".join(m.pack(self._mav) for m in messages)]

    def attitude(self, time_ms):
        m = mavlink.MAVLink_attitude_quaternion_message(time_ms, 1, 0, 0, 0, 0, 0, 0)
        self.links["companion"].out.append(m.pack(self._mav))

    def receive(self, timeout):
        return self.answers

    def close(self):
        self.closed = True


def fleet(*sitls):
    """A fleet of these, started in this order, one at a time and each again after a failure."""
    supply = iter(sitls)
    return LockstepFleet(Vehicles(Airframe(), [[0.0] * 3], 0.0), lambda i: next(supply), [0.03])


def test_physics_and_autopilot_share_one_time():
    sitl = Scripted()
    f = fleet(sitl)
    begun = len(sitl.times)
    f.advance(0.002)  # between two steps of the autopilot
    f.advance(0.1)
    steps = np.diff(sitl.times[begun - 1 :])
    np.testing.assert_allclose(steps, 0.004, atol=1e-9)
    assert len(steps) == 25
    assert f.clock_ms[0] % 100 == 30  # the phase that was asked for
    assert f.vehicles.p[0, 2] > 0.05


def test_an_autopilot_that_does_not_answer_ends_the_flight_with_its_name(monkeypatch):
    sitl = Scripted()
    f = fleet(sitl)
    sitl.answers = False
    with pytest.raises(ExternalError, match=r"px4 of vehicle 1 does not answer; see .*output.log"):
        f.advance(0.1)
    sitl.alive = False
    with pytest.raises(ExternalError, match="px4 of vehicle 1 ended"):
        f.advance(0.2)


def test_an_autopilot_that_boots_without_an_estimate_is_started_anew(monkeypatch):
    monkeypatch.setattr(lockstep_fleet, "_LOCATED", 0.2)
    lost, found = Scripted(), Scripted()
    lost.located = False
    f = fleet(lost, found)
    assert lost.closed
    assert f._sitls == [found]


def test_an_autopilot_that_never_knows_its_place_is_one_clear_line(monkeypatch):
    monkeypatch.setattr(lockstep_fleet, "_LOCATED", 0.2)
    sitls = [Scripted() for _ in range(3)]
    for sitl in sitls:
        sitl.located = False
    with pytest.raises(ExternalError, match=r"px4 of vehicle 1 does not know its place after"):
        fleet(*sitls)
    assert all(s.closed for s in sitls)


def test_packets_pass_as_they_are():
    sitl = Scripted()
    f = fleet(sitl)
    sitl.links["companion"].out = [EVENT]
    sitl.links["gcs"].out = [EVENT]
    assert f.packets(0, "companion") == [EVENT]
    assert f.packets(0, "gcs") == [EVENT]
    f.pass_on(0, "companion", EVENT)
    assert sitl.links["companion"].sent == [EVENT]


def test_the_newest_attitude_is_waited_for_where_it_is_streamed():
    sitl = Scripted()
    f = fleet(sitl)
    link = sitl.links["companion"]
    link.waited = None
    for k in range(1, 4):
        f.advance(0.02 * k)
        sitl.attitude(f.clock_ms[0])
        assert len(f.packets(0, "companion")) == 1
    assert link.waited is None
    f.advance(0.1)
    sitl.attitude(f.clock_ms[0])
    link.delay = 2  # it comes while it is waited for
    assert len(f.packets(0, "companion")) == 1
    assert link.waited is not None
