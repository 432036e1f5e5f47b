"""Events of a flight, from logs, truth and the scenario's faults."""

import dataclasses

import pytest

from sitl_sim.figures.belief_figures import timeline
from sitl_sim.figures.events import events
from sitl_sim.recording.run_folder import load_run
from tests.sitl_sim import flights


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return flights.write_run(tmp_path_factory.mktemp("run"))


def test_events_are_those_of_the_logs(folder):
    found = events(load_run(folder))
    mine = [(e.kind, e.text) for e in found if e.drone == "drone1"]
    assert mine[0] == ("phase", "takeoff")
    assert ("phase", "fly") in mine
    assert mine.count(("guard", "guard: brake")) == 3


def test_faults_of_the_scenario_are_on_the_time_line(folder):
    run = load_run(folder)
    faults = [
        {"kind": "gust", "drone": "drone2", "at": 3.0, "for": 2.0, "amount": 4.0},
        {"kind": "camera_dead", "drone": "drone3", "at": 5.0},
        {"kind": "kill", "at": 99.0},
    ]
    told = run.scenario.model_dump(by_alias=True) | {"faults": faults}
    run = dataclasses.replace(run, scenario=type(run.scenario).model_validate(told))
    found = [(e.time, e.drone, e.text) for e in events(run) if e.kind == "fault"]
    assert found == [
        (3.0, "drone2", "fault: gust 4"),
        (5.0, "drone2", "fault over: gust 4"),
        (5.0, "drone3", "fault: camera_dead"),
    ]
    bars = [t for t in timeline(run, events(run)).data if t.mode == "lines"]
    assert [(tuple(b.x), b.text) for b in bars] == [
        ((3.0, 5.0), "gust 4"),
        ((5.0, run.truth["t"][-1]), "camera_dead"),
    ]


def test_silence_and_disarming_are_events(folder):
    run = load_run(folder)
    log = run.logs["drone1"]
    run.truth["armed"][300:, 1] = False
    logs = {"drone1": log[:50] + log[80:], "drone2": log[:60], "drone3": []}
    found = events(dataclasses.replace(run, logs=logs))
    odd = [(e.drone, e.kind, e.text) for e in found if e.kind in ("silence", "vehicle")]
    assert sorted(odd) == [
        ("drone1", "silence", "no tick for 3.1 s"),
        ("drone2", "silence", "the log ends here"),
        ("drone2", "vehicle", "disarmed at 2.0 m"),
        ("drone3", "silence", "no log"),
    ]
