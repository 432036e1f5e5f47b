"""The cost of emulated vehicles without cameras: physics, autopilot, telemetry, setpoints.

`pytest tests/benchmarks/test_vehicles.py -s` prints the table.
"""

import math
import time

import numpy as np
import pytest

from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import Command, CommandId, RateSetpoint, Received, Source
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.rigid_body import Vehicles

SECONDS = 4.0
PERIOD = 0.02
HOVER = Airframe().hover_thrust


class Fleet:
    """n flying vehicles, companions at 10 Hz, both links encoded at 50 Hz."""

    def __init__(self, n):
        p = np.array([[3.0 * (i % 10), 3.0 * (i // 10), 0.0] for i in range(n)])
        self.n = n
        self.autopilots = Autopilots(Vehicles(Airframe(), p, 0.0), list(range(1, n + 1)))
        self.vehicles = [Codec(i + 1, 1) for i in range(n)]
        self.companions = [Codec(i + 1, 191) for i in range(n)]
        self.bytes = self.ticks = 0
        for command, params in ((400, (1.0,)), (22, (math.nan,) * 7)):
            self.command(command, *params)
        self.fly(0.5)
        self.command(CommandId.DO_SET_MODE, 1.0, 6.0)

    def command(self, number, *params):
        padded = (*params, *(0.0,) * (7 - len(params)))
        for i in range(self.n):
            self.autopilots.receive(i, Received(Source(i + 1, 191), Command(number, padded, i + 1)))

    def fly(self, seconds):
        for _ in range(round(seconds / PERIOD)):
            self.ticks += 1
            for i in range(self.n):
                if (self.ticks + i) % 5 == 0:
                    m = RateSetpoint(0.0, np.zeros(3), HOVER, i + 1)
                    for received in self.vehicles[i].decode(self.companions[i].encode([m])):
                        self.autopilots.receive(i, received)
                for link in ("companion", "gcs"):
                    self.bytes += len(self.vehicles[i].encode(self.autopilots.telemetry(i, link)))
            self.autopilots.advance(self.autopilots.t + PERIOD)


def real_time_factor(n):
    """Simulated seconds per second of this process's processor time."""
    fleet = Fleet(n)
    fleet.fly(0.5)
    started = time.process_time()
    fleet.fly(SECONDS)
    return SECONDS / (time.process_time() - started), fleet.bytes


@pytest.mark.parametrize("n", [1, 10, 30])
def test_vehicles_keep_up_with_real_time(n):
    factor, sent = real_time_factor(n)
    share = 100.0 / factor / n
    print(f"\n{n:4d} vehicles: {factor:6.1f} × real time, {share:.2f} % of a core each")
    assert sent > 1000 * n
    assert factor >= 1.0


@pytest.mark.slow
def test_a_hundred_vehicles():
    factor, _ = real_time_factor(100)
    print(f"\n 100 vehicles: {factor:6.2f} × real time, {1.0 / factor:.2f} % of a core each")
    assert factor > 0.3
