"""Companions of an in-process flight in other processes: the same flight, and what ends them."""

import os
import signal

import pytest

from mavlink_bridge.shared.settings import SettingsError
from mavlink_bridge.wire.memory import MemoryEndpoint
from sitl_sim.faults.camera import FaultyCamera
from sitl_sim.faults.catalogue import Schedule
from sitl_sim.flight.hosts import Host, HostedFrames
from sitl_sim.flight.results import finish
from sitl_sim.flight.runner import flight
from sitl_sim.scenarios.scenario import Scenario


def flown(folder, hosts, kill=False, **sensing):
    scenario = Scenario.model_validate(
        {
            "world": {"generator": "forest", "rows": 2, "columns": 2},
            "drones": {"count": 3, "centre": [0.0, -12.0], "state": "vio"},
            "sensing": {"neighbours": "truth", "obstacles": "map"} | sensing,
            "mission": {"time_limit": 10.0},  # the companions fly from 8 s on
        }
    )
    folder.mkdir()
    with flight(scenario, folder, in_process=True, hosts=hosts) as f:
        f.write_inputs()
        f.launch()
        if kill:
            os.kill(f._hosts[0]._process.pid, signal.SIGKILL)
        f.run()
    return finish(f, 0.0)


@pytest.mark.parametrize("eyes", ["truth", "camera"])
def test_the_truth_is_that_of_one_process(tmp_path, eyes):
    sensing = {"neighbours": eyes}
    alone = flown(tmp_path / "alone", 0, **sensing)
    shared = flown(tmp_path / "shared", 2, **sensing)
    assert shared["truth_sha256"] == alone["truth_sha256"]
    assert alone["mean_speed_m_s"] > 0.3  # or nothing that a companion decided shows in the truth
    assert shared["companion_errors"] == {}
    assert (tmp_path / "shared" / "drones" / "drone2" / "flight.mcap").stat().st_size > 1000


def test_a_process_that_dies_loses_its_companions_alone(tmp_path):
    metrics = flown(tmp_path / "killed", 2, kill=True)
    # Of systems 1 to 3 the second is held by process 0.
    assert set(metrics["companion_errors"]) == {"drone2"}
    assert "drone2" in metrics["never_flew"]
    assert "drone1" not in metrics["never_flew"]


def test_a_wrong_configuration_is_told_as_by_one_process(tmp_path):
    config = tmp_path / "config.yaml"
    config.write_text("fileversion: 1\nname: drone1\nfence: {altitude_max: 0.2}\n")
    scenario = Scenario.model_validate({"drones": {"count": 1}})
    host = Host(scenario, {})
    host.start()
    camera = FaultyCamera(Schedule([], ["drone1"], 0), 0)
    with pytest.raises(SettingsError, match="altitude_max"):
        HostedFrames(host, 0, camera).start_companion(config, MemoryEndpoint())
    host.close()
