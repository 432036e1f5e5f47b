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
from typing import Any

from mavlink_bridge.shared.settings import SettingsError
from mavlink_bridge.shared.stage_costs import Costs, medians

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
    return [medians(costs) for costs in found]


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
