"""After a flight: truth, metrics and report into the run folder, and a table to print."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Protocol

from sitl_sim.figures.metrics import certificates, timing
from sitl_sim.figures.perception import perception, score_frames
from sitl_sim.figures.report import summarise, write_report
from sitl_sim.figures.verdict import shortcomings
from sitl_sim.recording.code_version import commit
from sitl_sim.recording.run_folder import Run, log_path, salvage_ticks
from sitl_sim.recording.truth import Truth
from sitl_sim.scenarios.scenario import Scenario, companion_names


class Flown(Protocol):
    """What is over: a flight, or what a window has shown."""

    folder: Path
    names: list[str]
    scenario: Scenario
    world: dict[str, Any]
    truth: Truth
    wall_seconds: float

    @property
    def simulated_seconds(self) -> float:
        """How long it took by the vehicles' clocks [s]."""

    def exit_codes(self) -> dict[str, int | None]:
        """Return how each companion ended, by drone name."""


def finish(
    flight: Flown,
    setup_seconds: float,
    interrupted: bool = False,
    of_campaign: bool = False,
) -> dict[str, Any]:
    """Write truth.npz, metrics.json and report.html; return the metrics.

    of_campaign: the page is small, and shares plotly's script with the campaign's other pages.
    interrupted: the flight was stopped before its end, so it is never OK.
    """
    folder = flight.folder
    sha = flight.truth.write(folder / "truth.npz")
    logs = {n: salvage_ticks(log_path(folder, n)) for n in flight.names}
    run = Run(folder, flight.scenario, flight.world, flight.truth.arrays(), logs)
    scores = score_frames(run.scenario, run.world, run.truth, logs)
    codes = flight.exit_codes()
    metrics = summarise(run, scores, codes, interrupted)
    metrics["real_time_factor"] = flight.simulated_seconds / max(flight.wall_seconds, 1e-9)
    metrics["wall_s"] = {"setup": setup_seconds, "flight": flight.wall_seconds}
    metrics["truth_sha256"] = sha
    metrics["scenario"] = flight.scenario.name
    metrics["seed"] = flight.scenario.seed
    metrics["commit"] = commit()
    metrics["controller"] = flight.scenario.companion.get("controller", "nmpc")
    metrics["per_drone"] = {
        n: {
            "targets": metrics["targets_reached"].get(n),
            "companion_exit": codes[n],
            **timing({n: logs[n]}),
            **certificates({n: logs[n]}),
            "perception": perception({n: scores[n]}),
        }
        for n in companion_names(flight.scenario)
    }
    (folder / "metrics.json").write_text(json.dumps(metrics, indent=1), encoding="utf-8")
    write_report(run, metrics, scores, of_campaign)
    return metrics


def table(m: dict[str, Any], folder: Path) -> str:
    """Return the metrics of a flight as a few lines of text."""
    complete = sum(a.split("/")[0] == a.split("/")[1] for a in m["targets_reached"].values())
    collisions = f"{m['agent_collisions']} / {m['obstacle_collisions']}"
    flocking = (m[k] for k in ("order", "union", "connectivity"))
    detection = (m["perception"][k] for k in ("recall", "precision"))
    rows = [
        ("scenario, seed, drones", f"{m['scenario']}, {m['seed']}, {m['drones']}"),
        ("all targets reached by", f"{complete} of {len(m['targets_reached'])}"),
        *([("foreign drones", ", ".join(m["foreign"]))] if m.get("foreign") else []),
        ("collisions, drones / obstacles", collisions),
        ("ground strikes", str(m["ground_strikes"])),
        ("least distance between drones", _metres(m["min_agent_distance_m"])),
        ("least distance to an obstacle", _metres(m["min_obstacle_distance_m"])),
        ("speed while moving", f"{m['mean_speed_m_s']:.2f} ± {m['std_speed_m_s']:.2f} m/s"),
        ("order / union / connectivity", " / ".join(_number(v, 2) for v in flocking)),
        ("recall / precision to 8 m", " / ".join(_number(v, 3) for v in detection)),
        ("certified ticks, plans refused", _certified(m)),
        ("solve, p50 / p99 / max", _milliseconds(m["solve_ms"])),
        ("tick, p50 / p99 / max", _milliseconds(m["tick_ms"])),
        ("deadline misses", f"{m['deadline_misses']} ({m['deadline_miss_rate']:.2%})"),
        ("flown", f"{m['duration_s']:.1f} s"),
        ("real-time factor", f"{m['real_time_factor']:.2f}"),
        ("truth", m["truth_sha256"][:16]),
        ("run folder", str(folder)),
        ("verdict", "OK" if m["ok"] else "FALLS SHORT: " + "; ".join(shortcomings(m))),
    ]
    width = max(len(k) for k, _ in rows)
    return "\n".join(f"{k:<{width}}  {v}" for k, v in rows)


def _certified(m: dict[str, Any]) -> str:
    refused = sum(m["plans_refused"].values())
    share = m["certified_share"]
    return "–" if share is None else f"{share:.2%}, {refused}"


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _metres(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f} m"


def _milliseconds(quantiles: dict[str, float | None]) -> str:
    return " / ".join(_number(quantiles[k], 1) for k in ("p50", "p99", "max")) + " ms"
