"""A vehicle whose clock runs slower or faster than the companion's, in real time."""

import json

import numpy as np
import pytest

from companion.flightlog.reader import read_log
from sitl_sim.__main__ import main

SCENARIO = """
fileversion: 1
name: rate
world: {cylinders: [{x: 7.0, y: 0.3, radius: 0.5}]}
drones: {count: 1, heading_deg: 0.0}
mission: {targets: [[14.0, 0.0, 2.0]], home: false, time_limit: 15.0}
sensing: {neighbours: truth, obstacles: map, width: 64, height: 64}
companion: {gaze: {survey: 0.0}}
wire: {companion_port: 24640, gcs_port: 24650, frame_port: 25640}
"""


@pytest.mark.row("31")
@pytest.mark.parametrize("speed", [0.8, pytest.param(1.05, marks=pytest.mark.slow)])
def test_a_drone_flies_with_a_clock_of_another_rate(speed, tmp_path, note):
    """By simulated time; how busy the machine is shows in deadlines alone."""
    file, out = tmp_path / "rate.yaml", tmp_path / "run"
    file.write_text(SCENARIO)
    main(["run", str(file), "--out", str(out), "--real-time", "--set", f"timing.speed={speed}"])
    metrics, truth = json.loads((out / "metrics.json").read_text()), np.load(out / "truth.npz")
    assert metrics["obstacle_collisions"] == 0
    flown = truth["position"][truth["t"] > 7.0, 0]
    assert flown[:, 2].min() > 1.5
    assert flown[-1, 0] > 6.0
    ticks = read_log(out / "drones" / "drone1" / "flight.mcap").ticks
    late = [t["clock"]["rate"] for t in ticks if t["time"] > ticks[0]["time"] + 5.0]
    assert np.median(late) == pytest.approx(speed, rel=0.02)
    note(f"least height [m], clock at {speed:g}", flown[:, 2].min())
