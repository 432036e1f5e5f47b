"""`sitl-sim bench`: stages of a flight, and two releases in turn."""

import json
import sys

import pytest

from sitl_sim.__main__ import main
from sitl_sim.campaigns import bench

FLIGHT = ["bench", "forest", "--drones", "1", "--seconds", "3", "--rounds", "1"]
PERFECT = ["--set", "sensing.neighbours=truth", "--set", "sensing.obstacles=map"]


def test_each_stage_of_the_pipeline_is_measured(capsys):
    assert main([*FLIGHT, *PERFECT, "--json"]) == 0
    (ours,) = json.loads(capsys.readouterr().out)
    assert {"tick", "vehicle", "see", "map", "guide", "supervise", "log"} <= ours.keys()
    parts = sum(cost["p50"] for name, cost in ours.items() if name in ("see", "vehicle", "guide"))
    assert 0.0 < parts < ours["tick"]["p99"]
    assert ours["real-time factor"]["p50"] > 0.0


def test_two_releases_fly_in_turn_and_their_ratio_is_told(monkeypatch, capsys):
    flown = []

    def metrics(tick):
        found = {"p50": tick, "p99": 3.0 * tick, "max": 9.0}
        none = {"p50": None, "p99": None, "max": None}
        return {
            "tick_ms": found,
            "stage_ms": {"see": found},
            "solve_ms": none,
            "real_time_factor": 2.0,
        }

    def fly(python, *_):
        flown.append(python)
        return metrics({sys.executable: 4.0, "/old/python": 8.0}[python] + len(flown) % 2)

    monkeypatch.setattr(bench, "_flown", fly)
    assert main(["bench", "forest", "--against", "/old/python", "--rounds", "2"]) == 0
    assert flown == [sys.executable, "/old/python"] * 2
    rows = {r.split(" | ")[0]: r.split(" | ") for r in capsys.readouterr().out.splitlines()}
    assert rows["| tick"][1:] == ["5.00", "15.00", "8.00", "24.00", "0.62", "0.62 |"]
    assert rows["| real-time factor"][-2:] == ["1.00", "– |"]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["no-such"], "no-such"),
        (["forest", "--against", "/no/python"], "--against /no/python: No such file"),
    ],
)
def test_what_cannot_fly_is_told_in_one_line(arguments, told, monkeypatch, capsys):
    if "--against" in arguments:
        monkeypatch.setattr(sys, "executable", "/no/python")
    assert main(["bench", *arguments, "--rounds", "1", "--seconds", "1"]) == 2
    assert told in capsys.readouterr().err
