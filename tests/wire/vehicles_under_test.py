"""A vehicle on the ground to be asked: the emulated one, or the real one that UNDER_TEST names."""

import os
import time

import pytest

from mavlink_bridge.autopilots.registry import ADAPTERS
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.ids import AutopilotId
from mavlink_bridge.wire.link import Link, open_endpoint
from mavlink_bridge.wire.messages import Command, CommandAck, Heartbeat, Received, Source
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.rigid_body import Vehicles


def is_autopilot(received):
    m = received.message
    return isinstance(m, Heartbeat) and m.autopilot != AutopilotId.INVALID


class Emulated:
    """An emulated autopilot, in simulated time."""

    def __init__(self, flavour):
        self.system = 1
        self._pilots = Autopilots(Vehicles(Airframe(), [[0, 0, 0]], 0.0), [1], flavour)

    def close(self):
        """Nothing is open."""

    def ask(self, message, seconds):
        heard = self._pilots.receive(0, Received(Source(1, 191), message), "companion")
        for _ in range(round(seconds / 0.02)):
            self._pilots.advance(round(self._pilots.t + 0.02, 3))
            heard = heard + self._pilots.telemetry(0, "companion")
        return heard


class Real:
    """A vehicle at the end of a link, in its own time."""

    def __init__(self, url, autopilot):
        self._link = Link(open_endpoint(url), Codec(255, 191))
        deadline = time.monotonic() + 10.0
        found = []
        while not found and time.monotonic() < deadline:
            self._link.wait(0.2)
            found = [r for r in self._link.receive() if is_autopilot(r)]
        if not found:
            self.close()
            pytest.fail(f"no vehicle at {url}")
        if found[0].message.autopilot != autopilot:
            self.close()
            pytest.skip("another autopilot is under test")
        self.system = found[0].source.system
        self._link.close()
        self._link = Link(open_endpoint(url), Codec(self.system, 191))

    def close(self):
        self._link.close()

    def ask(self, message, seconds):
        heard = []
        self._link.wait(1.0)
        self._link.receive()  # what came before the question
        deadline = time.monotonic() + seconds
        self._link.send([message])
        while time.monotonic() < deadline:
            self._link.wait(0.05)
            heard += [r.message for r in self._link.receive() if r.source.component == 1]
        return heard


def under_test(kind, flavour):
    """Return the vehicle of this kind, emulated or real; skips without a real one."""
    url = os.environ.get("UNDER_TEST")
    if kind == "real" and not url:
        pytest.skip("UNDER_TEST names no vehicle")
    return Real(url, ADAPTERS[flavour].autopilot) if kind == "real" else Emulated(flavour)


def command(vehicle, number, *params):
    return Command(number, (*params, *(0.0,) * (7 - len(params))), vehicle.system)


def results(vehicle, number, *params, seconds=1.0):
    heard = vehicle.ask(command(vehicle, number, *params), seconds)
    return [m.result for m in heard if isinstance(m, CommandAck) and m.command == number]
