"""Each vehicle has ports of its own, and so has each flight on a machine."""

import re
from pathlib import Path

import pytest

from sitl_sim import scenario as scenarios
from sitl_sim.companion_config import companion_config
from sitl_sim.runner import flight


def _told(scenario):
    """The UDP port that each companion is told to listen on."""
    configs = [companion_config(scenario, i, Path(), False) for i in range(scenario.drones.count)]
    return [int(c["link"]["endpoint"].rpartition(":")[2]) for c in configs]


@pytest.mark.parametrize("drones", [9, 10, 20])
def test_no_companion_listens_where_ground_stations_do(drones):
    s = scenarios.load("forest", [f"drones.count={drones}"])
    assert len({*_told(s), s.wire.gcs_port}) == drones + 1
    assert _told(s)[:9] == list(range(14541, 14550))


def test_vehicles_speak_to_where_their_companions_were_told_to_listen(tmp_path):
    wire = ["wire.companion_port=28540", "wire.gcs_port=28543", "wire.frame_port=28640"]
    s = scenarios.load("crossing", ["drones.count=4", "sensing.obstacles=map", *wire])
    assert _told(s) == [28541, 28542, 28544, 28545]
    with flight(s, tmp_path) as f:
        table = [re.findall(r"UDP (\d+)", line) for line in f.wire_table()]
        sent = [d.companion.endpoint.remote[1] for d in f._drones]
    assert table == [[str(port), "28543"] for port in _told(s)]
    assert sent == _told(s)
