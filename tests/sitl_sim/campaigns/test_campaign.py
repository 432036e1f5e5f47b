"""Campaigns: resumed, and with the same truth on every executor."""

import contextlib
import json
import signal
import subprocess
import sys
import time
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pyarrow.parquet
import pytest

from sitl_sim.__main__ import main
from sitl_sim.campaigns.campaign import Campaign, run
from tests.sitl_sim.campaigns.cluster import Cluster

SCENARIO = """
fileversion: 1
name: hop
drones: {count: 2, jitter: 0.3, heading_deg: 0.0}
mission: {targets: [[30.0, 0.0, 2.0]], home: false, time_limit: 5.0}
sensing: {neighbours: truth, obstacles: map}
"""


@pytest.fixture
def scenario(tmp_path):
    file = tmp_path / "hop.yaml"
    file.write_text(SCENARIO)
    return str(file)


def campaign(scenario, out, *options):
    return main(
        ["campaign", scenario, "--out", str(out), "--workers", "2", "--in-process", *options]
    )


def open_files_in(folder):
    """Files of this folder that a process has open."""
    found = []
    for files in Path("/proc").glob("[0-9]*/fd"):
        with contextlib.suppress(OSError):
            found += [f for f in files.iterdir() if str(f.readlink()).startswith(str(folder))]
    return found


def truths(folder):
    return {
        m["seed"]: m["truth_sha256"]
        for m in (json.loads(p.read_text()) for p in sorted(folder.glob("*/metrics.json")))
    }


def table_of(folder):
    return pyarrow.parquet.read_table(folder / "flights.parquet")["seed"].to_pylist()


def test_a_campaign_flies_only_the_missing_runs(scenario, tmp_path, capsys):
    out = tmp_path / "out"
    assert campaign(scenario, out, "--runs", "2", "--seed", "5") == 1  # too short to arrive
    text = capsys.readouterr().out
    assert "0 of 2: 0.0%, 95 % 0.0% to 65.8% (Wilson)" in text
    assert "seed 5" in text
    assert "targets missed by drone1, drone2" in text
    first = truths(out)
    assert set(first) == {5, 6}
    assert first[5] != first[6]
    assert not (out / "unfinished").exists()
    (out / "hop-6" / "metrics.json").unlink()
    (out / "hop-5" / "mark").touch()
    assert campaign(scenario, out, "--runs", "3", "--seed", "5", "--json") == 1
    said = capsys.readouterr()
    assert sorted(line.split(":")[0] for line in said.err.splitlines()) == ["seed 6", "seed 7"]
    assert (out / "hop-5" / "mark").exists()
    summary = json.loads(said.out)
    assert summary == json.loads((out / "summary.json").read_text())
    assert (summary["runs"], summary["flown"], summary["ok"]) == (3, 3, 0)
    assert truths(out) == first | {7: truths(out)[7]}
    assert "<b>0 of 3</b>" in (out / "campaign.html").read_text()
    campaign(scenario, out, "--runs", "1", "--seed", "6")  # of what is there, what was asked for
    assert "0 of 1: 0.0%" in capsys.readouterr().out
    assert "<b>0 of 1</b>" in (out / "campaign.html").read_text()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ('{"ok": tr', "metrics.json: not what a run wrote"),
        ("[1]", "metrics.json: not what a run wrote"),
        ('{"ok": true}', "runs of another version, without 'agent_collisions'"),
    ],
)
def test_runs_that_cannot_be_counted_are_named_before_more_are_flown(
    scenario, tmp_path, capsys, content, words
):
    run_folder = tmp_path / "out" / "hop-0"
    run_folder.mkdir(parents=True)
    (run_folder / "metrics.json").write_text(content)
    assert campaign(scenario, tmp_path / "out", "--runs", "2") == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out" / "hop-1").exists()


class Fragile:
    """Two workers; the worker that flies seed 3 dies, and all flights beside it with it."""

    slots = 2

    def __init__(self):
        self.pool = {}
        self.stored = []
        self.most = 0

    def submit(self, job):
        future = self.pool[job.seed] = Future()
        self.most = max(self.most, sum(not f.done() for f in self.pool.values()))
        if job.seed == 3:
            for other in self.pool.values():
                if not other.done():
                    other.set_exception(BrokenProcessPool("a worker died"))
        elif job.seed != 2 or 3 in self.pool:
            future.set_result(None)
        return future

    def store(self, job, result):
        self.stored.append(job.seed)

    def restart(self):
        assert all(f.done() for f in self.pool.values())


class Idle(Fragile):
    """An executor whose idle worker dies: it takes no work until it is restarted."""

    def __init__(self):
        super().__init__()
        self.ill = False

    def submit(self, job):
        if self.ill:
            raise BrokenProcessPool("a worker died")
        self.ill = job.seed == 1
        future = Future()
        future.set_result(None)
        return future

    def restart(self):
        self.ill = False


def test_a_worker_that_dies_between_flights_costs_no_flight(scenario, tmp_path):
    told, executor = {}, Idle()
    assert run(Campaign(scenario, [], 4, 0, tmp_path), executor, told.__setitem__) == {}
    assert sorted(executor.stored) == sorted(told) == [0, 1, 2, 3]


class Lost(Fragile):
    """A cluster whose scheduler ends: all that it was given is cancelled."""

    def submit(self, job):
        future = Future()
        future.cancel()
        future.set_running_or_notify_cancel()
        return future


def test_flights_of_a_lost_scheduler_say_so(scenario, tmp_path):
    flights = Campaign(scenario, [], 3, 0, tmp_path)
    told = {}
    broken = run(flights, Lost(), told.__setitem__)
    assert broken == told == dict.fromkeys(range(3), "the scheduler was lost")


def test_a_worker_that_dies_takes_no_other_flight_with_it(scenario, tmp_path):
    told, executor = {}, Fragile()
    flights = Campaign(scenario, [], 6, 0, tmp_path)
    broken = run(flights, executor, lambda seed, what: told.update({seed: what}))
    assert list(broken) == [3]
    assert "BrokenProcessPool" in broken[3]
    assert sorted(executor.stored) == [0, 1, 2, 4, 5]
    assert sorted(told) == list(range(6))
    assert executor.most == 2


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--set", "drones.cuont=1"], "drones.cuont: unknown key"),
        (["--scheduler", "tcp://127.0.0.1:1"], "--scheduler tcp://127.0.0.1:1"),
        (["--controller", "foo"], ": controller: no controller 'foo'; valid: nmpc, "),
        (["--set", "companion.nmpc.typo=1"], ": nmpc.typo: unknown key"),
        (["--set", "drones.parameters.FOO=1"], "px4 has no such parameter; valid: BAT1_CAP"),
        (["--set", "drones.autopilot=betaflight"], "no --in-process"),
    ],
)
def test_bad_input_is_status_2(scenario, tmp_path, capsys, options, words):
    assert campaign(scenario, tmp_path / "out", *options) == 2
    assert words in capsys.readouterr().err


def test_a_flight_that_cannot_be_flown_is_named_and_the_others_fly(scenario, tmp_path, capsys):
    out = tmp_path / "out"
    wrong = ["--set", "sensing.calibration=missing.yaml"]  # not read before the flight
    assert campaign(scenario, out, "--runs", "1", *wrong, "--json") == 1
    summary = json.loads(capsys.readouterr().out)
    assert (summary["flown"], summary["tried"], summary["success"]) == (0, 1, 0.0)
    assert "missing.yaml" in summary["not_flown"]["0"]


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_an_ended_campaign_is_resumed(scenario, tmp_path, how):
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-m",
        "sitl_sim",
        "campaign",
        scenario,
        "--out",
        str(out),
        "--runs",
        "3",
        "--workers",
        "1",
        "--in-process",
        "--table",
    ]
    process = subprocess.Popen(command)
    deadline = time.monotonic() + 200
    while not (out / "hop-0").exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    process.send_signal(how)
    process.wait(timeout=10.0)
    time.sleep(1.0)
    assert not list((out / "unfinished").glob("*/metrics.json"))
    assert not open_files_in(out)
    before = truths(out)
    assert 0 < len(before) < 3
    assert set(table_of(out)) <= set(before)
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert said.returncode == 1
    assert len(said.stderr.splitlines()) == 3 - len(before)
    assert truths(out).items() >= before.items()
    assert set(truths(out)) == {0, 1, 2}
    assert table_of(out) == [0, 1, 2]


@pytest.mark.slow
def test_the_same_truth_on_a_dask_cluster_and_with_processes_side_by_side(scenario, tmp_path):
    runs = ["campaign", scenario, "--runs", "2", "--out"]
    with Cluster(tmp_path) as cluster:
        cluster.join()
        cluster.join()
        main([*runs, str(tmp_path / "dask"), "--scheduler", cluster.address])
    main([*runs, str(tmp_path / "local"), "--workers", "2"])
    campaign(scenario, tmp_path / "one", "--runs", "2")
    found = [truths(tmp_path / name) for name in ("dask", "local", "one")]
    assert set(found[0]) == {0, 1}
    assert found[0] == found[1] == found[2]
