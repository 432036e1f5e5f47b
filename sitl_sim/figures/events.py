"""Events of a flight: changes in the companions' logs, collisions in the truth."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from sitl_sim.figures.metrics import AIRBORNE
from sitl_sim.recording.run_folder import Run, ours, own_frames, radii
from sitl_sim.scenarios.scenario import companion_names, fault_schedule
from sitl_sim.worlds.world import surface_distance

_SILENCE = 1.0  # s without a tick


@dataclass(frozen=True)
class Event:
    """An event that began at `time` [s, world] on a drone.

    kind: fault, phase, target, guard, deadline, silence, vehicle or collision.
    """

    time: float
    drone: str
    kind: str
    text: str


@dataclass(frozen=True)
class Span:
    """A fault of the scenario on a drone, from `start` to `end` [s, world]."""

    start: float
    end: float
    drone: str
    text: str


@dataclass(frozen=True)
class Collision:
    """Two drones, or a drone and an obstacle (other: None), that touched first at `time` [s]."""

    time: float
    drone: int
    other: int | None
    distance: float


def events(run: Run) -> list[Event]:
    """Return all events of a flight, in order of time."""
    found = [e for i, name in enumerate(run.names) for e in _of_drone(run, i, name)]
    found += [e for i, name in enumerate(run.names) for e in _of_vehicle(run, i, name)]
    for span in faults(run):
        found.append(Event(span.start, span.drone, "fault", f"fault: {span.text}"))
        if span.end < run.truth["t"][-1]:
            found.append(Event(span.end, span.drone, "fault", f"fault over: {span.text}"))
    for c in collisions(run):
        with_ = "an obstacle" if c.other is None else run.names[c.other]
        found.append(
            Event(
                c.time,
                run.names[c.drone],
                "collision",
                f"collides with {with_}: {c.distance:.2f} m",
            )
        )
    return sorted(found, key=lambda e: e.time)


def faults(run: Run) -> list[Span]:
    """Return the faults of the scenario within the time flown."""
    end = float(run.truth["t"][-1])
    found = []
    for fault in fault_schedule(run.scenario).all():
        c = fault.config
        if c.at < end:
            amount = "" if c.amount is None else f" {c.amount:g}"
            until = min(c.at + (c.duration or end), end)
            found.append(Span(c.at, until, run.names[fault.i], f"{c.kind}{amount}"))
    return found


def _of_drone(run: Run, i: int, name: str) -> list[Event]:
    """Return changes of phase, target, guard reason and deadline misses in one log."""
    boot = own_frames(run.scenario, run.world)[i].boot
    found = []
    for before, now in itertools.pairwise([{}, *run.logs[name]]):
        time = now["time"] - boot
        if now["phase"] != before.get("phase"):
            found.append(Event(time, name, "phase", now["phase"]))
        old, new = _index(before), _index(now)
        if old is not None and new is not None and new > old:
            found.append(Event(time, name, "target", f"target {old + 1} reached"))
        reason = now.get("command", {}).get("reason", "plan")
        if reason != before.get("command", {}).get("reason", "plan"):
            found.append(Event(time, name, "guard", f"guard: {reason}"))
        missed = _misses(now) - _misses(before)
        if before and missed:
            found.append(Event(time, name, "deadline", f"{missed} deadline(s) missed"))
        pause = now["time"] - before["time"] if before else 0.0
        if pause > _SILENCE:
            found.append(Event(time - pause, name, "silence", f"no tick for {pause:.1f} s"))
    return found + _end_of_log(run, name, boot)


def _end_of_log(run: Run, name: str, boot: float) -> list[Event]:
    """Return an event where a log ends before the flight, unless its companion was done."""
    if name not in companion_names(run.scenario):
        return []
    if not run.logs[name]:
        return [Event(0.0, name, "silence", "no log")]
    last = run.logs[name][-1]
    if last["phase"] == "done" or last["time"] - boot > run.truth["t"][-1] - _SILENCE:
        return []
    return [Event(last["time"] - boot, name, "silence", "the log ends here")]


def _of_vehicle(run: Run, i: int, name: str) -> list[Event]:
    """Return arming and disarming, from the truth."""
    t, armed = run.truth["t"], run.truth.get("armed")
    if armed is None:
        return []
    height = run.truth["position"][:, i, 2]
    found = []
    for k in np.flatnonzero(np.diff(armed[:, i].astype(int))) + 1:
        where = f" at {height[k]:.1f} m" if height[k] > AIRBORNE else ""
        text = "armed" if armed[k, i] else f"disarmed{where}"
        found.append(Event(float(t[k]), name, "vehicle", text))
    return found


def collisions(run: Run) -> list[Collision]:
    """Return each pair, and each drone with an obstacle, at the first instant of contact.

    One of ours is in each, as in the figures.
    """
    t, p = run.truth["t"], run.truth["position"].astype(float)
    radius, own = radii(run.world, run.names), ours(run.world, run.names)
    flying = p[..., 2] > AIRBORNE
    found = []
    for i, j in itertools.combinations(range(p.shape[1]), 2):
        apart = np.linalg.norm(p[:, i] - p[:, j], axis=-1)
        hit = np.flatnonzero(flying[:, i] & flying[:, j] & (apart < radius[i] + radius[j]))
        if len(hit) and (own[i] or own[j]):
            found.append(Collision(float(t[hit[0]]), i, j, float(apart[hit].min())))
    surface = np.where(flying, surface_distance(p, run.world), np.inf)
    for i in np.flatnonzero(own).tolist():
        hit = np.flatnonzero(surface[:, i] < radius[i])
        if len(hit):
            found.append(Collision(float(t[hit[0]]), i, None, float(surface[hit, i].min())))
    return sorted(found, key=lambda c: c.time)


def _index(record: dict[str, Any]) -> int | None:
    index: int | None = record.get("goal", {}).get("index")
    return index


def _misses(record: dict[str, Any]) -> int:
    return int(record.get("counters", {}).get("deadline_misses", 0))
