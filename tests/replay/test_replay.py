"""A recorded flight through today's code.

It differs where behaviour was changed. Where the change is wanted, fly it anew:
`python -m pytest tests/replay --renew-flight`, and commit `flight.mcap`.
"""

import json

import pytest

from companion.__main__ import main
from companion.logfile import read_log
from companion.replay import replay


@pytest.fixture(scope="module")
def log(flight):
    return read_log(flight)


def test_todays_code_decides_as_recorded(log):
    outcome = replay(log)
    assert outcome.first is None, outcome.text()
    assert outcome.ticks > 100


def test_the_flight_has_something_to_decide(log):
    assert {t["phase"] for t in log.ticks} >= {"arm", "takeoff", "engage", "fly"}
    assert any(len(t["critical"]) > 1 for t in log.ticks)
    assert any(t["cylinders"] for t in log.ticks)


def test_one_weight_changed_is_found_and_located(log, flight, capsys):
    change = ["--set", "nmpc.speed=1.45"]
    assert main(["replay", str(flight), "--json", *change]) == 1
    outcome = json.loads(capsys.readouterr().out)
    flying = next(n for n, t in enumerate(log.ticks) if "plan" in t)
    assert outcome["first"]["tick"] == flying
    assert outcome["first"]["what"].startswith("command.")
    assert outcome["omega"] > 0.01
    assert main(["replay", str(flight), *change]) == 1
    assert f"first at tick {flying}, t = " in capsys.readouterr().out


def test_a_change_of_the_tracker_is_found_before_it_shows_in_commands(log):
    outcome = replay(log, ["tracker.hits_to_confirm=4"])
    assert outcome.first.what == "critical"


def test_a_config_of_another_time_is_one_clear_error(flight, capsys):
    assert main(["replay", str(flight), "--set", "nmpc.no_such=1"]) == 2
    assert "nmpc.no_such: unknown key" in capsys.readouterr().err
