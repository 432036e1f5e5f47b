"""A bridge with a controller that answers and does not fly, in simulated time."""

import math
import struct

import numpy as np

from mavlink_bridge.autopilots.betaflight import Betaflight
from mavlink_bridge.betaflight.bridge import BetaflightBridge
from mavlink_bridge.betaflight.controller import query_controller
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

    pilot: arm switch and throttle [µs] of the pilot, in effect where the bridge's frames are not.
    As in Betaflight, a frame holds for 0.3 s, and while the pilot's switch is on MSP OVERRIDE.
    """

    def __init__(self, only_receiver=True):
        self.fc = FakeController(only_receiver)
        self.bridge = BetaflightBridge(
            1, query_controller(self.fc.answer), ThrustMap(0.5, 1.75), math.radians(60)
        )
        self.adapter = Betaflight(1)
        self.t = 100.0
        self.messages, self.rc, self.rc_at = [], None, -math.inf
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
            self.messages += out.messages
            self.rc = struct.unpack("<16H", out.rc[5:-1]) if out.rc else None
            if self.rc:
                self.rc_at, self.frame = self.t, self.rc
            self._obey()

    def _obey(self):
        """Apply the channels that are in effect to the controller."""
        fc, arm = self.fc, self.fc.armed
        if self.t - self.rc_at <= 0.3 and (self.bridge._controller.only_receiver or fc.override):
            arm, fc.throttle = self.frame[4] > 1700, self.frame[2]
        elif not self.bridge._controller.only_receiver:
            arm, fc.throttle = self.pilot
        fit = fc.armed or (fc.throttle < 1050 and not fc.reasons & ~(1 << 28))
        fc.armed = arm and fit

    def last(self, kind):
        return [m for m in self.messages if isinstance(m, kind)][-1]

    def texts(self):
        return [m.text for m in self.messages if isinstance(m, StatusText)]

    def command(self, number, *params, component=1):
        """Send a command to a component; return the result of its CommandAck."""
        padded = (*params, *(0.0,) * (7 - len(params)))
        self.send([Command(number, padded, 1, component)])
        self.run(STEP)
        return self.last(CommandAck).result

    def climb(self, seconds=1.5):
        """Raise the reported height at 1 m/s."""
        for _ in range(round(seconds / STEP)):
            self.fc.altitude += 2
            self.run(STEP)

    def hover(self):
        """Arm, take off and end in hold."""
        self.send(self.adapter.arm())
        self.run(1.4)
        self.send(self.adapter.takeoff(1.5))
        self.climb(2.5)
        assert self.bridge.mode == "hold"

    def fly(self, omega=(0.0, 0.0, 0.0), thrust=0.5):
        """Enter offboard, with a setpoint at every cycle."""
        if not self.fc.armed:
            self.send(self.adapter.arm())
            self.run(1.2)
        self.setpoint = RateSetpoint(0.0, np.array(omega), thrust, 1)
        self.run(0.1)
        self.send(self.adapter.offboard())
        self.run(0.5)
        assert self.bridge.mode == "offboard"
