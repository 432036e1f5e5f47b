"""A recorded flight through the present code.

The first test fails where behaviour changed. If the change is wanted, record the flight anew
(`make renew-flight`, half a minute) and commit `companion/bench/flight.mcap`.
"""

import dataclasses
import json

import pytest

from companion.__main__ import main
from companion.flightlog.reader import read_log
from companion.flightlog.replay import configured, replay, rerun
from companion.settings.config import FILEVERSION
from mavlink_bridge.shared.settings import SettingsError


@pytest.fixture(scope="module")
def log(flight):
    return read_log(flight)


@pytest.fixture(scope="module")
def today(log):
    """The same flight as the present code would have recorded it."""
    return dataclasses.replace(log, ticks=list(rerun(configured(log), log.inputs)))


def test_the_present_code_decides_as_recorded(log):
    outcome = replay(log)
    assert outcome.first is None, f"{outcome.text()}\nIf wanted: make renew-flight"
    assert outcome.ticks > 100


def test_the_flight_has_something_to_decide(log):
    assert {t["phase"] for t in log.ticks} >= {"arm", "takeoff", "engage", "fly"}
    assert any(len(t["critical"]) > 1 for t in log.ticks)
    assert any(t["cylinders"] for t in log.ticks)


def test_one_weight_changed_is_found_and_located(today):
    assert replay(today).omega == 0.0
    outcome = replay(today, ["nmpc.speed=1.45"])
    planned = next(n for n, t in enumerate(today.ticks) if "plan" in t)
    assert planned <= outcome.first.tick < planned + 10  # as soon as it shows in a command
    assert outcome.first.what.startswith("command.")
    assert outcome.omega > 0.01
    place = f"first at tick {outcome.first.tick}, t = {outcome.first.time:.3f} s: command."
    assert place in outcome.text()


def test_a_change_of_the_tracker_shows_as_a_decision(today):
    assert replay(today, ["tracker.ghosts=0.3"]).first.what == "critical"


def test_from_the_command_line(flight, capsys):
    assert main(["replay", str(flight), "--json", "--set", "nmpc.speed=1.2"]) == 1
    assert json.loads(capsys.readouterr().out)["first"]["time"] > 0.0


def test_an_unknown_key_is_one_clear_error(flight, capsys):
    assert main(["replay", str(flight), "--set", "nmpc.no_such=1"]) == 2
    assert "nmpc.no_such: unknown key" in capsys.readouterr().err


def test_a_calibration_that_is_not_here_is_one_clear_error(flight, capsys):
    assert main(["replay", str(flight), "--set", "camera.calibration=none.yaml"]) == 2
    assert "none.yaml: cannot read calibration" in capsys.readouterr().err


def test_a_recorded_key_that_is_gone_is_one_clear_error(log):
    config = log.config | {"tracker": {"gone": 1.0}}
    with pytest.raises(
        SettingsError, match=r"the log's configuration:1:\d+: tracker.gone: unknown"
    ):
        replay(dataclasses.replace(log, config=config))


def test_the_log_holds_no_defaults(log):
    assert "nmpc" not in log.config


def test_a_log_in_the_keys_of_fileversion_1_is_upgraded(log):
    old = {"fileversion": 1, "eye": {"late": 0.2}, "threat": {"d_ref": 1.5, "room": 1.3}}
    config = configured(dataclasses.replace(log, config=log.config | old))
    assert config.fileversion == FILEVERSION
    assert (config.camera_health.late, config.speed_limits.clearance) == (0.2, 1.3)
