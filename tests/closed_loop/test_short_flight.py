"""Real processes, real MAVLink, rendered frames: one drone round a trunk and home."""

import json

import numpy as np
import pytest

from sitl_sim.__main__ import main

SCENARIO = """
fileversion: 1
name: short
seed: {seed}
world:
  cylinders: [{{x: 4.0, y: 0.1, radius: 0.6}}]
drones: {{count: 1, heading_deg: 0.0, frame_yaw_deg: random}}
mission: {{targets: [[8.0, 0.0, 2.0]], tolerance: 1.0, time_limit: 60.0}}
sensing: {{neighbours: camera, obstacles: map, width: 320, height: 200}}
wire: {{companion_port: 24540, gcs_port: 24550, frame_port: 25540}}
"""


@pytest.fixture
def scenario(tmp_path):
    file = tmp_path / "short.yaml"
    file.write_text(SCENARIO.format(seed=5))
    return file


def test_one_drone_flies_round_a_trunk_and_home(scenario, tmp_path):
    out = tmp_path / "run"
    assert main(["run", str(scenario), "--out", str(out)]) == 0
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["targets_reached"] == {"drone1": "2/2"}
    assert metrics["obstacle_collisions"] == 0
    truth = np.load(out / "truth.npz")
    assert truth["position"][-1, 0, 2] < 0.3  # landed again
    assert (out / "report.html").stat().st_size > 50_000


def test_the_same_seed_gives_the_same_bytes(scenario, tmp_path):
    shas = []
    for n in range(2):
        out = tmp_path / f"run{n}"
        main(["run", str(scenario), "--out", str(out), "--set", "mission.time_limit=12"])
        shas.append(json.loads((out / "metrics.json").read_text())["truth_sha256"])
    assert shas[0] == shas[1]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "forrest"], "no scenario 'forrest'; valid: "),
        (["run", "nowhere.yaml"], "nowhere.yaml: cannot be read"),
        (["run", "forest", "--set", "drones.cout=3"], "drones.cout: unknown key"),
        (["run", "forest", "--set", "drones.count=no"], "drones.count"),
    ],
)
def test_bad_input_is_one_clear_line_and_status_2(arguments, words, capsys):
    assert main(arguments) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert words in lines[0]
