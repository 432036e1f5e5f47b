"""The cost of a flight by stage: the same flight again and again, by one release or two in turn.

Two releases are compared in one run, flight by flight, for what else the machine does slows both.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

from mavlink_bridge.shared.settings import SettingsError

Costs = dict[str, dict[str, float]]
_FLOWN = (0, 1)  # exit statuses of `sitl-sim run` that come with metrics
_FACTOR = "real-time factor"


def measure(
    pythons: Sequence[str], scenario: str, changes: Sequence[str], seed: int, rounds: int
) -> list[Costs]:
    """Return the costs of each interpreter's release: p50 and p99 [ms] by stage, over the rounds.

    The real-time factor is among the stages, as p50.

    Raises:
        SettingsError: bad input, or a release that cannot fly this.
    """
    found: list[list[Costs]] = [[] for _ in pythons]
    for _ in range(rounds):
        for python, costs in zip(pythons, found, strict=True):
            costs.append(_costs(_flown(python, scenario, changes, seed)))
    return [_medians(costs) for costs in found]


def table(ours: Costs, theirs: Costs | None = None) -> str:
    """Return costs as a table in Markdown; theirs: of another release, with the ratios."""
    more = " other p50 | other p99 | ratio p50 | ratio p99 |" if theirs else ""
    rows = [f"| stage | p50 [ms] | p99 [ms] |{more}", "|---" * (7 if theirs else 3) + "|"]
    for stage, cost in ours.items():
        row = f"| {stage} | {cost['p50']:.2f} | {_number(cost, 'p99')} |"
        if theirs:
            other = theirs.get(stage, {})
            row += f" {_number(other, 'p50')} | {_number(other, 'p99')} |"
            row += f" {_ratio(cost, other, 'p50')} | {_ratio(cost, other, 'p99')} |"
        rows.append(row)
    return "\n".join(rows)


def _flown(python: str, scenario: str, changes: Sequence[str], seed: int) -> dict[str, Any]:
    """Fly once, companions in the process, and return the metrics."""
    with tempfile.TemporaryDirectory() as folder:
        command = [python, "-m", "sitl_sim", "run", scenario, "--in-process", "--json"]
        command += ["--seed", str(seed), "--out", str(Path(folder) / "flight")]
        for change in changes:
            command += ["--set", change]
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False)
        except OSError as error:
            raise SettingsError([f"--against {python}: {error.strerror}"]) from error
    if done.returncode not in _FLOWN or not done.stdout:
        whose = "" if python == sys.executable else f"{python} -m sitl_sim run {scenario}: "
        raise SettingsError([whose + done.stderr.strip()])
    metrics: dict[str, Any] = json.loads(done.stdout)
    return metrics


def _costs(metrics: dict[str, Any]) -> Costs:
    stages = {"tick": metrics["tick_ms"], **metrics["stage_ms"], "solve": metrics["solve_ms"]}
    costs = {
        name: {q: float(found[q]) for q in ("p50", "p99")}
        for name, found in stages.items()
        if found["p50"] is not None
    }
    return costs | {_FACTOR: {"p50": float(metrics["real_time_factor"])}}


def _medians(costs: list[Costs]) -> Costs:
    return {
        stage: {q: median(c[stage][q] for c in costs if stage in c) for q in quantiles}
        for stage, quantiles in costs[0].items()
    }


def _number(cost: dict[str, float], quantile: str) -> str:
    return f"{cost[quantile]:.2f}" if quantile in cost else "–"


def _ratio(ours: dict[str, float], theirs: dict[str, float], quantile: str) -> str:
    known = quantile in ours and theirs.get(quantile, 0.0) > 0.0
    return f"{ours[quantile] / theirs[quantile]:.2f}" if known else "–"
