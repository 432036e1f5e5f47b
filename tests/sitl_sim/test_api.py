"""The simulator from Python: light to import, flights as from the command line, clear errors."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import sitl_sim
from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.api import CampaignResult, FlightResult

SCENARIO = """
fileversion: 1
name: pair
seed: 3
world: {cylinders: [{x: 3.0, y: 0.4, radius: 0.5}]}
drones: {count: 2, spacing: 1.5, heading_deg: 0.0}
mission: {targets: [[8.0, 0.0, 2.0]], home: false, time_limit: 2.0}
sensing: {neighbours: truth, obstacles: map}
"""


@pytest.fixture
def scenario(tmp_path):
    file = tmp_path / "pair.yaml"
    file.write_text(SCENARIO)
    return file


def test_the_package_is_light_until_a_function_is_asked_for():
    code = (
        "import sys, sitl_sim; print(*(m for m in ('numpy', 'casadi', 'cv2') if m in sys.modules))"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == ""
    with pytest.raises(AttributeError, match="no attribute 'flight'"):
        sitl_sim.__getattr__("flight")


def test_every_package_says_that_it_is_typed():
    root = Path(sitl_sim.__file__).parents[1]
    missing = [
        p
        for p in ("companion", "sitl_sim", "mavlink_bridge")
        if not (root / p / "py.typed").exists()
    ]
    assert missing == []


def test_changes_reach_the_scenario(scenario):
    changes = {"wind.mean": np.array([1.0, 0.0, 0.0]), "mission.targets": [[5, 0, 2]]}
    loaded = sitl_sim.load(scenario, seed=9, drones=3, controller="orca", changes=changes)
    assert (loaded.seed, loaded.drones.count) == (9, 3)
    assert loaded.wind.mean == [1.0, 0.0, 0.0]
    assert loaded.mission.targets == [[5, 0, 2]]
    assert loaded.companion["controller"] == "orca"


def test_mistakes_name_the_key_and_the_choices(scenario):
    with pytest.raises(SettingsError, match=r"drones.look: must be 'ball', 'bare' or 'mixed'"):
        sitl_sim.load(scenario, changes={"drones.look": "cube"})
    with pytest.raises(SettingsError, match=r"changes: wind.mean: no number"):
        sitl_sim.load(scenario, changes={"wind.mean": object()})
    with pytest.raises(SettingsError, match="belong into load"):
        sitl_sim.fly(sitl_sim.load(scenario), seed=4)


def test_a_flight_from_python_is_that_of_the_command_line(scenario, tmp_path):
    from sitl_sim.__main__ import main

    flight = sitl_sim.fly(scenario, out=tmp_path / "a")
    main(["run", str(scenario), "--in-process", "--out", str(tmp_path / "b")])
    other = json.loads((tmp_path / "b" / "metrics.json").read_text())
    assert flight.metrics["truth_sha256"] == other["truth_sha256"]
    assert flight.position.shape == (len(flight.t), 2, 3)
    assert flight.names == ["drone1", "drone2"]
    assert not flight.ok  # two seconds are too short
    assert len(flight.ticks("drone1")) > 10
    columns = flight.columns()
    assert {len(c) for c in columns.values()} == {2 * len(flight.t)}
    np.testing.assert_array_equal(
        columns["z"][columns["drone"] == "drone2"], flight.position[:, 1, 2]
    )
    with pytest.raises(SettingsError, match="no drone 'drone9'; valid: drone1, drone2"):
        flight.ticks("drone9")


def test_a_campaign_gives_its_figures_as_arrays():
    metrics = {
        "ok": True,
        "speed": 1.0,
        "solve_ms": {"p50": 0.5},
        "per_drone": {"drone1": {"x": 1}},
    }
    flights = {
        7: FlightResult(Path("c/s-7"), metrics),
        2: FlightResult(Path("c/s-2"), {**metrics, "ok": False, "speed": None}),
    }
    summary = {"success": 0.5, "wilson_95": [0.1, 0.9]}
    many = CampaignResult(Path("c"), summary, flights)
    assert many.success_rate == 0.5
    assert many.interval == (0.1, 0.9)
    np.testing.assert_array_equal(many.array("seed"), [2, 7])
    np.testing.assert_array_equal(many.array("ok"), [0.0, 1.0])
    np.testing.assert_array_equal(many.array("speed"), [np.nan, 1.0])
    np.testing.assert_array_equal(many.array("solve_ms.p50"), [0.5, 0.5])
    with pytest.raises(SettingsError, match="no metric 'colour'; valid: ok, "):
        many.array("colour")
