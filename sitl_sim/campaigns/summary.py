"""Summary of a campaign: success rate with its interval, distances, times, every failure."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from sitl_sim.figures.metrics import wilson
from sitl_sim.figures.verdict import shortcomings

_MEANS = ("mean_speed_m_s", "order", "union", "connectivity")


def summary(
    name: str, flights: dict[int, dict[str, Any]], not_flown: dict[int, str], runs: int
) -> dict[str, Any]:
    """Return the figures over all flights.

    flights: metrics by seed. not_flown: seed → reason; such a flight counts as no success.
    """
    good = {seed: m for seed, m in flights.items() if m["ok"]}
    tried = len(flights) + len(not_flown)
    low, high = wilson(len(good), tried)
    return {
        "scenario": name,
        "commit": ", ".join(sorted({m.get("commit") or "unknown" for m in flights.values()})),
        "runs": runs,
        "flown": len(flights),
        "tried": tried,
        "ok": len(good),
        "success": len(good) / tried if tried else None,
        "wilson_95": [low, high],
        "collided": sum(
            bool(m["agent_collisions"] or m["obstacle_collisions"]) for m in flights.values()
        ),
        "below_safety": sum(
            bool(m["below_agent_safety"] or m["below_obstacle_safety"]) for m in flights.values()
        ),
        "min_agent_distance_m": _spread(m["min_agent_distance_m"] for m in flights.values()),
        "min_obstacle_distance_m": _spread(m["min_obstacle_distance_m"] for m in flights.values()),
        "mission_time_s": _spread(m["mission_time_s"] for m in good.values()),
        "longest_standstill_s": _spread(m["longest_standstill_s"] for m in flights.values()),
        "longest_deadlock_s": _spread(m["longest_deadlock_s"] for m in flights.values()),
        "solve_ms": {
            "p50": _mean(m["solve_ms"]["p50"] for m in flights.values()),
            "p99": _mean(m["solve_ms"]["p99"] for m in flights.values()),
        },
        **{key: _mean(m[key] for m in flights.values()) for key in _MEANS},
        "failures": {
            str(seed): list(shortcomings(m)) for seed, m in sorted(flights.items()) if not m["ok"]
        },
        "not_flown": {str(seed): why for seed, why in sorted(not_flown.items())},
    }


def table(s: dict[str, Any]) -> str:
    """Return the summary as lines of text, failures by seed below."""
    low, high = s["wilson_95"]
    standstills = (s[k]["most"] for k in ("longest_standstill_s", "longest_deadlock_s"))
    flocking = (s[k] for k in ("order", "union", "connectivity"))
    rate = "–" if s["success"] is None else f"{s['success']:.1%}"
    rows = [
        ("scenario, runs", f"{s['scenario']}, {s['flown']} of {s['runs']} flown"),
        ("code", s["commit"]),
        ("success", f"{s['ok']} of {s['tried']}: {rate}, 95 % {low:.1%} to {high:.1%} (Wilson)"),
        ("runs with a collision", str(s["collided"])),
        ("between drones, least / median", _two(s["min_agent_distance_m"], "m")),
        ("to an obstacle, least / median", _two(s["min_obstacle_distance_m"], "m")),
        ("nearer than asked, runs", str(s["below_safety"])),
        ("mission time, median / most", _two(s["mission_time_s"], "s", ("median", "most"))),
        ("longest standstill of one / all, most", " / ".join(map(_number, standstills)) + " s"),
        ("speed while moving", f"{_number(s['mean_speed_m_s'])} m/s"),
        ("order / union / connectivity", " / ".join(map(_number, flocking))),
        ("processor / wall time of a flight", _cost(s, ("processor_s", "wall_s")) + " s, mean"),
        ("flights per core and hour", _cost(s, ("flights_per_core_hour",))),
        ("solve, p50 / p99", " / ".join(_number(s["solve_ms"][k]) for k in ("p50", "p99")) + " ms"),
        *((f"seed {seed}", "; ".join(why)) for seed, why in s["failures"].items()),
        *((f"seed {seed} not flown", why) for seed, why in s["not_flown"].items()),
    ]
    width = max(len(k) for k, _ in rows)
    return "\n".join(f"{k:<{width}}  {v}" for k, v in rows)


def _spread(values: Iterable[float | None]) -> dict[str, float | None]:
    known = [v for v in values if v is not None]
    if not known:
        return {"least": None, "median": None, "most": None}
    return {"least": min(known), "median": float(np.median(known)), "most": max(known)}


def _mean(values: Iterable[float | None]) -> float | None:
    known = [v for v in values if v is not None]
    return float(np.mean(known)) if known else None


def _cost(s: dict[str, Any], keys: tuple[str, ...]) -> str:
    return " / ".join(_number(s["cost"][key]) for key in keys)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


def _two(
    spread: dict[str, float | None], unit: str, which: tuple[str, str] = ("least", "median")
) -> str:
    return f"{_number(spread[which[0]])} / {_number(spread[which[1]])} {unit}"
