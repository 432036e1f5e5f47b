import contextlib
import dataclasses
import json
import re

import numpy as np
import pytest

from sitl_sim.__main__ import main
from sitl_sim.figures.belief import Beliefs
from sitl_sim.figures.belief_figures import timeline
from sitl_sim.figures.events import collisions, events
from sitl_sim.figures.metrics import sanity
from sitl_sim.figures.perception import score_frames
from sitl_sim.figures.report import shortcomings, summarise, write_report
from sitl_sim.recording.run_folder import load_run, log_path, salvage_ticks
from sitl_sim.viewer import Page, Replay
from tests.sitl_sim import flights


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return flights.write_run(tmp_path_factory.mktemp("run"))


def test_the_page_is_whole_and_says_what_the_truth_says(folder, capsys):
    assert main(["report", str(folder)]) == 0
    assert capsys.readouterr().out.strip() == str(folder / "report.html")
    page = (folder / "report.html").read_text()
    assert page.count("Plotly.newPlot(") == 8
    assert "<b>OK</b>" in page
    assert not re.search(r'<(script|link|img)[^>]+(src|href)="?http', page)
    for heading in (
        "From above",
        "Trajectories",
        "mean ± std",
        "Network of critical neighbours",
        "Predicted trajectories",
        "Solve and tick times",
        "Perception against truth",
        "Events",
    ):
        assert heading in page
    assert (folder / "report.html").stat().st_size < 15e6


def test_a_collision_is_shown_with_what_led_to_it(tmp_path):
    folder = flights.write_run(tmp_path / "crash", gap=0.15)
    assert main(["report", str(folder)]) == 0
    page = (folder / "report.html").read_text()
    assert "FALLS SHORT" in page
    assert "1 pair(s) of drones collided" in page
    assert "<h3>drone2 with drone3, " in page
    assert "drone2's error about drone3" in page
    (crash,) = collisions(load_run(folder))
    assert (crash.drone, crash.other) == (1, 2)
    assert crash.distance == pytest.approx(0.3)


@pytest.mark.parametrize(("code", "ok"), [(1, False), (-11, False), (-15, True), (None, True)])
def test_a_companion_that_ended_with_an_error_falls_short(folder, code, ok):
    run = load_run(folder)
    summary = summarise(run, {}, {"drone1": 0, "drone2": code})
    assert summary["ok"] is ok
    assert list(shortcomings(summary)) == (
        [] if ok else [f"drone2's companion ended with an error, exit {code}"]
    )


def test_an_interrupted_flight_is_not_ok_and_stays_so(tmp_path):
    folder = flights.write_run(tmp_path / "run")
    summary = summarise(load_run(folder), {}, {}, interrupted=True)
    assert not summary["ok"]
    assert list(shortcomings(summary)) == ["interrupted"]
    (folder / "metrics.json").write_text(json.dumps({"interrupted": True}))
    assert main(["report", str(folder)]) == 0
    assert "FALLS SHORT</b>: interrupted" in (folder / "report.html").read_text()


def test_a_verdict_does_not_rest_on_the_programs_own_word(tmp_path):
    folder = flights.write_run(tmp_path / "crash", gap=0.15)
    (folder / "metrics.json").write_text(json.dumps({"ok": True, "agent_collisions": 0}))
    main(["report", str(folder)])
    assert "FALLS SHORT" in (folder / "report.html").read_text()


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


def test_logs_meet_truth_in_the_worlds_frame(folder):
    run = load_run(folder)
    beliefs = Beliefs(run)
    belief = beliefs.at(0, 8.0)
    truth = beliefs.positions(8.0)
    np.testing.assert_allclose(belief.plan[0], truth[0], atol=0.11)
    np.testing.assert_allclose(belief.plan[-1] - belief.plan[0], [2.0, 0.0, 0.0], atol=1e-6)
    assert belief.critical[0].drone == 1
    np.testing.assert_allclose(belief.tracks, truth[1:], atol=0.11)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda d: d.rename(d.with_name("gone")), "no such run folder"),
        (lambda d: (d / "world.json").unlink(), "world.json: cannot be read"),
        (lambda d: (d / "world.json").write_text("[]"), "world.json: not a world"),
        (lambda d: (d / "metrics.json").write_text(""), "metrics.json: no metrics of a flight"),
        (lambda d: (d / "metrics.json").write_text("[1]"), "metrics.json: no metrics of a flight"),
        (lambda d: world(d, cylinders=[{"x": 1.0, "y": 2.0}]), "an obstacle lacks 'radius'"),
        (lambda d: world(d, boxes=[{"min": [0, 0, 0]}]), "an obstacle lacks 'max'"),
        (lambda d: world(d, targets=[[1, 2, 3]]), "world.json: not a world"),
        (lambda d: world(d, targets={"*": [[1, 2]]}), "world.json: not a world"),
        (lambda d: world(d, target_tolerance=[]), "world.json: not a world"),
        (lambda d: (d / "truth.npz").write_bytes(b""), "truth.npz: empty, foreign or cut off"),
        (lambda d: (d / "truth.npz").write_text("hello"), "truth.npz: empty, foreign or cut off"),
        (lambda d: cut(d / "truth.npz"), "truth.npz: empty, foreign or cut off"),
        (lambda d: np.savez(d / "truth.npz", a=1), "truth.npz: lacks"),
        (lambda d: (d / "scenario.yaml").unlink(), "scenario.yaml: cannot be read"),
        (lambda d: (d / "drones/drone2/flight.mcap").unlink(), "flight.mcap: cannot be read"),
        (lambda d: (d / "drones/drone2/flight.mcap").write_text(""), "flight.mcap: empty"),
        (lambda d: (d / "drones/drone2/flight.mcap").write_text("x"), "flight.mcap: not an MCAP"),
        (lambda d: cut(d / "drones/drone2/flight.mcap"), "flight.mcap: cut off"),
    ],
)
def test_a_spoilt_folder_is_one_clear_line_and_exit_2(tmp_path, capsys, spoil, words):
    folder = flights.write_run(tmp_path / "run")
    spoil(folder)
    assert main(["report", str(folder)]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert words in lines[0]


def test_what_a_world_leaves_out_is_as_the_judge_has_it(tmp_path):
    """No tolerance is 1.5 m, no height is without end, `*` are the targets of all others."""
    folder = flights.write_run(tmp_path / "run")
    whole = load_run(folder)
    shared = {"*": [[9.0, 0.0, 2.0]], "drone2": whole.world["targets"]["drone2"]}
    world(
        folder,
        target_tolerance=None,
        targets=shared,
        cylinders=[
            {"x": 3.0, "y": 6.0, "radius": 0.5},
            {"x": 5.0, "y": 6.0, "radius": 0.5, "height": None},
        ],
    )
    run = load_run(folder)
    assert run.world["target_tolerance"] == 1.5
    assert run.world["targets"] == {
        "drone1": shared["*"],
        "drone2": shared["drone2"],
        "drone3": shared["*"],
    }
    assert [c["height"] for c in run.world["cylinders"]] == [np.inf] * 2
    assert main(["report", str(folder)]) == 0
    assert "drone2 1/1" in (folder / "report.html").read_text()
    with contextlib.closing(Page(Replay(run), port=0)):
        pass  # drawn, however tall


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["frames", "frames", "--seed", "-1"], "--seed: must be at least 0, got -1"),
        (["soak", "--seed", "-1"], "--seed: must be at least 0"),
        (["soak", "--hours", "0"], "--hours: must be at least 0.001"),
        (["soak", "--minutes", "nan"], "--minutes: must be at least 0.01"),
    ],
)
def test_what_cannot_be_made_is_one_clear_line(tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert words in line


def test_a_folder_without_a_flight_is_refused(tmp_path, capsys):
    assert main(["report", str(tmp_path)]) == 2
    assert "world.json: cannot be read" in capsys.readouterr().err


def test_after_the_flight_a_killed_companions_log_still_counts(tmp_path):
    folder = flights.write_run(tmp_path / "run")
    log = log_path(folder, "drone2")
    assert len(salvage_ticks(log)) == 116
    log.write_bytes(log.read_bytes()[:-600])
    run = load_run(flights.write_run(tmp_path / "whole"))
    logs = run.logs | {"drone2": salvage_ticks(log), "drone3": salvage_ticks(tmp_path / "none")}
    assert logs["drone3"] == []
    cut_short = dataclasses.replace(run, logs=logs)
    seen = score_frames(run.scenario, run.world, run.truth, logs)
    summary = summarise(cut_short, seen, {})
    assert summary["ok"]
    assert write_report(cut_short, summary, seen).stat().st_size > 1e6


def test_truth_that_cannot_be_is_noticed():
    assert sanity(flights.truth()) == []
    for spoil, words in [
        (lambda w: w["position"].__setitem__((300, 0), [9.0, 9.0, 9.0]), "disagree"),
        (lambda w: w["attitude"].__setitem__((5, 0), [1.0, 1.0, 0.0, 0.0]), "unit quaternion"),
        (lambda w: w["velocity"].__setitem__((5, 0, 0), np.nan), "not finite"),
        (lambda w: w["t"].__setitem__(5, 0.0), "time does not rise"),
    ]:
        world = flights.truth()
        spoil(world)
        assert any(words in fault for fault in sanity(world))


def world(folder, **changes):
    """Change world.json; what is None there is left out."""
    path = folder / "world.json"
    told = json.loads(path.read_text()) | changes
    path.write_text(json.dumps({k: v for k, v in told.items() if v is not None}))


def cut(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
