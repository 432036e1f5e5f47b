"""How fast and how good: any set of instances through the real-time solver and IPOPT.

The file is one npz of arrays, so that anyone's instances can be measured; n instances, sizes
as in `Instance` (fewer neighbours, cylinders or planes than configured are padded):

    sequence (n,)             instances of one number follow each other at dt; the first of each
                              is solved cold, the rest warm
    x0 (n,10)                 p, v [m, m/s; world ENU], q_wb (w,x,y,z)
    u_last (n,4)              c [m/s²], body rates [rad/s; FLU], the last sent
    goal (n,3)  speed (n,)    [m], [m/s]
    yaw (n,)                  line of sight [rad; world ENU]
    neighbour_p, neighbour_v (n,J,3)   neighbour_sigma (n,J,2)
    neighbour_cohesion, neighbour_active (n,J)
    cylinders (n,K,3)  cylinder_active (n,K)      x, y, radius
    planes (n,H,4)     plane_active (n,H)         n, b; free where n·p <= b
    disturbance (n,3)         [m/s²]
    kind (n,)                 optional name of the situation, for the table
"""

from __future__ import annotations

import resource
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from companion.model import Vector
from companion.nmpc.config import NmpcConfig
from companion.nmpc.instance import Instance
from companion.nmpc.ipopt import IpoptNmpc
from companion.nmpc.result import Result
from companion.nmpc.rti import Nmpc

SOLVERS: dict[str, Callable[[NmpcConfig], Nmpc | IpoptNmpc]] = {
    "rti": Nmpc,
    "rti-vm": lambda config: Nmpc(config, compiled=False),
    "ipopt-sx": IpoptNmpc,
    "ipopt-mx": lambda config: IpoptNmpc(config, expand=False),
}
PADDED = {"neighbour": "neighbours", "cylinder": "cylinders", "plane": "planes"}


@dataclass(frozen=True)
class Run:
    """Instances that follow each other, and what kind of situation they are."""

    kind: str
    instances: tuple[Instance, ...]


def stored() -> Path:
    """The set that comes with the package: recorded in simulated flights."""
    return Path(str(resources.files("companion.nmpc").joinpath("instances.npz")))


def save(path: Path, sequences: Sequence[Run]) -> None:
    """Write a set of instances."""
    every = [i for s in sequences for i in s.instances]
    arrays: dict[str, Any] = {
        f.name: np.array([getattr(i, f.name) for i in every]) for f in fields(Instance)
    }
    counts = [len(s.instances) for s in sequences]
    arrays["sequence"] = np.repeat(np.arange(len(sequences)), counts)
    arrays["kind"] = np.repeat([s.kind for s in sequences], counts)
    np.savez_compressed(path, **arrays)


def load(path: Path, config: NmpcConfig) -> list[Run]:
    """Read a set of instances; ValueError names the array that is missing or does not fit."""
    with np.load(path, allow_pickle=False) as data:
        arrays = {name: data[name] for name in data.files}
    wanted = [f.name for f in fields(Instance)]
    missing = [name for name in ["sequence", *wanted] if name not in arrays]
    if missing:
        raise ValueError(f"{path}: no array {missing[0]!r}; needed: {', '.join(wanted)}")
    for name in wanted:
        arrays[name] = _fitted(path, name, np.asarray(arrays[name], dtype=float), config)
    kinds = arrays.get("kind", np.full(len(arrays["sequence"]), "all"))
    found = []
    for number in np.unique(arrays["sequence"]):
        rows = np.flatnonzero(arrays["sequence"] == number)
        instances = [_instance({n: arrays[n][r] for n in wanted}) for r in rows]
        found.append(Run(str(kinds[rows[0]]), tuple(instances)))
    return found


def _fitted(path: Path, name: str, array: Vector, config: NmpcConfig) -> Vector:
    """Pad or cut the second axis of what there may be many of."""
    key = next((k for prefix, k in PADDED.items() if name.startswith(prefix)), None)
    if key is None:
        return array
    count = int(getattr(config, key))
    if array.ndim < 2:
        raise ValueError(f"{path}: {name} has shape {array.shape}, wanted (n, {count}, …)")
    array = array[:, :count]
    short = [(0, 0), (0, count - array.shape[1])] + [(0, 0)] * (array.ndim - 2)
    return np.pad(array, short)


def _instance(row: dict[str, Vector]) -> Instance:
    numbers: dict[str, Any] = dict(row)
    for name in ("speed", "yaw"):
        numbers[name] = float(numbers[name])
    return Instance(**numbers)


def bench(
    sequences: Sequence[Run],
    config: NmpcConfig | None = None,
    *,
    solvers: Sequence[str] = tuple(SOLVERS),
    progress: Callable[[str, int], None] = lambda solver, done: None,
) -> dict[str, Any]:
    """Measure `solvers` on `sequences`; one thread, one after the other.

    Times are of the whole call from Python, in ms. `worse_percent` is by how much a plan costs
    more than what IPOPT makes of it (0.001 is added to the costs: at a hover both are zero).
    `ratio` is p99 over that of the first solver.
    """
    config = config or NmpcConfig()
    optimum = IpoptNmpc(config)
    rows: dict[str, Any] = {}
    for name in solvers:
        rows[name] = _measure(name, SOLVERS[name](config), sequences, optimum, progress)
    first = rows[solvers[0]]["warm_ms"]["p99"]
    for row in rows.values():
        row["ratio_p99"] = row["warm_ms"]["p99"] / first
    return {"instances": sum(len(s.instances) for s in sequences), "solvers": rows}


def _measure(
    name: str,
    solver: Nmpc | IpoptNmpc,
    sequences: Sequence[Run],
    optimum: IpoptNmpc,
    progress: Callable[[str, int], None],
) -> dict[str, Any]:
    warm: list[float] = []
    cold: list[float] = []
    worse: list[float] = []
    kinds: list[str] = []
    usable = finite = total = 0
    intrusion = 0.0
    for sequence in sequences:
        solver.reset()
        for n, instance in enumerate(sequence.instances):
            result = solver.solve(instance)
            (warm if n else cold).append(result.solve_time * 1e3)
            total += 1
            usable += result.usable
            finite += bool(np.isfinite(result.x).all() and np.isfinite(result.u).all())
            intrusion = max(intrusion, result.slack_agent, result.slack_obstacle)
            if n and name.startswith("rti") and result.usable:
                worse.append(_worse(optimum, instance, result))
                kinds.append(sequence.kind)
            progress(name, total)
    row: dict[str, Any] = {
        "backend": getattr(solver, "backend", "ipopt"),
        "warm_ms": _percentiles(warm),
        "cold_ms": _percentiles(cold),
        "usable": usable / max(1, total),
        "finite": finite / max(1, total),
        "deepest_intrusion_m": intrusion,
        "peak_memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    if worse:
        row["worse_percent"] = _percentiles(worse)
        row["worse_percent_by_kind"] = {
            kind: _percentiles([w for w, k in zip(worse, kinds, strict=True) if k == kind])
            for kind in sorted(set(kinds))
        }
    return row


def _worse(optimum: IpoptNmpc, instance: Instance, result: Result) -> float:
    optimum.guess((result.x, result.u))
    best = optimum.solve(instance)
    if not best.usable:
        return 0.0
    return max(0.0, 100.0 * (result.cost - best.cost) / (best.cost + 1e-3))


def _percentiles(values: Sequence[float]) -> dict[str, float]:
    if not values:
        return {"p50": 0.0, "p95": 0.0, "p99": 0.0, "max": 0.0}
    p50, p95, p99 = (float(v) for v in np.percentile(values, [50, 95, 99]))
    return {"p50": p50, "p95": p95, "p99": p99, "max": float(max(values))}


def table(report: dict[str, Any]) -> str:
    """The report as a table for people."""
    lines = [
        f"{report['instances']} instances; ms of the whole call, warm (cold: first of a sequence)",
        f"{'solver':<10}{'p50':>8}{'p95':>8}{'p99':>8}{'max':>8}{'cold p50':>10}{'usable':>8}"
        f"{'p99 ratio':>11}{'worse % p50/p99/max':>24}{'MB':>6}",
    ]
    for name, row in report["solvers"].items():
        w, c = row["warm_ms"], row["cold_ms"]
        gap = row.get("worse_percent")
        worse = f"{gap['p50']:.3f} / {gap['p99']:.2f} / {gap['max']:.2f}" if gap else "-"
        lines.append(
            f"{name:<10}{w['p50']:8.2f}{w['p95']:8.2f}{w['p99']:8.2f}{w['max']:8.2f}"
            f"{c['p50']:10.2f}{row['usable']:8.3f}{row['ratio_p99']:11.1f}{worse:>24}"
            f"{row['peak_memory_mb']:6.0f}"
        )
    return "\n".join(lines)
