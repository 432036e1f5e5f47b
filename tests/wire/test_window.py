"""A short flight through a window: vehicle, window and companion in processes of their own."""

import json
import socket
import subprocess
import sys

import numpy as np
import pytest

from companion.flightlog.reader import read_log
from tests.wire.served import ROOT, Lines, free_ports, served

SCENARIO = """
fileversion: 1
name: window
world: {{cylinders: [{{x: 4.5, y: 0.2, radius: 0.4}}]}}
drones: {{count: 1, heading_deg: 0.0, jitter: 0.0}}
mission: {{targets: [[8.0, 0.0, 2.0]], tolerance: 1.5, home: false, altitude: 1.5}}
sensing: {{neighbours: truth, obstacles: map, width: 64, height: 64}}
companion: {{gaze: {{survey: 0.0}}}}
wire: {{frame_port: {frames}}}
"""


def started(*arguments):
    return subprocess.Popen(
        [sys.executable, "-m", *map(str, arguments)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


@pytest.mark.timeout(150)
def test_a_companion_flies_round_a_trunk_that_only_the_window_knows(tmp_path):
    """The served world is empty; the vehicle's frame is turned against the window's."""
    file, out = tmp_path / "window.yaml", tmp_path / "run"
    with served("px4", drones__frame_yaw_deg=50, drones__heading_deg=20) as world:
        file.write_text(SCENARIO.format(frames=free_ports(2, socket.SOCK_STREAM)))
        window = started(
            *("sitl_sim", "window", file, "--vehicle", f"udpin:127.0.0.1:{world.gcs}"),
            *("--companion", f"udpin:127.0.0.1:{world.companion + 1}", "--out", out),
        )
        lines = Lines(window.stdout)
        companion = None
        try:
            lines.wait_for(r"companion: companion run (\S+)")
            companion = started("companion", "run", out / "drones" / "drone1" / "config.yaml")
            Lines(companion.stdout)
            status = window.wait(timeout=90)
        finally:
            for process in filter(None, (companion, window)):
                process.terminate()
                process.wait(timeout=20)
            lines.join()
    assert status == 0, lines.text
    metrics, truth = json.loads((out / "metrics.json").read_text()), np.load(out / "truth.npz")
    assert metrics["ok"]
    assert metrics["contacts"] == metrics["obstacle_collisions"] == 0
    p = truth["position"][:, 0]
    assert (
        np.hypot(p[:, 0] - 4.5, p[:, 1] - 0.2).min() < 1.6
    )  # past the trunk, not around the world
    assert p[-1, 2] < 0.3
    ticks = read_log(out / "drones" / "drone1" / "flight.mcap").ticks
    fresh = [t["time"] - t["frame"] for t in ticks if t["phase"] == "fly"]
    assert np.median(fresh) == pytest.approx(0.05, abs=1e-6)  # the newest picture comes in time
    assert {t["camera"] for t in ticks if t["phase"] == "fly"} <= {"none", "late"}
