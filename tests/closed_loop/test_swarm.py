"""Three drones, real processes, pixels alone: the mission, a killed companion, real time."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading

import numpy as np
import pytest

from sitl_sim.__main__ import main
from sitl_sim.figures.metrics import safety
from sitl_sim.flight.runner import flight
from sitl_sim.scenarios import scenario as scenarios

SCENARIO = """
fileversion: 1
name: three
seed: 21
world:
  cylinders: [{x: 5.0, y: 0.4, radius: 0.6}, {x: 9.0, y: -2.0, radius: 0.6}]
drones: {count: 3, spacing: 1.5, heading_deg: 0.0, frame_yaw_deg: random,
         parameters: {COM_OBL_RC_ACT: 4}}
mission: {targets: [[16.0, 0.0, 2.0]], home: false, tolerance: 3.0, time_limit: 60.0}
sensing: {width: 320, height: 200}
wire: {companion_port: 25540, gcs_port: 25550, frame_port: 26540}
"""


@pytest.fixture
def scenario(tmp_path):
    file = tmp_path / "three.yaml"
    file.write_text(SCENARIO)
    return file


def metrics_of(folder):
    return json.loads((folder / "metrics.json").read_text())


def test_three_fly_from_pixels_to_a_shared_target(scenario, tmp_path):
    assert main(["run", str(scenario), "--out", str(tmp_path / "run")]) == 0
    metrics = metrics_of(tmp_path / "run")
    assert metrics["targets_reached"] == {f"drone{n}": "1/1" for n in (1, 2, 3)}
    assert metrics["agent_collisions"] == metrics["obstacle_collisions"] == 0


@pytest.mark.row("1")
def test_a_killed_companion_stops_no_other_drone_and_its_vehicle_lands(scenario, tmp_path):
    with flight(scenarios.load(str(scenario), []), tmp_path / "run") as f:
        f.write_inputs()
        f.launch()
        f.wait_for_companions()
        victim = f._drones[1].process
        killed = []

        def kill_in_flight(t):
            if t >= 10.0 and not killed:
                killed.append(t)
                os.kill(victim.pid, signal.SIGKILL)

        f.run(kill_in_flight)
        truth = f.truth.arrays()
        figures = safety(truth, f.world, f.names)
    assert killed
    assert figures["targets_reached"]["drone1"] == figures["targets_reached"]["drone3"] == "1/1"
    assert figures["targets_reached"]["drone2"] == "0/1"
    assert figures["agent_collisions"] == figures["obstacle_collisions"] == 0
    t, p, v = truth["t"], truth["position"][:, 1], truth["velocity"][:, 1]
    at_kill = int(np.searchsorted(t, killed[0]))
    assert p[at_kill, 2] > 1.5
    # PX4 leaves offboard after COM_OF_LOSS_T = 1 s and lands where it is (COM_OBL_RC_ACT 4).
    held = (t > killed[0] + 3.0) & (t < killed[0] + 4.0)
    assert np.linalg.norm(v[held, :2], axis=1).max() < 0.5
    assert p[-1, 2] < 0.3
    assert not truth["armed"][-1, 1]


def test_the_same_seed_gives_the_same_bytes_on_a_loaded_machine(scenario, tmp_path):
    short = ["--set", "mission.time_limit=9"]
    main(["run", str(scenario), "--out", str(tmp_path / "idle"), *short])
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(3)]
    try:
        main(["run", str(scenario), "--out", str(tmp_path / "loaded"), *short])
    finally:
        for process in busy:
            process.kill()
            process.wait()
    idle, loaded = metrics_of(tmp_path / "idle"), metrics_of(tmp_path / "loaded")
    assert idle["truth_sha256"] == loaded["truth_sha256"]
    assert idle["duration_s"] > 8.0


def test_real_time_reports_deadline_misses(scenario, tmp_path):
    short = ["--real-time", "--set", "mission.time_limit=8"]
    main(["run", str(scenario), "--out", str(tmp_path / "run"), *short])
    metrics = metrics_of(tmp_path / "run")
    assert metrics["never_flew"] == []
    assert 0.0 <= metrics["deadline_miss_rate"] <= 1.0
    # Not faster than real time; on a machine that has much else to do it is slower.
    assert 0.0 < metrics["real_time_factor"] < 1.1


def test_a_companion_started_by_hand_flies_a_served_world(scenario, tmp_path):
    overrides = [
        "drones.count=1",
        "mission.time_limit=40",
        "mission.home=true",
        "mission.targets=[[4.0, -1.5, 2.0]]",
        "world.cylinders=[]",
    ]
    with flight(scenarios.load(str(scenario), overrides), tmp_path / "run", real_time=True) as f:
        f.write_inputs()
        world = threading.Thread(target=f.run)
        world.start()
        config = tmp_path / "run" / "drones" / "drone1" / "config.yaml"
        by_hand = subprocess.Popen([sys.executable, "-m", "companion", "run", str(config)])
        world.join()
        by_hand.terminate()
        assert by_hand.wait(10) == 0
        figures = safety(f.truth.arrays(), f.world, f.names)
    assert figures["targets_reached"] == {"drone1": "2/2"}


def test_a_port_in_use_is_one_clear_line_and_status_2(scenario, tmp_path, capsys):
    with socket.create_server(("127.0.0.1", 26541)):
        assert main(["run", str(scenario), "--out", str(tmp_path / "run")]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert "26541" in lines[0]
