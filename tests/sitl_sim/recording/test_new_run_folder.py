"""A new flight gets a folder of its own: nothing of an earlier flight is deleted or mixed in."""

import json
import socket
import threading

import pytest

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.__main__ import main
from sitl_sim.flight.runner import flight
from sitl_sim.recording.new_run_folder import new_run_folder
from sitl_sim.scenarios.scenario import load

SCENARIO = """
fileversion: 1
name: pair
seed: 3
drones: {count: 1}
mission: {targets: [[8.0, 0.0, 2.0]], time_limit: 0.5}
sensing: {neighbours: truth, obstacles: map}
wire: {companion_port: 27840, gcs_port: 27850, frame_port: 27860}
"""


@pytest.fixture
def runs(tmp_path, monkeypatch):
    """The folder of default run folders, beside pair.yaml."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pair.yaml").write_text(SCENARIO)
    return tmp_path / "runs"


def test_a_second_run_moves_on_to_a_folder_of_its_own_and_says_so(runs, capsys):
    run = ["run", "pair.yaml", "--in-process"]
    assert main(run) == 1
    (runs / "pair-3" / "notes.txt").write_text("mine")
    first = (runs / "pair-3" / "metrics.json").read_bytes()
    capsys.readouterr()
    assert main(run) == main(run) == 1
    assert "runs/pair-3 holds a flight; this one goes to runs/pair-3-2" in capsys.readouterr().err
    assert sorted(p.name for p in runs.iterdir()) == ["pair-3", "pair-3-2", "pair-3-3"]
    assert (runs / "pair-3" / "notes.txt").read_text() == "mine"
    assert (runs / "pair-3" / "metrics.json").read_bytes() == first
    shas = [json.loads(p.read_text())["truth_sha256"] for p in runs.glob("*/metrics.json")]
    assert len(set(shas)) == 1


@pytest.mark.parametrize("file", ["metrics.json", "truth.npz", "drones/drone1/flight.mcap"])
def test_an_out_that_holds_a_flight_is_refused_in_one_line(runs, capsys, file):
    theirs = runs / "theirs" / file
    theirs.parent.mkdir(parents=True)
    theirs.write_text("theirs")
    assert main(["run", "pair.yaml", "--in-process", "--out", "runs/theirs"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "--out runs/theirs: holds a flight; name another folder"
    assert theirs.read_text() == "theirs"


def test_an_out_with_other_files_is_used_and_they_stay(runs):
    (runs / "mine").mkdir(parents=True)
    (runs / "mine" / "notes.txt").write_text("before the flight")
    assert main(["run", "pair.yaml", "--in-process", "--out", "runs/mine"]) == 1
    assert (runs / "mine" / "notes.txt").read_text() == "before the flight"
    assert (runs / "mine" / "metrics.json").exists()


def test_runs_that_begin_together_get_folders_apart(runs):
    got, all_in = [], threading.Barrier(5)

    def begin():
        all_in.wait()
        with new_run_folder(None, runs / "pair-3") as folder:
            got.append(folder.name)
            all_in.wait()

    threads = [threading.Thread(target=begin) for _ in range(5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(got) == ["pair-3", *(f"pair-3-{n}" for n in (2, 3, 4, 5))]


def test_an_out_that_another_flight_writes_is_refused(runs):
    with (
        new_run_folder(runs / "one", runs / "pair-3"),
        pytest.raises(SettingsError, match="another flight is written into it"),
        new_run_folder(runs / "one", runs / "pair-3"),
    ):
        pass


def test_a_start_that_fails_leaves_the_folder_for_the_next(runs, capsys):
    with socket.create_server(("127.0.0.1", 27861)):
        assert main(["run", "pair.yaml"]) == 2
    assert "27861" in capsys.readouterr().err
    with new_run_folder(None, runs / "pair-3") as folder:
        assert folder == runs / "pair-3"


def test_no_flight_is_written_into_the_folder_of_another(runs):
    (runs / "metrics.json").parent.mkdir()
    (runs / "metrics.json").write_text("{}")
    with (
        flight(load("pair.yaml", []), runs, in_process=True) as f,
        pytest.raises(SettingsError, match="holds a flight"),
    ):
        f.write_inputs()
