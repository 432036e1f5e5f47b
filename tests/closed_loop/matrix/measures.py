"""Measures of a flight for the rows of the fault matrix, and ways to disturb its companions."""

import gc
import time
from dataclasses import replace

import numpy as np

from sitl_sim.figures.metrics import reached_in_order
from tests.closed_loop.matrix.inprocess import fly

CRUISE = 8.0  # s, in full flight
SHORT = {"mission__time_limit": 11.0, "world": {}}  # nothing in the way


def spoil_solves(flight, first, which, u=None, i=0):
    """Let solves of drone i fail: from flight time `first` [s] on those whose number is in `which`.

    which: a container; the first solve is number 0. u: replaces their result.
    """
    planner = flight.companions[i].companion._planning._planner
    solve, done = planner.solve, []

    def bad(instance):
        result = solve(instance)
        if flight._now / 1e3 < first - 1e-6:
            return result
        done.append(1)
        if len(done) - 1 not in which:
            return result
        shifted = np.vstack([result.u[1:], result.u[-1:]]) if u is None else u(result.u)
        return replace(result, usable=u is not None, u=shifted)

    planner.solve = bad


def flown_with(spoil, faults=(), **options):
    """Fly a flight that `spoil` changes before it begins."""
    return fly(faults, at={0.0: spoil}, **options)


def costs_of_ticks(since, *disturbed, rounds=4, **options):
    """For each list of faults: processor time [s] of each tick from `since` [s] on, and a flight.

    A machine is now slow, now fast, also for longer than a flight takes: so the flights take turns,
    and of each tick the least time of all rounds counts.
    """

    def watch(f):
        f.companions[0].stopwatch = time.thread_time

    gc.collect()
    gc.freeze()  # a daemon has no thousand other tests' objects to look through
    flown = [[flown_with(watch, faults, **options) for faults in disturbed] for _ in range(rounds)]
    gc.unfreeze()
    result = []
    for flights in zip(*flown, strict=True):
        rows = [
            [s for s, o in zip(c.seconds, c.outs, strict=True) if o.time > since]
            for c in (f.companions[0] for f in flights)
        ]
        result.append((np.min(rows, axis=0), flights[-1]))
    return result


def seconds_until(flight, since, holds, i=0):
    """Seconds from flight time `since` until first holds(v (3,), p (3,)) of the truth."""
    truth = flight.truth.arrays()
    for t, v, p in zip(truth["t"], truth["velocity"][:, i], truth["position"][:, i], strict=True):
        if t >= since and holds(v, p):
            return float(t) - since
    raise AssertionError("never")


def last_target(flight):
    """Flight time [s] at which the last drone has reached the last of its targets."""
    truth, world = flight.truth.arrays(), flight.world
    return max(
        float(truth["t"][reached_in_order(truth["position"][:, i], world["targets"][name],
                                          world["target_tolerance"])[-1]])
        for i, name in enumerate(flight.names)
    )  # fmt: skip


def mode_after(flight, since, mode, i=0):
    """Seconds from `since` until drone i's vehicle enters this mode."""
    after = [t for t, name in flight.modes[i] if t >= since and name == mode]
    assert after, f"never in {mode}: {flight.modes[i]}"
    return after[0] - since


def modes_from(flight, since, i=0, until=np.inf):
    """Names of the modes of drone i's vehicle from `since` on, and before `until`."""
    before = [name for t, name in flight.modes[i] if t <= since][-1:]
    return {*before, *(name for t, name in flight.modes[i] if since < t < until)}


def asked(flight, ask, i=0):
    """Time of the first tick whose verdict has this request."""
    return next(
        (
            o.time
            for o in flight.companions[i].outs
            if o.verdict is not None and o.verdict.request is ask
        ),
        None,
    )


def first_with(companion, since, reason):
    """Flight time of the first tick from `since` on whose command has this reason."""
    return next(
        t
        for t, o in companion.ticks(since - 1e-6)
        if o.verdict is not None and o.verdict.reason is reason
    )


def nan_between(start, end):
    """For `before`: add detections of NaN and infinity to the true ones, in [start, end) s."""

    def spoil(inputs):
        if inputs.frame is None or not start <= inputs.time < end:
            return inputs
        bad = np.full((2, 6), np.nan)
        bad[1] = [0, 0, 1, np.inf, 0.01, 0.1]
        rows = np.vstack([inputs.frame.arrays.get("neighbours", np.zeros((0, 6))), bad])
        arrays = inputs.frame.arrays | {"neighbours": rows}
        return replace(inputs, frame=replace(inputs.frame, arrays=arrays))

    return spoil


def hovers(f, i, since, limit=0.25):
    """Assert that drone i moves no faster than `limit` [m/s], measured over the ground."""
    truth = f.truth.arrays()
    v = np.linalg.norm(truth["velocity"][truth["t"] >= since, i, :2], axis=1)
    assert v.max() < limit, f"drone{i + 1} moves at {v.max():.2f} m/s"


def slow_after(f, i, since, speed):
    truth = f.truth.arrays()
    v = np.linalg.norm(truth["velocity"][:, i], axis=1)
    return float(truth["t"][(truth["t"] >= since) & (v <= speed)][0]) - since


def completes(f, i, kind, note):
    assert f.reached(i) >= 1, f"drone{i + 1} reached no target"
    note("at its first target [s]", f.first_target(i))
