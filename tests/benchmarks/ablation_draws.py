"""All rules of `sitl-sim study ablation` at once: each flight flies without a random few of them.

    python tests/benchmarks/ablation_draws.py SCENARIO --out DIR [--flights 120] [--seed S]
        [--share 0.2] [--leave-out "CASE;CASE"] [--workers 2]

One rule at a time on 30 paired seeds takes 30 flights a rule. Here every flight tells something of
every rule, as in a factorial experiment: in 120 flights each rule is off in some 24 and on in the
others, and least squares tell what each of them does. They miss what only two do together.

DIR holds a run folder for each flight; flights that are there are not flown again. Which rules a
flight flies without follows from its seed. --leave-out: cases that no flight flies.

Printed, a line for each rule: the flights without it, with a contact, of all; the same with it;
what changes without it, ± 1.96 standard errors: the least distance between two drones [m], the
time to all targets [s] (of flights that reached them), the certified share of the ticks [%].
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from sitl_sim.campaigns.run import Job, fly, metrics_of, set_up_worker
from sitl_sim.campaigns.study import load


def effects(off, y):
    """Return what each rule off (N,K) bool does to y (N,), NaN: not known, and its standard errors.

    A rule that is never off, or always, has NaN.
    """
    known = np.isfinite(y)
    off, y = off[known], y[known]
    x = np.column_stack([np.ones(len(y)), off])
    inverse = np.linalg.pinv(x.T @ x)
    beta = inverse @ x.T @ y
    residual = y - x @ beta
    variance = float(residual @ residual) / max(len(y) - x.shape[1], 1)
    errors = np.sqrt(variance * np.diag(inverse)[1:])
    told = off.any(axis=0) & ~off.all(axis=0)
    return np.where(told, beta[1:], np.nan), np.where(told, errors, np.nan)


def figures(metrics):
    """Return the least distance [m], the time to all targets [s], the certified share [%]."""
    time = metrics["mission_time_s"]
    return (
        metrics["min_agent_distance_m"],
        np.nan if time is None else time,
        100.0 * metrics["certified_share"],
    )


def lines(cases, off, found):
    """Yield a line for each of K cases. off: (N,K) bool; found: the metrics of N flights."""
    hit = np.array([bool(m["agent_collisions"] or m["obstacle_collisions"]) for m in found])
    changes = [effects(off, y) for y in np.array([figures(m) for m in found], dtype=float).T]
    for k, case in enumerate(cases):
        without, with_it = hit[off[:, k]], hit[~off[:, k]]
        told = "; ".join(f"{b[k]:+.3f} ± {1.96 * e[k]:.3f}" for b, e in changes)
        counts = f"{without.sum()} of {len(without)} | {with_it.sum()} of {len(with_it)}"
        yield f"{case:45} {counts:22} {told}"


def main():
    """Fly what is missing; print what each rule does."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--flights", type=int, default=120)
    parser.add_argument("--seed", type=int, default=60000)
    parser.add_argument("--share", type=float, default=0.2)
    parser.add_argument("--leave-out", default="")
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    study = load("ablation")
    left_out = {name for name in args.leave_out.split(";") if name}
    if unknown := left_out - set(study.cases):
        parser.error(f"no cases {sorted(unknown)}; valid: {'; '.join(study.cases)}")
    cases = {name: c for name, c in study.cases.items() if c and name not in left_out}
    seeds = range(args.seed, args.seed + args.flights)
    off = np.array([np.random.default_rng(s).random(len(cases)) < args.share for s in seeds])
    folders = [args.out / f"{args.scenario}-{seed}" for seed in seeds]
    with ProcessPoolExecutor(args.workers, get_context("spawn"), set_up_worker) as pool:
        jobs = []
        for seed, flies, folder in zip(seeds, off, folders, strict=True):
            drawn = [c for c, without in zip(cases.values(), flies, strict=True) if without]
            changes = tuple(sum(drawn, study.set))
            if metrics_of(folder) is None:
                job = Job(args.scenario, changes, seed, str(folder), in_process=True)
                jobs.append(pool.submit(fly, job))
        for job in jobs:
            job.result()
    print("\n".join(lines(cases, off, [metrics_of(folder) for folder in folders])))


if __name__ == "__main__":
    main()
