"""A flight without sockets: vehicles, their autopilots, a ground station and a companion."""

import json
import math
import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from mavlink_bridge.wire.messages import Command, RateSetpoint, Received, Source
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.rigid_body import Vehicles

GCS = Source(255, 190)
CHROMIUM = os.environ.get("CHROMIUM") or next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
STAND_INS = Path(__file__).parent / "external" / "stand_ins"


class Flight:
    """n vehicles on the ground, 3 m apart; time moves in steps of 10 ms."""

    def __init__(self, n=1, flavour="px4", yaw=0.0, airframe=None, **options):
        p = np.array([[3.0 * i, 0.0, 0.0] for i in range(n)])
        self.vehicles = Vehicles(airframe or Airframe(), p, yaw)
        self.autopilots = Autopilots(self.vehicles, list(range(1, n + 1)), flavour, **options)
        self.heard = [[] for _ in range(n)]  # by the ground station
        self.setpoint = None

    def send(self, message, i=0, source=GCS, link=None):
        return self.autopilots.receive(i, Received(source, message), link)

    def command(self, number, *params, i=0, source=GCS):
        """The acknowledged result."""
        unused = 0.0 if self.autopilots.units[i].flavour.nan_ends else math.nan
        padded = (*map(float, params), *(unused,) * (7 - len(params)))
        replies = self.send(Command(int(number), padded, i + 1), i, source)
        assert replies[0].command == number
        assert (replies[0].target_system, replies[0].target_component) == (
            source.system,
            source.component,
        )
        return replies[0].result

    def stream(self, omega, thrust):
        """From now on the companion of vehicle 0 sends this at 10 Hz."""
        self.setpoint = RateSetpoint(0.0, np.array(omega, dtype=float), thrust, 1)

    def run(self, seconds, until=None, wind=0.0):
        """Fly on; True as soon as `until()` holds."""
        a = self.autopilots
        first = round(a.t * 100)
        for k in range(first + 1, first + round(seconds * 100) + 1):
            a.advance(k / 100, wind)
            if self.setpoint is not None and k % 10 == 0:
                self.send(self.setpoint, source=Source(1, 191))
            for i, heard in enumerate(self.heard):
                heard.extend(a.telemetry(i, "gcs"))
            if until is not None and until():
                return True
        return False

    def texts(self, i=0):
        return [t.text for t in self.autopilots.units[i].commander.texts]

    @property
    def commander(self):
        return self.autopilots.units[0].commander

    @property
    def tilt(self):
        """Angle of vehicle 0 from level [rad]."""
        _, x, y, _ = self.vehicles.q[0]
        return math.acos(1 - 2 * (x * x + y * y))

    def last(self, kind, i=0):
        return [m for m in self.heard[i] if isinstance(m, kind)][-1]

    def in_the_air(self):
        """Take off and hold (PX4's way)."""
        assert self.command(400, 1) == 0
        assert self.command(22) == 0
        assert self.run(10.0, lambda: self.commander.mode.name == "HOLD")
        self.run(2.0)

    def in_offboard(self):
        """Take off and enter offboard with a level stream of setpoints (PX4's way)."""
        self.in_the_air()
        self.stream([0, 0, 0], Airframe().hover_thrust)
        self.run(0.5)
        self.command(176, 1, 6, 0)
        assert self.commander.mode.name == "OFFBOARD"


@pytest.fixture
def make_flight():
    return Flight


@pytest.fixture
def stand_in(tmp_path):
    """A function that makes an executable which plays the autopilot `name`.

    Armed, it commands `motors`, in its own order.
    """

    def make(name, motors=(0.2, 0.3, 0.4, 0.5)):
        (tmp_path / "motors.json").write_text(json.dumps(list(motors)))
        binary = tmp_path / "bin" / name
        binary.parent.mkdir(exist_ok=True)
        binary.write_text(f"#!{sys.executable}\n{(STAND_INS / f'{name}.py').read_text()}")
        binary.chmod(0o755)
        return str(binary)

    return make


@pytest.fixture
def browser():
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine (apt install chromium, or set CHROMIUM)")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as p:
        chromium = p.chromium.launch(
            executable_path=CHROMIUM,
            args=[
                "--no-sandbox",
                "--use-angle=swiftshader",
                "--enable-unsafe-swiftshader",
                "--ignore-gpu-blocklist",
            ],
        )
        yield chromium
        chromium.close()
