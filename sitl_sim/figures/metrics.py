"""Figures of a flight: safety from the recorded truth, times and perception from the logs.

Definitions of order, union and connectivity are SwarmLab's (Soria, Schiano, Floreano, IROS 2020):
mean alignment of all pairs' velocities, (N - groups)/(N - 1) with the groups connected within
`REACH`, and the algebraic connectivity over N.
"""

from __future__ import annotations

import itertools
from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.distance import between
from sitl_sim.recording.run_folder import ours, radii
from sitl_sim.scenarios.scenario import TICK_MS
from sitl_sim.worlds.ground import Ground
from sitl_sim.worlds.world import surface_distance

AIRBORNE = 0.3  # m above ground
MOVING = 0.3  # m/s
LANDING = (1.5, 1.0)  # m/s down, along: a drone that meets the ground faster has struck it
REACH = 5.0  # m: two drones within this count as connected
AGENT_SAFETY, OBSTACLE_SAFETY = 2.5, 1.5  # radii of a drone: 0.5 m and 0.3 m for 0.2 m
STANDING = 0.5  # m: a drone that stays within this of a place makes no progress


def safety(
    truth: dict[str, NDArray[Any]], world: dict[str, Any], names: list[str]
) -> dict[str, Any]:
    """Return distances, collisions, targets and speeds, from the truth alone.

    Of our drones: foreign ones count where one of ours comes near them, and nowhere else.
    """
    t, p, v = truth["t"], truth["position"].astype(float), truth["velocity"].astype(float)
    radius, own = radii(world, names), ours(world, names)
    above = p[..., 2] - Ground(world).height(p[..., 0], p[..., 1])
    flying = above > AIRBORNE
    speed = np.linalg.norm(v, axis=-1)
    moving = flying & own & (speed > MOVING)
    surface = np.where(flying & own, surface_distance(p, world), np.inf)
    pairs, rooms = [], []
    for i, j in itertools.combinations(range(p.shape[1]), 2):
        if not (own[i] or own[j]):
            continue
        both = flying[:, i] & flying[:, j]
        apart = np.where(both, between(p[:, i], p[:, j]), np.inf)
        k = int(apart.argmin())
        if np.isfinite(apart[k]):  # the others never flew together
            pairs.append((float(apart[k]), float(t[k]), names[i], names[j]))
            rooms.append((float(apart[k]), float(radius[i] + radius[j])))
    tolerance = world["target_tolerance"]
    believed = world.get("targets_by") == "estimate"  # a drone cannot know better
    path = truth["estimate"].astype(float) if believed else p
    instants = {
        name: reached_in_order(path[:, i], world["targets"][name], tolerance)
        for i, name in enumerate(names)
        if own[i]
    }
    reached = {name: len(at) for name, at in instants.items()}
    wanted = {name: len(world["targets"][name]) for name in reached}
    complete = all(reached[n] == wanted[n] > 0 for n in reached)
    closest = min(pairs, default=None)
    nearest = np.unravel_index(int(surface.argmin()), surface.shape)
    near_any = bool(np.isfinite(surface[nearest]))  # there are obstacles, and a drone flew
    return {
        "drones": len(names),
        "duration_s": float(t[-1] - t[0]),
        "mission_complete": complete,
        "mission_time_s": float(t[max(at[-1] for at in instants.values())]) if complete else None,
        "targets_reached": {n: f"{reached[n]}/{wanted[n]}" for n in reached},
        "largest_estimate_error_m": _largest_error(truth) if believed else None,
        "agent_collisions": sum(d < touch for d, touch in rooms),
        "obstacle_collisions": int((surface.min(axis=0) < radius).sum()),
        "ground_strikes": int((ground_strikes(above, v, radius) & own).sum()),
        "min_agent_distance_m": closest[0] if closest else None,
        "min_agent_distance_at": list(closest[1:]) if closest else None,
        "min_obstacle_distance_m": float(surface[nearest]) if near_any else None,
        "min_obstacle_distance_at": [float(t[nearest[0]]), names[nearest[1]]] if near_any else None,
        "below_agent_safety": any(d < AGENT_SAFETY / 2 * touch for d, touch in rooms),
        "below_obstacle_safety": bool((surface < OBSTACLE_SAFETY * radius).any()),
        **standstills(
            t,
            p[:, own],
            flying[:, own],
            [
                at[wanted[n] - 1] if len(at) == wanted[n] > 0 else len(t)
                for n, at in instants.items()
            ],
        ),
        "mean_speed_m_s": float(speed[moving].mean()) if moving.any() else 0.0,
        "std_speed_m_s": float(speed[moving].std()) if moving.any() else 0.0,
        "never_flew": [n for i, n in enumerate(names) if own[i] and not flying[:, i].any()],
        **flocking(p, v, flying & own, moving),
        **({} if own.all() else {"foreign": [n for n, o in zip(names, own, strict=True) if not o]}),
    }


def _largest_error(truth: dict[str, NDArray[Any]]) -> float:
    """Return the largest distance [m] between where a drone was and where it believed to be."""
    return float(np.linalg.norm(truth["estimate"] - truth["position"], axis=-1).max())


def ground_strikes(above: Vector, v: Vector, radius: Vector) -> NDArray[np.bool_]:
    """Return (n,) which drones came down faster than a landing, or slid along the ground.

    above: (T,n) m over the ground. v: (T,n,3) m/s. radius: (n,) m. Before it has flown, a drone
    cannot strike: gusts may push one along that takes off.
    """
    been_up = np.maximum.accumulate(above > AIRBORNE, axis=0)
    down, along = LANDING
    hard = (v[..., 2] < -down) | (np.linalg.norm(v[..., :2], axis=-1) > along)
    struck: NDArray[np.bool_] = (been_up & (above < radius) & hard).any(axis=0)
    return struck


def reached_in_order(path: Vector, targets: list[list[float]], tolerance: float) -> list[int]:
    """Return the index into the path (T,3) at which each target was reached, one after another.

    Reached: within `tolerance` [m]. The list ends with the last target that was reached.
    """
    instants: list[int] = []
    at = 0
    for target in targets:
        near = np.linalg.norm(path[at:] - np.array(target), axis=1) <= tolerance
        if not near.any():
            break
        at += int(near.argmax())
        instants.append(at)
    return instants


def standstills(
    t: Vector, p: Vector, flying: NDArray[np.bool_], ends: list[int]
) -> dict[str, float]:
    """Return the longest standstill of one drone, and of all drones under way at once [s].

    t: (T,) s. p: (T,n,3) m. flying: (T,n). ends: (n,) index into t at which a drone's way ends; it
    begins when the drone leaves the place above its start. Measured at 10 Hz and by position, not
    by speed, because a drone that is held up does not hover exactly still.
    """
    step = max(1, round(0.1 / max(float(np.diff(t).mean()), 1e-3))) if len(t) > 1 else 1
    gone = flying & (np.linalg.norm(p[..., :2] - p[0, :, :2], axis=-1) > STANDING)
    index = np.arange(len(t))[:, None]
    under_way = (np.cumsum(gone, axis=0) > 0) & (index < np.array(ends))
    t, p, under_way = t[::step], p[::step], under_way[::step]
    one = everyone = 0.0
    for k in np.flatnonzero(under_way.any(axis=1)):
        drones = under_way[k]
        off = np.linalg.norm(p[k:, drones] - p[k, drones], axis=-1) > STANDING
        off |= ~under_way[k:, drones]  # a drone that arrives has made progress
        stood = np.where(off.any(axis=0), off.argmax(axis=0), len(off)) - 1
        one = max(one, float(t[k + stood.max()] - t[k]))
        everyone = max(everyone, float(t[k + stood.min()] - t[k]))
    return {"longest_standstill_s": one, "longest_deadlock_s": everyone}


def flocking(
    p: Vector, v: Vector, flying: NDArray[np.bool_], moving: NDArray[np.bool_]
) -> dict[str, float | None]:
    """Return the means of SwarmLab's order, union and connectivity over the flight, at 5 Hz."""
    order, union, connectivity = [], [], []
    for k in range(0, len(p), 10):
        if moving[k].sum() > 1:
            u = v[k][moving[k]]
            u = u / np.linalg.norm(u, axis=1, keepdims=True)
            n = len(u)
            order.append((float((u @ u.T).sum()) - n) / (n * (n - 1)))
        if flying[k].sum() > 1:
            q = p[k][flying[k]]
            near = np.linalg.norm(q[:, None] - q[None], axis=-1) < REACH
            np.fill_diagonal(near, False)
            laplacian = np.diag(near.sum(axis=1)) - near
            eigenvalues = np.linalg.eigvalsh(laplacian.astype(float))
            groups = int((eigenvalues < 1e-6).sum())
            union.append((len(q) - groups) / (len(q) - 1))
            connectivity.append(float(eigenvalues[1]) / len(q))
    return {
        "order": float(np.mean(order)) if order else None,
        "union": float(np.mean(union)) if union else None,
        "connectivity": float(np.mean(connectivity)) if connectivity else None,
    }


def sanity(truth: dict[str, NDArray[Any]]) -> list[str]:
    """Return inconsistencies of the truth itself: a frozen or jumping world proves nothing."""
    t = truth["t"]
    p, v, q = (truth[k].astype(float) for k in ("position", "velocity", "attitude"))
    names = ("t", "position", "velocity", "attitude")
    if bad := [n for n, a in zip(names, (t, p, v, q), strict=True) if not np.isfinite(a).all()]:
        return [f"{n} holds a value that is not finite" for n in bad]
    faults, dt = [], np.diff(t)
    if not len(dt) or (dt <= 0).any() or np.median(dt) > 0.021:
        return ["time does not rise in steps of at most 20 ms"]
    if np.abs(np.linalg.norm(q, axis=-1) - 1).max() > 1e-3:
        faults.append("attitude is not a unit quaternion")
    gap = np.abs(np.diff(p, axis=0) / dt[:, None, None] - (v[1:] + v[:-1]) / 2).max()
    if gap > 1.0:
        faults.append(f"position and velocity disagree by {gap:.2f} m/s")
    if np.linalg.norm(np.diff(v, axis=0), axis=-1).max() / np.median(dt) > 80.0:
        faults.append("an acceleration beyond 80 m/s²")
    return faults


def timing(logs: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """Return solve and tick times over all drones [ms], and missed deadlines.

    A drone's deadline misses: the ticks that took longer than the period, or the companion's own
    count, whichever is more. In real time a companion counts the periods that it missed; in
    lockstep, where the world waits, only frames whose telemetry was lost.
    """
    ticks = [r for log in logs.values() for r in log]
    solves = [r["solver"]["solve_ms"] for r in ticks if "solver" in r]
    stages: dict[str, list[float]] = {}
    for r in ticks:
        for stage, ms in r["stages_ms"].items():
            stages.setdefault(stage, []).append(ms)
    misses = sum(
        max(
            log[-1]["counters"]["deadline_misses"],
            sum(r["stages_ms"].get("tick", 0.0) > TICK_MS for r in log),
        )
        for log in logs.values()
        if log
    )
    return {
        "solve_ms": quantiles(solves),
        "tick_ms": quantiles(stages.pop("tick", [])),
        "stage_ms": {stage: quantiles(ms) for stage, ms in stages.items()},
        "deadline_misses": misses,
        "deadline_miss_rate": misses / max(len(ticks), 1),
        "bad_solves": sum(not r["solver"]["usable"] for r in ticks if "solver" in r),
    }


def certificates(logs: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """Return the share of ticks on the mission whose command flew with a certificate, and the rest.

    refused: ticks whose plan had none, by what was in its way. beyond: ticks in which a neighbour
    or an obstacle broke a bound. None where the logs hold no certificates.
    """
    found = [
        r["certificate"]
        for log in logs.values()
        for r in log
        if r["phase"] == "fly" and r.get("certificate")
    ]
    judged = [c for c in found if "flown" in c]
    refused = Counter(c["cause"] for c in judged if c["flown"] != "command")
    certified = sum(c["flown"] != "none" for c in judged)
    return {
        "certified_share": certified / len(judged) if judged else None,
        "plans_refused": dict(refused),
        "bounds_broken_ticks": sum(bool(c["beyond"]) for c in found),
    }


def wilson(successes: int, runs: int, z: float = 1.96) -> tuple[float, float]:
    """Return the Wilson score interval of a success rate; z = 1.96: 95 %."""
    if runs == 0:
        return 0.0, 1.0
    rate, z2 = successes / runs, z * z
    centre = (rate + z2 / (2 * runs)) / (1 + z2 / runs)
    half = z / (1 + z2 / runs) * ((rate * (1 - rate) / runs + z2 / (4 * runs * runs)) ** 0.5)
    return max(centre - half, 0.0), min(centre + half, 1.0)


def quantiles(values: list[float]) -> dict[str, float | None]:
    """Return p50, p99 and max."""
    if not values:
        return {"p50": None, "p99": None, "max": None}
    return {
        "p50": round(float(np.percentile(values, 50)), 3),
        "p99": round(float(np.percentile(values, 99)), 3),
        "max": round(float(np.max(values)), 3),
    }
