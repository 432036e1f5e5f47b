import dataclasses
import json

import pytest

from companion.__main__ import main
from companion.commands import status as status_command
from companion.flightlog import status as status_module
from companion.flightlog.recorder import Recorder
from tests.companion.ticks import COSTS, config, tick


@pytest.fixture
def drone(tmp_path, monkeypatch):
    """A drone's file, and a daemon that has logged seven ticks and goes on."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(status_module, "_SERVICE_LOGS", tmp_path / "service")
    file = tmp_path / "tester.yaml"
    file.write_text("fileversion: 2\nname: tester\nlog: {path: 'flight-{time}.mcap'}\n")
    log = tmp_path / "flight-20260101T000000Z.mcap"
    recorder = Recorder(config(log), log)
    for n in range(7):
        recorder.write(*tick(n), [], {"deadline_misses": 3}, COSTS)
    yield file
    recorder.close()


def test_a_running_daemon_in_the_terminal(drone, capsys):
    assert main(["status", str(drone)]) == 0
    text = capsys.readouterr().out
    assert text.startswith("running, tick at 0.4 s")  # the last whole chunk
    for words in (
        "fly, target 1",
        "guard    plan",
        "see 4.0, plan 10.0, tick 20.0, log 1.0 ms",
        "6, 3 critical",
        "4 drones, 5 trunks",
        "deadline_misses 3",
    ):
        assert words in text


def test_the_last_refusal_is_shown(tmp_path, capsys):
    log = tmp_path / "a.mcap"
    recorder = Recorder(config(log), log)
    for n in range(4):
        inputs, now = tick(n)
        told = ("arm: denied", "arming denied: no gyro") if n == 1 else ()
        vehicle = dataclasses.replace(now.vehicle, refusals=told)
        recorder.write(inputs, dataclasses.replace(now, vehicle=vehicle), [], {}, COSTS)
    recorder.close()
    assert main(["status", str(log)]) == 0
    assert "refused  arm: denied; arming denied: no gyro, at 0.1 s" in capsys.readouterr().out


def test_for_machines(drone, capsys):
    assert main(["status", "--json", str(drone)]) == 0
    assert json.loads(capsys.readouterr().out)["command"]["reason"] == "plan"


def test_from_the_log_itself_and_from_the_services_directory(drone, tmp_path, capsys):
    (log,) = tmp_path.glob("*.mcap")
    assert main(["status", str(log)]) == 0
    (tmp_path / "service" / "tester").mkdir(parents=True)
    log.rename(tmp_path / "service" / "tester" / log.name)
    assert main(["status", str(drone)]) == 0
    assert capsys.readouterr().out.count("phase    fly") == 2


def test_a_daemon_that_stopped_is_not_shown_as_running(drone, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(status_module, "_STALE", -1.0)
    main(["status", str(drone)])
    assert capsys.readouterr().out.startswith("not running, last tick at 0.4 s")


@pytest.mark.parametrize("options", [[], ["--json"]])
def test_watching_goes_on_with_the_next_log_when_one_is_gone(
    drone, tmp_path, capsys, monkeypatch, options
):
    (log,) = tmp_path.glob("*.mcap")
    away = tmp_path / "away"
    steps = iter([lambda: log.rename(away), lambda: None, lambda: away.rename(log), None])

    def sleep(seconds):
        step = next(steps)
        if step is None:
            raise KeyboardInterrupt
        step()

    monkeypatch.setattr(status_command.time, "sleep", sleep)
    assert main(["status", "--watch", *options, str(drone)]) == 130
    said = capsys.readouterr()
    assert said.err.splitlines() == [f"{drone}: the log is gone, waiting", "interrupted"]
    assert said.out.count("4 drones, 5 trunks" if not options else '"phase"') == 2


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("fileversion: 2\nlog: {path: gone.mcap}\n", "no flight log at gone.mcap"),
        ("fileversion: 2\n", "log.path: not set"),
        ("fileversion: 2\nlog: {path: empty.mcap}\n", "empty.mcap: empty"),
        ("fileversion: 2\nlog: {path: begun.mcap}\n", "begun.mcap: no tick so far"),
    ],
)
def test_without_a_log_one_clear_line_and_exit_2(drone, tmp_path, capsys, content, words):
    (tmp_path / "empty.mcap").write_bytes(b"")
    begun = tmp_path / "begun.mcap"
    Recorder(config(begun), begun).close()
    drone.write_text(content)
    assert main(["status", str(drone)]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert words in lines[0]


def test_what_the_ground_says_of_velocity_and_heading_is_shown_with_its_doubt():
    record = {"velocity_by_sight": [0.3, -0.4, 0.1], "heading_by_sight": [-0.0698, 0.0262]}
    text = status_module._motion(record)
    assert text == "velocity wrong by 0.50 ± 0.10 m/s, heading by -4 ± 2°"
    before = {"velocity_by_sight": [0.3, -0.4, 0.1, 0.0, 0.0]}  # a log of 0.1
    assert status_module._motion(before) == "-"
