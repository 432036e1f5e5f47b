"""A run folder that is there already: another flight's, or an earlier one's."""

import socket

from sitl_sim.__main__ import main
from sitl_sim.flight.runner import flight
from sitl_sim.scenarios.scenario import load

SCENARIO = """
fileversion: 1
name: pair
seed: 3
drones: {count: 1}
mission: {targets: [[8.0, 0.0, 2.0]], time_limit: 9.0}
sensing: {neighbours: truth, obstacles: map}
wire: {companion_port: 27840, gcs_port: 27850, frame_port: 27860}
"""


def test_who_does_not_get_the_ports_leaves_the_others_flight(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pair.yaml").write_text(SCENARIO)
    theirs = tmp_path / "runs" / "pair-3" / "drones" / "drone1" / "flight.mcap"
    theirs.parent.mkdir(parents=True)
    theirs.write_bytes(b"flying")
    with socket.create_server(("127.0.0.1", 27861)):
        assert main(["run", "pair.yaml"]) == 2
        assert main(["run", "pair.yaml", "--out", "runs/pair-3"]) == 2
    assert "27861" in capsys.readouterr().err
    assert theirs.read_bytes() == b"flying"


def test_nothing_of_an_earlier_flight_is_read_as_this_ones(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pair.yaml").write_text(SCENARIO)
    files = ["drones/drone1/flight.mcap", "drones/drone9/flight.mcap", "metrics.json", "notes.txt"]
    for name in files:
        (tmp_path / "run" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "run" / name).write_text("old")
    with flight(load("pair.yaml", []), tmp_path / "run", in_process=True) as f:
        f.write_inputs()
        assert [n for n in files if (tmp_path / "run" / n).exists()] == ["notes.txt"]
    with flight(load("pair.yaml", []), tmp_path / "run", in_process=True, anew=True) as f:
        assert not f.folder.exists()
