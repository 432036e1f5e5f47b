"""Speed and quality of the real-time solver and IPOPT on any set of instances.

Times are of the whole call from Python, on one thread, one solver after the other on the same
instances. `worse_percent` is how much more a plan costs than the optimum that IPOPT finds from it;
0.001 is added to the costs, as both are zero at a hover.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from companion.control.nmpc.config import NmpcConfig
from companion.control.nmpc.instance import Instance
from companion.control.nmpc.instance_file import Run
from companion.control.nmpc.ipopt import IpoptNmpc
from companion.control.nmpc.rti import Nmpc
from companion.types import Plan

Clock = Callable[[], float]
Solver = Nmpc | IpoptNmpc

SOLVERS: dict[str, Callable[[NmpcConfig, Clock], Solver]] = {
    "rti": Nmpc,
    "rti-vm": lambda config, clock: Nmpc(config, clock, compiled=False),
    "ipopt-sx": IpoptNmpc,
    "ipopt-mx": lambda config, clock: IpoptNmpc(config, clock, expand=False),
}
PERCENTILES = {"p50": 50.0, "p95": 95.0, "p99": 99.0, "max": 100.0}


@dataclass
class _Tally:
    """Counts of a solver on a set.

    warm, cold: ms. worse: %, by flight. within: plans within bounds. slack: m, the deepest.
    """

    warm: list[float] = field(default_factory=list)
    cold: list[float] = field(default_factory=list)
    worse: dict[str, list[float]] = field(default_factory=dict)
    total: int = 0
    usable: int = 0
    within: int = 0
    slack: float = 0.0

    def add(self, config: NmpcConfig, instance: Instance, result: Plan) -> None:
        """Count a result, without its time."""
        self.total += 1
        self.usable += result.usable
        self.within += result.usable and within_bounds(config, instance, result)
        slacks = (result.slack_agent, result.slack_obstacle, result.slack_plane)
        self.slack = max(self.slack, *slacks)


def bench(
    runs: Sequence[Run],
    config: NmpcConfig | None = None,
    *,
    solvers: Sequence[str] = tuple(SOLVERS),
    ticks: int = 0,
    clock: Clock = time.perf_counter,
    progress: Callable[[str, int], None] = lambda solver, done: None,
) -> dict[str, Any]:
    """Return the figures of `solvers` on `runs`, a dictionary of plain numbers.

    ticks: the real-time solvers repeat the set until they have solved this many warm instances.
    `ratio_p99` is a solver's p99 over that of the first solver.
    """
    config = config or NmpcConfig()
    optimum = IpoptNmpc(config)
    rows: dict[str, Any] = {}
    for name in solvers:
        before = _resident()
        solver = SOLVERS[name](config, clock)
        row = _measure(name, solver, runs, optimum, progress)
        row["memory_mb"] = _resident() - before
        if isinstance(solver, Nmpc) and ticks:
            row["endurance"] = _endure(solver, runs, ticks)
        rows[name] = row
    first = rows[solvers[0]]["warm_ms"]["p99"]
    for row in rows.values():
        row["ratio_p99"] = row["warm_ms"]["p99"] / first if first else 0.0
    return {"instances": sum(len(r.instances) for r in runs), "solvers": rows}


def _measure(
    name: str,
    solver: Solver,
    runs: Sequence[Run],
    optimum: IpoptNmpc,
    progress: Callable[[str, int], None],
) -> dict[str, Any]:
    tally = _Tally()
    compared: list[tuple[str, Instance, Plan]] = []
    for run, instance, result, first in solve_all(solver, runs):
        (tally.cold if first else tally.warm).append(result.solve_time * 1e3)
        tally.add(solver.config, instance, result)
        if isinstance(solver, Nmpc) and not first and result.usable:
            compared.append((run.flight, instance, result))
        progress(name, tally.total)
    for flight, instance, result in compared:  # last, as IPOPT empties the processor's caches
        gap = worse_percent(optimum, instance, result)
        tally.worse.setdefault(flight, []).append(gap)
    total = max(1, tally.total)
    row: dict[str, Any] = {
        "backend": solver.backend if isinstance(solver, Nmpc) else "ipopt",
        "warm_ms": percentiles(tally.warm),
        "cold_ms": percentiles(tally.cold),
        "success": tally.usable / total,
        "within_bounds": tally.within / total,
        "deepest_intrusion_m": tally.slack,
    }
    if tally.worse:
        row["worse_percent"] = percentiles([w for each in tally.worse.values() for w in each])
        row["worse_percent_by_flight"] = {k: percentiles(w) for k, w in tally.worse.items()}
    return row


def solve_all(solver: Solver, runs: Sequence[Run]) -> Iterator[tuple[Run, Instance, Plan, bool]]:
    """Yield every instance's plan in order; the flag marks the first of a run, solved cold."""
    for run in runs:
        solver.reset()
        for number, instance in enumerate(run.instances):
            yield run, instance, solver.solve(instance), number == 0


def _endure(solver: Nmpc, runs: Sequence[Run], ticks: int) -> dict[str, Any]:
    """Return the milliseconds of `ticks` warm solves, and the growth of memory [MB]."""
    times: list[float] = []
    before = 0.0
    while len(times) < ticks and any(len(run.instances) > 1 for run in runs):
        times += [r.solve_time * 1e3 for _, _, r, first in solve_all(solver, runs) if not first]
        before = before or _resident()  # after the first round all memory is touched
    growth = _resident() - before
    return {"ticks": min(ticks, len(times)), "growth_mb": growth, **percentiles(times[:ticks])}


def within_bounds(config: NmpcConfig, instance: Instance, result: Plan) -> bool:
    """Return whether the plan is finite and keeps (33)-(36) exactly."""
    x, u = result.x, result.u
    if not (np.isfinite(x).all() and np.isfinite(u).all()):
        return False
    low = np.array([config.c_min, *[-config.omega_max] * 3])
    high = np.array([config.c_max, *[config.omega_max] * 3])
    change = np.array([config.delta_c_max, *[config.delta_omega_max] * 3])
    before = np.concatenate([np.clip(instance.u_last, low, high)[None], u[:-1]])
    return bool(((u >= low) & (u <= high) & (np.abs(u - before) <= change)).all())


def worse_percent(optimum: IpoptNmpc, instance: Instance, result: Plan) -> float:
    """Return how much more [%] a plan costs than the optimum that IPOPT finds from it."""
    optimum.guess((result.x, result.u))
    best = optimum.solve(instance)
    if not best.usable:
        return 0.0
    return max(0.0, 100.0 * (result.cost - best.cost) / (best.cost + 1e-3))


def percentiles(values: Sequence[float]) -> dict[str, float]:
    """Return p50, p95, p99 and max; zeros without values."""
    if not values:
        return dict.fromkeys(PERCENTILES, 0.0)
    found = np.percentile(values, list(PERCENTILES.values()))
    return dict(zip(PERCENTILES, map(float, found), strict=True))


def _resident() -> float:
    """Return the resident memory [MB] of this process; 0 where the system does not tell."""
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return next((float(line.split()[1]) / 1024 for line in lines if line.startswith("VmRSS")), 0.0)
