"""One drone's flight as its own log tells it: belief, not truth."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from companion.flightlog.recorder import CONFIG
from companion.types import Phase
from mavlink_bridge.shared.mcap_file import (
    LogError,
    check_begins,
    check_whole,
    read_metadata,
    salvage,
)

_FLYING = {p.value for p in Phase if p.flying}
_SEEN = 0.3  # s unseen, after which a neighbour's place is a guess
_EVENTS = 200  # most that are told


@dataclass(frozen=True)
class Approach:
    """The closest approach that a drone believes: m between centres, when [s], how sure [m].

    seen: whether the neighbour was in sight then; else its place was a guess.
    """

    distance: float
    time: float
    sigma: float
    seen: bool


@dataclass(frozen=True)
class Event:
    """Something that lasted: when it began [s], how long [s], what."""

    time: float
    seconds: float
    what: str


@dataclass
class Flight:
    """What one log tells; times in seconds since its first tick, distances in metres."""

    name: str
    path: Path
    whole: bool  # else the log breaks off: its end is lost
    seconds: float = 0.0
    flown: float = 0.0  # s with setpoints
    track: list[list[float]] = field(default_factory=list)  # (n,3) m, own frame
    phases: list[Event] = field(default_factory=list)
    guard: list[Event] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    approach: Approach | None = None
    trunk: tuple[float, float] | None = None  # m to the nearest trunk's bark, when [s]
    stages: dict[str, tuple[float, float, float]] = field(default_factory=dict)  # ms
    estimates: dict[str, str] = field(default_factory=dict)
    goals: tuple[int, int] = (0, 0)  # reached or flown to, and how many there are
    counters: dict[str, int] = field(default_factory=dict)

    @property
    def quiet(self) -> bool:
        """Whether the guard let the plan fly all the time."""
        return all(e.what == "plan" for e in self.guard)


def read_flight(path: Path) -> Flight:
    """Return what a log tells; of one that breaks off, what it still holds.

    Raises:
        LogError: no flight log, or none with a tick.
    """
    check_begins(path)
    try:
        check_whole(path)
        whole = True
    except LogError:
        whole = False
    try:
        ticks = [orjson.loads(m.data) for m in salvage(path, "/tick")]
    except ValueError as error:
        raise LogError(f"{path}: not a flight log of a companion: {error}") from error
    if not ticks:
        raise LogError(f"{path}: no tick in it: not a flight log of a companion")
    config = _config(path) if whole else {}
    flight = Flight(str(config.get("name", path.stem)), path, whole)
    _fill(flight, ticks, config)
    return flight


def _config(path: Path) -> dict[str, Any]:
    try:
        settings: dict[str, Any] = orjson.loads(read_metadata(path)[CONFIG]["set"])
    except (KeyError, ValueError):
        return {}
    return settings


def _fill(f: Flight, ticks: list[dict[str, Any]], config: dict[str, Any]) -> None:
    start = ticks[0]["time"]
    times = [t["time"] - start for t in ticks]
    f.seconds = times[-1]
    f.phases = list(spans(times, (t["phase"] for t in ticks)))
    f.flown = sum(e.seconds for e in f.phases if e.what in _FLYING)
    reasons = (t.get("command", {}).get("reason", "") for t in ticks)
    f.guard = [e for e in spans(times, reasons) if e.what]
    f.track = [t["own"]["p"] for t in ticks[::5] if "own" in t]
    f.approach = closest(times, ticks)
    f.trunk = _nearest_trunk(times, ticks)
    f.events = _events(times, ticks)
    f.stages = stage_times(ticks)
    f.estimates = _estimates(ticks)
    goals = config.get("mission", {}).get("goals", [])
    reached = max((t.get("goal", {}).get("index", -1) for t in ticks if _flies(t)), default=-1)
    f.goals = (reached + 1, max(len(goals), reached + 1))
    f.counters = {k: v for k, v in ticks[-1].get("counters", {}).items() if v}


def spans(times: list[float], values: Iterable[str]) -> Iterator[Event]:
    """Yield each value that lasts, with its begin and how long it lasted, to the next one."""
    n = 0
    for value, run in groupby(values):
        count = sum(1 for _ in run)
        end = times[min(n + count, len(times) - 1)]
        yield Event(times[n], end - times[n], value)
        n += count


def _flies(tick: dict[str, Any]) -> bool:
    return tick["phase"] in _FLYING


def closest(times: list[float], ticks: list[dict[str, Any]]) -> Approach | None:
    """Return the closest approach to any neighbour that was believed while the companion flew."""
    best: Approach | None = None
    for time, tick in zip(times, ticks, strict=True):
        if not _flies(tick) or "own" not in tick:
            continue
        for t in tick["tracks"]:
            distance = math.dist(t["p"], tick["own"]["p"])
            if best is None or distance < best.distance:
                best = Approach(distance, time, t["sigma"], t["unseen"] <= _SEEN)
    return best


def _nearest_trunk(times: list[float], ticks: list[dict[str, Any]]) -> tuple[float, float] | None:
    """Return the least distance to the bark of any known trunk [m], and when [s]."""
    best = None
    for time, tick in zip(times, ticks, strict=True):
        if not _flies(tick) or "own" not in tick:
            continue
        x, y = tick["own"]["p"][:2]
        for cx, cy, radius in tick["cylinders"]:
            gap = math.hypot(cx - x, cy - y) - radius
            if best is None or gap < best[0]:
                best = (gap, time)
    return best


def _events(times: list[float], ticks: list[dict[str, Any]]) -> list[Event]:
    """Return what was wrong, by itself or in the autopilot's words, in the order of time."""
    told: list[Event] = []
    for key, kind in (("camera", "camera"), ("broken", "assumption"), ("inhibit", "not ready")):
        values = (str(t.get(key, "")) for t in ticks)
        told += [
            Event(e.time, e.seconds, f"{kind}: {e.what}")
            for e in spans(times, values)
            if e.what not in ("", "none")
        ]
    for time, tick in zip(times, ticks, strict=True):
        told += [Event(time, 0.0, f"autopilot refused {r}") for r in tick.get("refusals", [])]
    return sorted(told, key=lambda e: e.time)[:_EVENTS]


def stage_times(ticks: list[dict[str, Any]]) -> dict[str, tuple[float, float, float]]:
    """Return median, 99th percentile and most of each stage's time [ms], of ticks in flight."""
    flown = [t["stages_ms"] for t in ticks if _flies(t)] or [t["stages_ms"] for t in ticks]
    names = dict.fromkeys(name for t in flown for name in t)
    out = {}
    for name in names:
        values = np.array([t[name] for t in flown if name in t])
        p50, p99 = np.percentile(values, [50, 99])
        out[name] = (float(p50), float(p99), float(values.max()))
    return out


def _estimates(ticks: list[dict[str, Any]]) -> dict[str, str]:
    """Return what was learnt, from the first tick in flight to the last."""
    flown = [t for t in ticks if _flies(t)] or ticks
    first, last = flown[0], flown[-1]
    hover = [f"{t['hover_thrust']:.3f} ±{t['hover']['doubt']:.1%}" for t in (first, last)]
    out = {"hover thrust": f"{hover[0]} → {hover[1]} ({last['hover']['source']})"}
    out["delay"] = " → ".join(_with_sigma(t["delay"], 1e3, "ms") for t in (first, last))
    if last.get("velocity_lag"):
        out["velocity lag"] = _with_sigma(last["velocity_lag"], 1e3, "ms")
    alignment = last.get("alignment") or {}
    if alignment:
        out["camera lag"] = _with_sigma([alignment["lag"], alignment["sigmas"][0]], 1e3, "ms")
    if last.get("height"):
        out["height offset"] = _with_sigma(last["height"], 1.0, "m")
    clock = last.get("clock")
    if clock:
        out["vehicle's clock"] = f"rate {clock['rate']:.5f}, {clock['jumps']} jumps"
    return out


def _with_sigma(value: list[float | None], scale: float, unit: str) -> str:
    """Return a value with its doubt; the log has null where a number is not finite."""
    if value[0] is None:
        return "unknown"
    if value[1] is None:
        return f"{value[0] * scale:.3g} {unit}, no doubt known"
    return f"{value[0] * scale:.3g} ±{value[1] * scale:.2g} {unit}"
