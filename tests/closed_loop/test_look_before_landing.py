"""A drone that has arrived turns once before it lands, where the mission asks for it."""

import json
import math

import pytest

from companion.guidance.gaze import GazeConfig
from sitl_sim.__main__ import main

SCENARIO = """
fileversion: 1
name: alone
seed: 3
world: {}
drones: {count: 1}
mission: {targets: [[3.0, 0.0, 2.0]], home: false, tolerance: 1.0, time_limit: 40.0}
sensing: {neighbours: truth, obstacles: map}
"""


def test_it_turns_once_and_then_lands(tmp_path):
    file = tmp_path / "alone.yaml"
    file.write_text(SCENARIO)
    lasted = {}
    for wait in (0.0, 10.0):
        run = tmp_path / str(wait)
        asked = ["--set", f"companion.mission.land_wait={wait}", "--in-process"]
        assert main(["run", str(file), "--out", str(run), *asked]) == 0
        lasted[wait] = json.loads((run / "metrics.json").read_text())["duration_s"]
    turn = 2 * math.pi / GazeConfig().slew
    assert lasted[10.0] - lasted[0.0] == pytest.approx(turn, abs=0.5)
