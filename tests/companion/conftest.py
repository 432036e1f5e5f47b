"""A world in real time beside the test, and a service manager that listens to a daemon."""

import json
import os
import select
import signal
import socket
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.companion.deployment import free_ports
from tests.companion.patience import PATIENCE

SCENARIO = """
fileversion: 1
name: served
world: {{cylinders: [{{x: 6.0, y: 2.5, radius: 0.5}}]}}
drones: {{count: 3, heading_deg: 0.0, spacing: 6.0, autopilot: {autopilot},
         parameters: {parameters}}}
mission: {{targets: [[3.0, 0.0, 2.0]], time_limit: 900.0}}
sensing: {{neighbours: truth, obstacles: map, width: 64, height: 64}}
wire: {{companion_port: {p}, gcs_port: {g}, frame_port: {f}}}
"""
DRONE = """
fileversion: 2
name: drone{i}
link: {{endpoint: 'udpin:127.0.0.1:{port}', system_id: {i}}}
camera: {{source: 'sim:127.0.0.1:{frames}', width: 64, height: 64}}
sensing: {{neighbours: truth, obstacles: map}}
mission: {{auto: {auto}, goals: [[3.0, 0.0, 2.0], [0.0, 0.0, 2.0]]}}
log: {{path: 'flight-{{time}}.mcap'}}
"""


@dataclass
class World:
    """`sitl-sim serve` and the ports of its vehicles."""

    folder: Path
    companion_port: int
    frame_port: int
    ground_port: int

    def config(self, i, auto=False, more=""):
        """Write a drone's file for vehicle i and return its path."""
        file = self.folder / f"drone{i}.yaml"
        file.write_text(
            DRONE.format(
                i=i,
                port=self.companion_port + i,
                frames=self.frame_port + i,
                auto=str(auto).lower(),
            )
            + more
        )
        return file


@pytest.fixture(scope="module")
def world(tmp_path_factory, request):
    """Three vehicles in real time, which the tests of a file share.

    The file may set the vehicles' AUTOPILOT and its PARAMETERS.
    """
    tmp_path = tmp_path_factory.mktemp("world")
    base = free_ports(12)
    world = World(tmp_path, base, base + 4, base + 9)
    scenario = tmp_path / "served.yaml"
    parameters = json.dumps(getattr(request.module, "PARAMETERS", {}))
    autopilot = getattr(request.module, "AUTOPILOT", "px4")
    scenario.write_text(
        SCENARIO.format(p=base, f=base + 4, g=base + 9, parameters=parameters, autopilot=autopilot)
    )
    with (tmp_path / "serve.log").open("wb") as log:
        process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "sitl_sim",
                "serve",
                str(scenario),
                "--out",
                str(tmp_path / "run"),
            ],
            stdout=log,
            stderr=log,
        )
    try:
        _until_listening(world.frame_port + 1, process)
        yield world
    finally:
        process.kill()
        process.wait()


def _until_listening(port, process):
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline and process.poll() is None:
        listening = f"0100007F:{port:04X} 00000000:0000 0A"  # state LISTEN
        if listening in Path("/proc/net/tcp").read_text():
            return
        time.sleep(0.05)
    raise RuntimeError("the world did not start")


@dataclass
class RunningDaemon:
    """A daemon, and the notices that it sends to its service manager."""

    process: subprocess.Popen
    socket: socket.socket
    folder: Path
    started: float
    heard: list = field(default_factory=list)  # (seconds since start, line)

    def listen(self, seconds, until=None):
        """Gather notices for `seconds`; return whether a line that starts with `until` came."""
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0:
            if not select.select([self.socket], [], [], min(left, 0.05))[0]:
                if self.process.poll() is not None:
                    return False
                continue
            now = time.monotonic() - self.started
            lines = self.socket.recv(4096).decode().split("\n")
            self.heard += [(now, line) for line in lines]
            if until and any(line.startswith(until) for line in lines):
                return True
        return False

    def count(self, word):
        return sum(line.startswith(word) for _, line in self.heard)

    def state(self):
        """Return the daemon's state file."""
        file = self.folder / "state.json"
        return json.loads(file.read_text()) if file.exists() else {}

    def until_phase(self, phase):
        deadline = time.monotonic() + PATIENCE
        while self.state().get("phase") != phase:
            assert time.monotonic() < deadline, (self.state(), self.log())
            self.listen(0.1)

    def log(self):
        return (self.folder / "stderr.log").read_text()


@pytest.fixture
def start_daemon(tmp_path):
    """Start `companion run` under a stand-in for the service manager."""
    running = []

    def start(config, command=(sys.executable, "-m", "companion"), cwd=None):
        folder = tmp_path / f"run{len(running)}"
        folder.mkdir()
        kept = tmp_path / f"state-{Path(config).stem}"  # outlives a daemon
        kept.mkdir(exist_ok=True)
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        listener.bind(str(folder / "notify"))
        environment = os.environ | {
            "NOTIFY_SOCKET": str(folder / "notify"),
            "RUNTIME_DIRECTORY": str(folder),
            "LOGS_DIRECTORY": str(folder),
            "STATE_DIRECTORY": str(kept),
            "WATCHDOG_USEC": "1000000",
        }
        with (folder / "stderr.log").open("wb") as log:
            process = subprocess.Popen(
                [*map(str, command), "run", str(config)],
                env=environment,
                stdout=log,
                stderr=log,
                cwd=cwd,
            )
        running.append(RunningDaemon(process, listener, folder, time.monotonic()))
        return running[-1]

    yield start
    for daemon in running:
        if daemon.process.poll() is None:
            daemon.process.send_signal(signal.SIGCONT)
            daemon.process.kill()
        daemon.process.wait()
        daemon.socket.close()
