"""The report's page: complete, self-contained, its verdict from the truth."""

import dataclasses
import json
import re

import numpy as np
import pytest

from sitl_sim.__main__ import main
from sitl_sim.figures.events import collisions, events
from sitl_sim.figures.perception import score_frames
from sitl_sim.figures.report import summarise, write_report
from sitl_sim.figures.verdict import shortcomings
from sitl_sim.recording.run_folder import load_run, log_path, salvage_ticks
from tests.sitl_sim import flights


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return flights.write_run(tmp_path_factory.mktemp("run"))


def test_the_page_is_complete_and_agrees_with_the_truth(folder, capsys):
    assert main(["report", str(folder)]) == 0
    assert capsys.readouterr().out.strip() == str(folder / "report.html")
    page = (folder / "report.html").read_text()
    assert page.count("Plotly.newPlot(") == 8
    assert "<b>OK</b>" in page
    body = page[page.index("<body>") :]
    assert body.index("reached all targets") < body.index('id="map"') < body.index("min_agent_")
    assert not re.search(r'<(script|link|img)[^>]+(src|href)="?http', page)
    for heading in (
        "All 3 drones reached all targets in ",
        "Cameras",
        "Trajectories",
        "mean over the swarm",
        "Network of critical neighbours",
        "Predicted trajectories",
        "Solve and tick times",
        "Perception against truth",
        "Events",
    ):
        assert heading in page
    assert (folder / "report.html").stat().st_size < 15e6


def test_a_collision_is_shown_with_the_seconds_before_it(tmp_path):
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
    assert "FALLS SHORT</b> <span>interrupted" in (folder / "report.html").read_text()


def test_the_verdict_does_not_depend_on_metrics_json(tmp_path):
    folder = flights.write_run(tmp_path / "crash", gap=0.15)
    (folder / "metrics.json").write_text(json.dumps({"ok": True, "agent_collisions": 0}))
    main(["report", str(folder)])
    assert "FALLS SHORT" in (folder / "report.html").read_text()


def test_the_log_of_a_killed_companion_counts(tmp_path):
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


def test_map_cameras_curves_and_events_are_on_one_cursor(folder, browser):
    assert main(["report", str(folder)]) == 0
    run, tab = load_run(folder), browser.new_page(viewport={"width": 1200, "height": 900})
    tab.set_default_timeout(120_000)
    errors = []
    tab.on("pageerror", lambda e: errors.append(str(e)))
    tab.goto(f"{(folder / 'report.html').as_uri()}#t=8.0")  # a link carries its time
    assert tab.inner_text("#shown") == "8.0 s"
    there = run.truth["position"][np.searchsorted(run.truth["t"], 8.0 - 1e-9), :, :2]
    np.testing.assert_allclose(_drawn(tab), there, atol=0.02)
    pictures = _pictures(tab)
    assert all(p.startswith("data:image/jpeg;base64,") for p in pictures)
    tab.press("body", "ArrowLeft")
    assert tab.inner_text("#shown") == "7.8 s"
    assert tab.url.endswith("#t=7.8")
    tab.evaluate("document.getElementById('curves').scrollIntoView()")
    x, y = _at_time(tab, 4.0)
    tab.mouse.click(x, y)
    assert float(tab.inner_text("#shown").split()[0]) == pytest.approx(4.0, abs=0.1)
    assert _pictures(tab) != pictures
    tab.evaluate("document.querySelector('#events tr:last-child a').click()")
    last = events(run)[-1]
    assert float(tab.inner_text("#shown").split()[0]) == pytest.approx(last.time, abs=0.06)
    assert not errors


def _drawn(tab):
    """Places (N,2) m of the drones on the map."""
    trace = "document.getElementById('map').data.find((trace) => trace.name === 'now')"
    return np.array([tab.evaluate(f"[...{trace}.{axis}]") for axis in "xy"]).T


def _pictures(tab):
    return tab.eval_on_selector_all("#cameras img", "images => images.map((i) => i.src)")


def _at_time(tab, time):
    """Pixel of the page in the curves at a time [s]."""
    return tab.evaluate(
        "(t) => { const c = document.getElementById('curves'), a = c._fullLayout.xaxis; "
        "const b = c.getBoundingClientRect(); "
        "return [b.left + a._offset + a.l2p(t), b.top + 120]; }",
        time,
    )


def test_a_flight_of_a_campaign_has_a_small_page(tmp_path):
    run = load_run(flights.write_run(tmp_path / "crash", gap=0.15))
    path = write_report(run, run.metrics | summarise(run, {}, {}), {}, of_campaign=True)
    assert path.stat().st_size < 1e6
    assert "src='../plotly.min.js'" in path.read_text()
