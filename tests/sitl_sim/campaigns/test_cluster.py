"""Campaigns on a Dask cluster whose workers are lost and join while it flies."""

import json
import os
import signal
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import pyarrow.parquet
import pytest

from sitl_sim.__main__ import main
from sitl_sim.campaigns.run import Job, fly
from sitl_sim.campaigns.table import OF_FLIGHT
from tests.sitl_sim.campaigns.cluster import Cluster, until

SCENARIO = """
fileversion: 1
name: hop
drones: {count: 1, jitter: 0.3, heading_deg: 0.0}
mission: {targets: [[3.0, 0.0, 2.0]], home: false, time_limit: 9.0}
sensing: {neighbours: truth, obstacles: map}
"""
ARRIVES = SCENARIO.replace("time_limit: 9.0", "time_limit: 13.0")
# A world: of the seeds 0 and 1, it kills the process that is about to fly 1.
DEADLY = """
import os
import signal


def deadly(config, rng):
    if rng.random() < 0.5 and "DEADLY" in os.environ:
        os.kill(os.getpid(), signal.SIGKILL)
    return {}
"""


@pytest.fixture
def scenario(tmp_path):
    file = tmp_path / "hop.yaml"
    file.write_text(SCENARIO)
    return str(file)


def campaign(scenario, out, runs, *options):
    command = ["campaign", scenario, "--out", str(out), "--runs", str(runs), "--in-process"]
    return main([*command, "--table", *options])


def rows(folder):
    return pyarrow.parquet.read_table(folder / "flights.parquet").to_pylist()


def of_flight(folder):
    return [{key: row[key] for key in OF_FLIGHT} for row in rows(folder)]


def same_as_here(scenario, out, seeds, folder):
    """Whether the flights are those of one process that flies them one after another."""
    for seed in seeds:
        fly(Job(scenario, (), seed, str(folder / f"hop-{seed}"), in_process=True))
    campaign(scenario, folder, max(seeds) + 1)  # flies nothing; makes the table
    flown = {row["seed"]: row for row in of_flight(folder)}
    return [row for row in of_flight(out) if row["seed"] in seeds] == [flown[s] for s in seeds]


def flown(folder, least):
    return len(list(folder.glob("hop-*"))) >= least


def workers_of(folder):
    return {int(row["worker"].rpartition(":")[2]) for row in rows(folder)}


def test_a_lost_worker_and_one_that_joins_cost_no_flight_and_change_none(scenario, tmp_path):
    out, runs = tmp_path / "dask", 4

    def lose_and_join():
        until(partial(flown, out, 1))
        cluster.kill_in_flight(first)
        cluster.join()

    with Cluster(tmp_path) as cluster, ThreadPoolExecutor() as meanwhile:
        first = cluster.join()
        losing = meanwhile.submit(lose_and_join)
        campaign(scenario, out, runs, "--scheduler", cluster.address)
        losing.result()
    assert workers_of(out) == {worker.pid for worker in cluster.workers}
    assert [row["seed"] for row in rows(out)] == list(range(runs))
    assert len({row["truth_sha256"] for row in rows(out)}) == runs
    assert all(row["solve_p50_ms"] for row in rows(out))
    assert same_as_here(scenario, out, range(runs), tmp_path / "here")


def test_a_flight_that_kills_its_workers_is_given_up_and_the_others_fly(
    scenario, tmp_path, monkeypatch
):
    (tmp_path / "deadly.py").write_text(DEADLY)
    Path(scenario).write_text(f"{SCENARIO}world: {{generator: 'deadly:deadly'}}\n")
    monkeypatch.syspath_prepend(tmp_path)
    environment = {
        "DEADLY": "1",
        "PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, [os.getenv("PYTHONPATH")])]),
        "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1",
        "DASK_DISTRIBUTED__SCHEDULER__WORKER_SATURATION": "1.0",
    }
    with Cluster(tmp_path, **environment) as cluster:
        for _ in range(3):
            cluster.join()
        assert campaign(scenario, tmp_path / "out", 2, "--scheduler", cluster.address) == 1
        died = [worker.poll() for worker in cluster.workers]
    assert sorted(died, key=str) == [-signal.SIGKILL, -signal.SIGKILL, None]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert list(summary["not_flown"]) == ["1"]
    good, given_up = rows(tmp_path / "out")
    assert (good["seed"], good["verdict"]) == (0, "falls short")
    assert (given_up["seed"], given_up["verdict"]) == (1, "not flown")
    assert "KilledWorker" in given_up["why"]


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_400_flights_while_workers_are_lost_and_join(scenario, tmp_path):
    out, runs = tmp_path / "dask", 400
    Path(scenario).write_text(ARRIVES)

    def lose_and_join():
        for n in range(4):
            until(partial(flown, out, 40 + 80 * n), 3000.0)
            cluster.join()
            cluster.kill_in_flight(cluster.workers[n])

    with Cluster(tmp_path) as cluster, ThreadPoolExecutor() as meanwhile:
        cluster.join()
        cluster.join()
        losing = meanwhile.submit(lose_and_join)
        assert campaign(scenario, out, runs, "--scheduler", cluster.address) == 0
        losing.result()
    assert len(cluster.workers) == 6
    assert workers_of(out) == {worker.pid for worker in cluster.workers}
    assert [row["seed"] for row in rows(out)] == list(range(runs))
    assert same_as_here(scenario, out, range(runs), tmp_path / "here")
