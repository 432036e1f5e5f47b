"""A bridge against a controller that answers and does not fly, in simulated time."""

import math
import struct

import numpy as np

from mavlink_bridge.autopilots.betaflight import Betaflight
from mavlink_bridge.betaflight.bridge import BetaflightBridge
from mavlink_bridge.betaflight.controller import interview
from mavlink_bridge.betaflight.polling import POLLED
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.messages import (
    Command,
    CommandAck,
    RateSetpoint,
    Received,
    Source,
    StatusText,
)
from tests.mavlink_bridge.betaflight.fake_controller import FakeController

COMPANION = Source(1, 191)
STEP = 0.02


class Bench:
    """A bridge, its controller, and simulated time.

    pilot: his arm switch and his throttle [µs], in effect where the bridge's frames are not: as
    Betaflight does it, they hold for 0.3 s, and while he has them overridden.
    """

    def __init__(self, sole=True):
        self.fc = FakeController(sole)
        self.bridge = BetaflightBridge(
            1, interview(self.fc.answer), ThrustMap(0.5, 1.75), math.radians(60)
        )
        self.ask = Betaflight(1)
        self.t = 100.0
        self.heard, self.rc, self.rc_at = [], None, -math.inf
        self.setpoint = None
        self.pilot = (False, 1000)
        self.run(0.5)

    def send(self, messages):
        for m in messages:
            self.bridge.receive(self.t, Received(COMPANION, m))

    def run(self, seconds):
        for _ in range(round(seconds / STEP)):
            self.t += STEP
            self.bridge.read(self.t, self.fc.several(POLLED))
            if self.setpoint is not None:
                self.send([self.setpoint])
            out = self.bridge.cycle(self.t)
            self.heard += out.messages
            self.rc = struct.unpack("<16H", out.rc[5:-1]) if out.rc else None
            if self.rc:
                self.rc_at, self.frame = self.t, self.rc
            self._obey()

    def _obey(self):
        """The controller follows whose channels are in effect."""
        fc, arm = self.fc, self.fc.armed
        if self.t - self.rc_at <= 0.3 and (self.bridge._controller.sole or fc.override):
            arm, fc.throttle = self.frame[4] > 1700, self.frame[2]
        elif not self.bridge._controller.sole:
            arm, fc.throttle = self.pilot
        fit = fc.armed or (fc.throttle < 1050 and not fc.reasons & ~(1 << 28))
        fc.armed = arm and fit

    def last(self, kind):
        return [m for m in self.heard if isinstance(m, kind)][-1]

    def texts(self):
        return [m.text for m in self.heard if isinstance(m, StatusText)]

    def asked(self, command, *params, component=1):
        """The answer to a command."""
        padded = (*params, *(0.0,) * (7 - len(params)))
        self.send([Command(command, padded, 1, component)])
        self.run(STEP)
        return self.last(CommandAck).result

    def climb(self, seconds=1.5):
        """Up at 1 m/s, by whoever flies."""
        for _ in range(round(seconds / STEP)):
            self.fc.altitude += 2
            self.run(STEP)

    def hover(self):
        """Armed and taken off by command; in hold."""
        self.send(self.ask.arm())
        self.run(1.4)
        self.send(self.ask.takeoff(1.5))
        self.climb(2.5)
        assert self.bridge.mode == "hold"

    def fly(self, omega=(0.0, 0.0, 0.0), thrust=0.5):
        """In offboard, with setpoints at every cycle."""
        if not self.fc.armed:
            self.send(self.ask.arm())
            self.run(1.2)
        self.setpoint = RateSetpoint(0.0, np.array(omega), thrust, 1)
        self.run(0.1)
        self.send(self.ask.offboard())
        self.run(0.5)
        assert self.bridge.mode == "offboard"
