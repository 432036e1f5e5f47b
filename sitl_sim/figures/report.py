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
from sitl_sim.figures.events import Collision, collisions, events
from sitl_sim.figures.metrics import certificates, safety, sanity, timing
from sitl_sim.figures.page import PLOTLY, draw, page
from sitl_sim.figures.panel import panel
from sitl_sim.figures.perception import FrameScore, perception, score_frames
from sitl_sim.figures.verdict import head
from sitl_sim.recording.run_folder import Run, ours

_COLLISIONS = 8
# Ended from outside: at the end of a flight, or by a test of a lost companion.
_ENDED = {0, -signal.SIGTERM, -signal.SIGINT, -signal.SIGKILL}
_LEFT_OUT = ("per_drone", "stage_ms", "perception")
_NETWORK = (
    "<p class=hint>An arrow leads from a drone to where it believes a critical neighbour is; the "
    "wider, the greater the threat. Brown: obstacles."
)
_PLANS = "<p class=hint>Lines: what each companion planned at that time, in its drone's colour."


def summarise(
    run: Run,
    scores: dict[str, list[FrameScore]],
    exits: Mapping[str, int | None],
    interrupted: bool = False,
) -> dict[str, Any]:
    """Return the figures of `metrics.json` that truth and logs give, and the verdict.

    exits: how each companion ended, as `Flight.exit_codes` returns it. interrupted: the flight
    was stopped before its end. Only our companions' logs count.
    """
    own = {n for n, o in zip(run.names, ours(run.world, run.names), strict=True) if o}
    logs = {n: log for n, log in run.logs.items() if n in own}
    summary = safety(run.truth, run.world, run.names) | timing(logs) | certificates(logs)
    summary["interrupted"] = interrupted
    summary["perception"] = perception({n: s for n, s in scores.items() if n in own})
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


def write_report(
    run: Run,
    summary: dict[str, Any],
    scores: dict[str, list[FrameScore]],
    of_campaign: bool = False,
) -> Path:
    """Write `report.html` from figures that are computed already.

    of_campaign: a page of 0.3 MB, without pictures; plotly's script is in the folder above.
    """
    s = run.scenario
    title = f"{s.name}, seed {s.seed}, {s.drones.count} drones"
    path = run.folder / "report.html"
    sections = _sections(run, summary, scores, not of_campaign)
    shared = f"../{PLOTLY}" if of_campaign else None
    text = page(title, head(summary, run.world["drone_radius"]), sections, shared)
    path.write_text(text, encoding="utf-8")
    return path


def _sections(
    run: Run, summary: dict[str, Any], scores: dict[str, list[FrameScore]], with_pictures: bool
) -> Iterator[tuple[str, str]]:
    """Yield heading and content of each part of the page."""
    beliefs, happened = Beliefs(run), events(run)
    yield "Flight", panel(run, beliefs, happened, with_pictures)
    if crashes := collisions(run):
        yield "Ten seconds before each collision", _collisions(run, beliefs, crashes)
    yield "Trajectories", draw(figures.trajectories(run))
    if times := belief_figures.chosen_times(run):
        yield (
            "Network of critical neighbours",
            draw(belief_figures.network(run, beliefs, times)) + _NETWORK,
        )
        yield "Predicted trajectories", draw(belief_figures.plans(run, beliefs, times)) + _PLANS
    if any(scores.values()):
        yield "Perception against truth", draw(belief_figures.perception(scores))
    yield "Solve and tick times", draw(belief_figures.times(run))
    yield (
        "All figures",
        f"<details><summary>keys of metrics.json</summary>{_table(summary)}</details>",
    )


def _collisions(run: Run, beliefs: Beliefs, crashes: list[Collision]) -> str:
    """Draw the first collisions; the list of events has them all."""
    parts = []
    for crash in crashes[:_COLLISIONS]:
        other = "an obstacle" if crash.other is None else run.names[crash.other]
        title = f"{run.names[crash.drone]} with {other}, {crash.time:.1f} s, {crash.distance:.2f} m"
        parts.append(f"<h3>{html.escape(title)}</h3>{draw(collision(run, beliefs, crash))}")
    return "".join(parts)


def _table(summary: dict[str, Any]) -> str:
    flat = {k: v for k, v in summary.items() if k not in _LEFT_OUT}
    flat |= {f"perception: {k}": v for k, v in summary["perception"].items()}
    rows = (f"<tr><td>{html.escape(k)}<td>{html.escape(_text(v))}" for k, v in flat.items())
    return f"<table>{''.join(rows)}</table>"


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3f}"
    if isinstance(value, dict):
        return ", ".join(f"{k} {_text(v)}" for k, v in value.items())
    if isinstance(value, list):
        return ", ".join(map(_text, value)) or "–"
    return "–" if value is None else str(value)
