"""Ctrl-C in any command is one line on stderr and status 130, and an interrupted flight is not OK.

Each command runs in a process group of its own; the signal goes to the whole group, as a
terminal sends it.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time

import pytest

from tests.sitl_sim import flights

SCENARIO = """
fileversion: 1
name: far
drones: {{count: 1, heading_deg: 0.0}}
mission: {{targets: [[900.0, 0.0, 2.0]], home: false, time_limit: {limit}}}
sensing: {{neighbours: truth, obstacles: map}}
wire: {{companion_port: {port}00, gcs_port: {port}20, frame_port: {port}40}}
"""
STUDY = """
title: Far
scenarios: [{scenario}]
cases: {{plain: []}}
"""
SOON = 120.0  # s, on a busy machine


@pytest.fixture
def scenario(tmp_path):
    file = tmp_path / "far.yaml"
    file.write_text(SCENARIO.format(limit=900.0, port=275))
    return file


@contextlib.contextmanager
def started(folder, *arguments):
    """A running `sitl-sim` whose output goes to files in `folder`."""
    with (folder / "out").open("w") as out, (folder / "err").open("w") as err:
        process = subprocess.Popen(
            [sys.executable, "-m", "sitl_sim", *map(str, arguments)],
            cwd=folder,
            stdout=out,
            stderr=err,
            start_new_session=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1", "PYTHONPATH": ":".join(sys.path)},
        )
        try:
            yield process
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def wait_until(condition, process):
    deadline = time.monotonic() + SOON
    while not condition():
        assert process.poll() is None, "ended before it was interrupted"
        assert time.monotonic() < deadline
        time.sleep(0.02)


def interrupt(process, number=signal.SIGINT):
    """Exit status after the signal."""
    os.killpg(process.pid, number)
    return process.wait(timeout=SOON)


def lines(folder):
    return (folder / "err").read_text().splitlines()


def test_an_interrupted_flight_is_kept_and_is_not_ok(tmp_path, scenario):
    with started(tmp_path, "run", scenario, "--in-process", "--out", "run") as process:
        wait_until(lambda: "10 s flown" in (tmp_path / "err").read_text(), process)
        assert interrupt(process) == 130
    told = [line for line in lines(tmp_path) if not line.endswith(" s flown")]
    assert told == ["interrupted: what was flown is kept in run"]
    assert "FALLS SHORT: interrupted; targets missed" in (tmp_path / "out").read_text()
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert (metrics["interrupted"], metrics["ok"]) == (True, False)
    assert metrics["duration_s"] >= 10.0
    assert metrics["bad_solves"] == 0
    assert metrics["companion_errors"] == {}
    assert (tmp_path / "run" / "truth.npz").exists()


@pytest.mark.parametrize("way", [["--in-process"], []])
def test_an_interrupt_while_companions_start_is_one_line(tmp_path, scenario, way):
    with started(tmp_path, "run", scenario, "--out", "run", *way) as process:
        wait_until((tmp_path / "run" / "world.json").exists, process)
        assert interrupt(process) == 130
    told = [line for line in lines(tmp_path) if not line.startswith("drone1: system 1")]
    assert [line.partition(":")[0] for line in told] == ["interrupted"]


@pytest.mark.parametrize("way", [["--in-process"], []])
def test_an_interrupted_campaign_is_one_line(tmp_path, scenario, way):
    command = ["campaign", scenario, "--runs", 3, "--workers", 2, "--out", "all", *way]
    with started(tmp_path, *command) as process:
        begun = (tmp_path / "all" / "unfinished").glob
        wait_until(lambda: len(list(begun("*/world.json"))) == 2, process)
        assert interrupt(process) == 130
    assert lines(tmp_path) == ["interrupted"]


def test_an_interrupted_study_is_one_line(tmp_path, scenario):
    (tmp_path / "study.yaml").write_text(STUDY.format(scenario=scenario))
    command = ["study", "study.yaml", "--runs", 1, "--workers", 1, "--out", "all"]
    with started(tmp_path, *command) as process:
        begun = (tmp_path / "all").glob
        wait_until(lambda: list(begun("far/plain/unfinished/*/world.json")), process)
        assert interrupt(process) == 130
    assert lines(tmp_path) == [f"{scenario}, plain", "interrupted"]


def test_an_interrupted_soak_is_one_line(tmp_path):
    with started(tmp_path, "soak", "--drones", 1, "--minutes", 0.1) as process:
        wait_until(lambda: (tmp_path / "out").read_text().count("\n") > 0, process)
        assert interrupt(process) == 130
    assert lines(tmp_path) == ["interrupted"]


def test_an_interrupted_view_is_one_line(tmp_path):
    flights.write_run(tmp_path / "run")
    with started(tmp_path, "view", "run", "--port", 0) as process:
        wait_until(lambda: "http" in (tmp_path / "out").read_text(), process)
        assert interrupt(process) == 130
    assert lines(tmp_path) == ["interrupted"]
