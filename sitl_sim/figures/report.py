"""report.html: one flight on one self-contained page, its verdict recomputed from the truth."""

from __future__ import annotations

import html
import signal
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from sitl_sim.figures import belief_figures
from sitl_sim.figures import curves as figures
from sitl_sim.figures.belief import Beliefs
from sitl_sim.figures.collision import collision
from sitl_sim.figures.events import Collision, Event, collisions, events
from sitl_sim.figures.metrics import safety, sanity, timing
from sitl_sim.figures.page import draw, page
from sitl_sim.figures.perception import FrameScore, perception, score_frames
from sitl_sim.recording.run_folder import Run

_COLLISIONS = 8
# Ended from outside: at the end of a flight, or by a test of a lost companion.
_ENDED = {0, -signal.SIGTERM, -signal.SIGINT, -signal.SIGKILL}
_LEFT_OUT = ("per_drone", "stage_ms", "perception")


def summarise(
    run: Run,
    scores: dict[str, list[FrameScore]],
    exits: Mapping[str, int | None],
    interrupted: bool = False,
) -> dict[str, Any]:
    """Return the figures of `metrics.json` that truth and logs give, and the verdict.

    exits: how each companion ended, as `Flight.exit_codes` returns it. interrupted: the flight
    was stopped before its end.
    """
    summary = safety(run.truth, run.world, run.names) | timing(run.logs)
    summary["interrupted"] = interrupted
    summary["perception"] = perception(scores)
    summary["faults_in_truth"] = sanity(run.truth)
    summary["companion_errors"] = {
        n: code for n, code in exits.items() if code is not None and code not in _ENDED
    }
    summary["ok"] = bool(
        summary["mission_complete"]
        and not interrupted
        and not summary["agent_collisions"]
        and not summary["obstacle_collisions"]
        and not summary["ground_strikes"]
        and not summary["never_flew"]
        and not summary["companion_errors"]
        and not summary["faults_in_truth"]
    )
    return summary


def make_report(run: Run) -> Path:
    """Write `report.html` into the run folder; all figures are computed again."""
    scores = score_frames(run.scenario, run.world, run.truth, run.logs)
    each = run.metrics.get("per_drone", {})
    exits = {n: each.get(n, {}).get("companion_exit") for n in run.names}
    interrupted = bool(run.metrics.get("interrupted", False))
    return write_report(run, run.metrics | summarise(run, scores, exits, interrupted), scores)


def write_report(run: Run, summary: dict[str, Any], scores: dict[str, list[FrameScore]]) -> Path:
    """Write `report.html` from figures that are computed already."""
    s = run.scenario
    title = f"{s.name}, seed {s.seed}, {s.drones.count} drones"
    path = run.folder / "report.html"
    text = page(title, _verdict(summary), _sections(run, summary, scores))
    path.write_text(text, encoding="utf-8")
    return path


def _sections(
    run: Run, summary: dict[str, Any], scores: dict[str, list[FrameScore]]
) -> Iterator[tuple[str, str]]:
    """Yield heading and content of each part of the page."""
    beliefs, happened = Beliefs(run), events(run)
    yield "Summary", _table(summary)
    yield "From above", draw(figures.top_view(run))
    if crashes := collisions(run):
        yield "Ten seconds before each collision", _collisions(run, beliefs, crashes)
    yield "Trajectories", draw(figures.trajectories(run))
    yield "Distances and speed, mean ± std and least", draw(figures.curves(run))
    if times := belief_figures.chosen_times(run):
        yield "Network of critical neighbours", draw(belief_figures.network(run, beliefs, times))
        yield "Predicted trajectories", draw(belief_figures.plans(run, beliefs, times))
    yield "Solve and tick times", draw(belief_figures.times(run))
    if any(scores.values()):
        yield "Perception against truth", draw(belief_figures.perception(scores))
    yield "Events", draw(belief_figures.timeline(run, happened)) + _list(happened)


def _collisions(run: Run, beliefs: Beliefs, crashes: list[Collision]) -> str:
    """Draw the first collisions; the list of events has them all."""
    parts = []
    for crash in crashes[:_COLLISIONS]:
        other = "an obstacle" if crash.other is None else run.names[crash.other]
        title = f"{run.names[crash.drone]} with {other}, {crash.time:.1f} s, {crash.distance:.2f} m"
        parts.append(f"<h3>{html.escape(title)}</h3>{draw(collision(run, beliefs, crash))}")
    return "".join(parts)


def _verdict(summary: dict[str, Any]) -> str:
    if summary["ok"]:
        return "<p class=good><b>OK</b>: all targets reached, nothing touched."
    return "<p class=bad><b>FALLS SHORT</b>: " + html.escape("; ".join(shortcomings(summary)))


def shortcomings(s: dict[str, Any]) -> Iterator[str]:
    """Yield the reasons why a flight with these metrics fell short."""
    if s.get("interrupted"):
        yield "interrupted"
    if not s["mission_complete"]:
        late = [n for n, r in s["targets_reached"].items() if len(set(r.split("/"))) > 1]
        yield "targets missed by " + ", ".join(late)
    if s["agent_collisions"]:
        yield f"{s['agent_collisions']} pair(s) of drones collided"
    if s["obstacle_collisions"]:
        yield f"{s['obstacle_collisions']} drone(s) hit an obstacle"
    if s.get("ground_strikes"):
        yield f"{s['ground_strikes']} drone(s) struck the ground"
    if s["never_flew"]:
        yield "never flew: " + ", ".join(s["never_flew"])
    for name, code in s.get("companion_errors", {}).items():
        yield f"{name}'s companion ended with an error, exit {code}"
    yield from s["faults_in_truth"]


def _table(summary: dict[str, Any]) -> str:
    flat = {k: v for k, v in summary.items() if k not in _LEFT_OUT}
    flat |= {f"perception: {k}": v for k, v in summary["perception"].items()}
    rows = (f"<tr><td>{html.escape(k)}<td>{html.escape(_text(v))}" for k, v in flat.items())
    return f"<table>{''.join(rows)}</table>"


def _list(happened: list[Event]) -> str:
    rows = (
        f"<tr><td>{e.time:.1f} s<td>{html.escape(e.drone)}<td>{html.escape(e.text)}"
        for e in happened
    )
    table = f"<table>{''.join(rows)}</table>"
    return f"<details><summary>{len(happened)} events</summary>{table}</details>"


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3f}"
    if isinstance(value, dict):
        return ", ".join(f"{k} {_text(v)}" for k, v in value.items())
    if isinstance(value, list):
        return ", ".join(map(_text, value)) or "–"
    return "–" if value is None else str(value)
