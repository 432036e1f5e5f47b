"""The solver's time by sizes, and the value of the second horizon: tables for the docs.

    python -m tests.benchmarks.nmpc_study dual|horizon|neighbours|obstacles|norms|crossing

Each prints one table. Scenes are drawn from a seed: a swarm among trunks, flown for a few ticks by
the plan itself, so that all but the first solve are warm. Times are of the thread, so that other
processes count little. `crossing` flies ten drones across each other (`plant.py`) and takes
minutes.
"""

from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Iterator

import numpy as np

from companion.bench.solver import percentiles, solve_all, worse_percent
from companion.control.nmpc import Instance, Neighbour, Nmpc, NmpcConfig, make_instance
from companion.control.nmpc.instance_file import Run
from companion.control.nmpc.ipopt import IpoptNmpc
from companion.model import HOVER

SCENES, TICKS = 6, 4
STUDIES = {
    "dual": ("M", [{"M": m} for m in (5, 10, 20)]),
    "horizon": ("N", [{"N": n, "M_constraint": min(15, n)} for n in (10, 20, 40)]),
    "neighbours": ("neighbours", [{"neighbours": n} for n in (3, 6, 9)]),
    "obstacles": ("cylinders", [{"cylinders": n} for n in (4, 8, 16)]),
    "norms": ("factor", [{"factor": f} for f in (0.01, 0.1, 1.0)]),
}
NORMS = ("eps_cohesion", "eps_mig", "eps_c", "eps_yaw", "eps_omega")


def configured(factor: float = 1.0, **sizes: int) -> NmpcConfig:
    """Return the defaults with other sizes, and `factor` on the smoothing of every norm."""
    given = NmpcConfig()
    return NmpcConfig(**sizes, **{name: factor * getattr(given, name) for name in NORMS})


def swarm(config: NmpcConfig, seed: int) -> Instance:
    """Return a drone at cruise among as many neighbours and trunks as the config takes."""
    rng = np.random.default_rng(seed)
    v = np.array([1.4, 0.0, 0.0]) + rng.normal(0, 0.1, 3) * [1, 1, 0.2]
    bearing = rng.uniform(-np.pi, np.pi, 16)
    away = rng.uniform(1.2, 5.0, 16)
    neighbours = [
        Neighbour(
            (r * np.cos(b), r * np.sin(b), 2 + rng.normal(0, 0.1)),
            v + rng.normal(0, 0.3, 3) * [1, 1, 0],
            (0.1, 0.1),
        )
        for b, r in zip(bearing, away, strict=True)
    ]
    grid = np.stack(np.meshgrid(np.arange(-2, 3), np.arange(-2, 3)), -1).reshape(-1, 2) * 7.0
    trunks = grid + np.array([3.5, 3.0]) + rng.uniform(-1.2, 1.2, grid.shape)
    trunks = trunks[np.argsort(np.hypot(*trunks.T))]
    return make_instance(
        config,
        x0=np.concatenate([[0, 0, 2], v, [1.0, 0.0, 0.0, 0.0]]),
        u_last=HOVER,
        goal=(20.0, rng.normal(0, 4), 2.0),
        yaw=rng.uniform(-0.5, 0.5),
        neighbours=neighbours,
        cylinders=np.column_stack([trunks, np.ones(len(trunks))]),
        planes=[(0, 0, 1, 5.0), (0, 0, -1, -0.5)],
    )


def followed(config: NmpcConfig, first: Instance) -> Run:
    """Return TICKS instances, each at the state that the previous plan leads to."""
    nmpc, instance, found = Nmpc(config), first, []
    for _ in range(TICKS):
        result = nmpc.solve(instance)
        found.append(instance)
        instance = dataclasses.replace(
            instance,
            x0=result.x[1],
            u_last=result.u[0],
            neighbour_p=instance.neighbour_p + config.dt * instance.neighbour_v,
        )
    return Run("study", "warm", tuple(found))


def measured(config: NmpcConfig) -> Iterator[str]:
    """Yield the cells of a row: times of both solvers, and how much more the plans cost."""
    runs = [followed(config, swarm(config, seed)) for seed in range(SCENES)]
    optimum, worse = IpoptNmpc(config), []
    iterations = []
    for solver in (Nmpc(config, time.thread_time), IpoptNmpc(config, time.thread_time)):
        times = []
        for _, instance, result, first in solve_all(solver, runs):
            if not first:
                times.append(result.solve_time * 1e3)
            if isinstance(solver, IpoptNmpc):
                iterations.append(result.iterations)
            elif result.usable and not first:
                worse.append(worse_percent(optimum, instance, result))
        found = percentiles(times)
        yield from (f"{found['p50']:.2f}", f"{found['p99']:.2f}")
    found = percentiles(iterations)
    yield from (f"{found['p50']:.0f}", f"{found['max']:.0f}")
    found = percentiles(worse)
    yield from (f"{found['p50']:.3f}", f"{found['max']:.2f}")


def study(name: str) -> None:
    """Print the table of a study."""
    key, rows = STUDIES[name]
    ipopt = ("IPOPT p50 ms", "p99", "iterations p50", "max")
    _print(key, "RTI p50 ms", "p99", *ipopt, "worse % p50", "max")
    _print(*["---"] * 9)
    for changes in rows:
        _print(str(changes[key]), *measured(configured(**changes)))


def crossing() -> None:
    """Fly ten drones across each other in a forest, for each M."""
    from tests.companion.control.nmpc.plant import drone, fly, forest

    _print("M", "arrived", "seconds", "least distance m", "mean speed m/s")
    _print(*["---"] * 5)
    angles = np.arange(10) * 2 * np.pi / 10 + 0.05
    ring = [[34 * np.cos(a), 34 * np.sin(a), 2.0] for a in angles]
    for M in (5, 10, 20):
        config = configured(M=M)
        drones = [drone(config, s, float(np.arctan2(-s[1], -s[0]))) for s in ring]
        goals = [[-s[0], -s[1], 2.0] for s in ring]
        log = fly(drones, goals, 90, cylinders=forest(11), stop=1.0)
        off = np.linalg.norm(log.p[-1] - goals, axis=1)
        _print(
            str(M),
            f"{int((off < 1.5).sum())} of 10",
            f"{len(log.p) / 10:.0f}",
            f"{log.separation():.2f}",
            f"{log.speed.mean():.2f}",
        )


def _print(*cells: str) -> None:
    print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    if sys.argv[1:] == ["crossing"]:
        crossing()
    elif len(sys.argv) == 2 and sys.argv[1] in STUDIES:
        study(sys.argv[1])
    else:
        sys.exit(f"one of: {', '.join(STUDIES)}, crossing")
