"""After a flight: truth, metrics and report into the run folder, and a table to print."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from sitl_sim.metrics import read_log, safety, timing
from sitl_sim.report import write_report
from sitl_sim.runner import Flight


def finish(flight: Flight, setup_seconds: float) -> dict[str, Any]:
    """Write truth.npz, metrics.json and report.html; gives the metrics."""
    folder = flight.folder
    sha = flight.truth.write(folder / "truth.npz")
    truth = flight.truth.arrays()
    logs = {n: read_log(folder / "drones" / n / "flight.mcap") for n in flight.names}
    metrics = safety(truth, flight.world, flight.names) | timing(logs)
    metrics["real_time_factor"] = metrics["duration_s"] / max(flight.wall_seconds, 1e-9)
    metrics["wall_s"] = {"setup": setup_seconds, "flight": flight.wall_seconds}
    metrics["truth_sha256"] = sha
    metrics["scenario"] = flight.scenario.name
    metrics["seed"] = flight.scenario.seed
    codes = flight.exit_codes()
    metrics["per_drone"] = {
        n: {"targets": metrics["targets_reached"][n], "companion_exit": codes[n],
            **timing({n: logs[n]})}
        for n in flight.names
    }  # fmt: skip
    metrics["ok"] = bool(
        metrics["mission_complete"]
        and not metrics["agent_collisions"]
        and not metrics["obstacle_collisions"]
        and not metrics["never_flew"]
    )
    (folder / "metrics.json").write_text(json.dumps(metrics, indent=1), encoding="utf-8")
    write_report(folder, truth, flight.world, metrics)
    return metrics


def table(m: dict[str, Any], folder: Path) -> str:
    """The flight in a few lines."""
    done = sum(a.split("/")[0] == a.split("/")[1] for a in m["targets_reached"].values())

    def ms(q: dict[str, float | None]) -> str:
        return " / ".join("–" if q[k] is None else f"{q[k]:.1f}" for k in ("p50", "p99", "max"))

    agent = m["min_agent_distance_m"]
    rows = [
        ("scenario, seed, drones", f"{m['scenario']}, {m['seed']}, {m['drones']}"),
        ("all targets reached by", f"{done} of {m['drones']}"),
        ("collisions, drones / obstacles", f"{m['agent_collisions']} / {m['obstacle_collisions']}"),
        ("least distance between drones", "–" if agent is None else f"{agent:.2f} m"),
        ("least distance to an obstacle", f"{m['min_obstacle_distance_m']:.2f} m"),
        ("speed while moving", f"{m['mean_speed_m_s']:.2f} ± {m['std_speed_m_s']:.2f} m/s"),
        ("order / union / connectivity",
         " / ".join("–" if m[k] is None else f"{m[k]:.2f}"
                    for k in ("order", "union", "connectivity"))),
        ("solve, p50 / p99 / max", f"{ms(m['solve_ms'])} ms"),
        ("tick, p50 / p99 / max", f"{ms(m['tick_ms'])} ms"),
        ("deadline misses", f"{m['deadline_misses']} ({m['deadline_miss_rate']:.2%})"),
        ("flown", f"{m['duration_s']:.1f} s"),
        ("real-time factor", f"{m['real_time_factor']:.2f}"),
        ("truth", m["truth_sha256"][:16]),
        ("run folder", str(folder)),
        ("verdict", "OK" if m["ok"] else "FALLS SHORT"),
    ]  # fmt: skip
    width = max(len(k) for k, _ in rows)
    return "\n".join(f"{k:<{width}}  {v}" for k, v in rows)
