"""The head of a report: what happened, in a sentence and a few figures."""

from __future__ import annotations

import html
from collections.abc import Iterator
from typing import Any

_TICK_MS = 100  # period of a companion's tick


def head(summary: dict[str, Any], radius: float) -> str:
    """Return verdict and tiles of a flight with these metrics; radius: of a drone [m]."""
    if summary["ok"]:
        kind, word = "good", "OK"
        said = (
            f"{_drones(len(summary['targets_reached']))} reached all targets in "
            f"{summary['mission_time_s']:.1f} s and touched nothing{_among(summary)}."
        )
    else:
        kind, word, said = "bad", "FALLS SHORT", "; ".join(shortcomings(summary)) + "."
    tiles = "".join(
        f"<div>{what}<b>{value}</b><small>{more}</small></div>"
        for what, value, more in _tiles(summary, radius)
    )
    return (
        f"<p class='verdict {kind}'><b>{word}</b> <span>{html.escape(said)}</span></p>"
        f"<div class=tiles>{tiles}</div>"
    )


def shortcomings(s: dict[str, Any]) -> Iterator[str]:
    """Yield the reasons why a flight with these metrics fell short."""
    if s.get("interrupted"):
        yield "interrupted"
    if not s["mission_complete"]:
        late = [n for n, r in s["targets_reached"].items() if len(set(r.split("/"))) > 1]
        yield "targets missed by " + ", ".join(late)
    if s["agent_collisions"]:
        yield f"{s['agent_collisions']} pair(s) of drones collided"
    if s["obstacle_collisions"]:
        yield f"{s['obstacle_collisions']} drone(s) hit an obstacle"
    if s.get("ground_strikes"):
        yield f"{s['ground_strikes']} drone(s) struck the ground"
    if s["never_flew"]:
        yield "never flew: " + ", ".join(s["never_flew"])
    for name, code in s.get("companion_errors", {}).items():
        yield f"{name}'s companion ended with an error, exit {code}"
    yield from s["faults_in_truth"]


def _drones(count: int) -> str:
    return "The drone" if count == 1 else f"All {count} drones"


def _among(s: dict[str, Any]) -> str:
    foreign = len(s.get("foreign", []))
    return f", among {foreign} foreign drone{'s' * (foreign > 1)}" if foreign else ""


def _tiles(s: dict[str, Any], radius: float) -> Iterator[tuple[str, str, str]]:
    """Yield name, value and explanation of the figures that say most; times lead to the cursor."""
    done = [a.split("/") for a in s["targets_reached"].values()]
    reached = sum(a == b for a, b in done)
    yield "reached all targets", f"{reached} of {len(done)}", f"flown {s['duration_s']:.1f} s"
    for what, key, touch in (
        ("closest two drones", "min_agent_distance", 2 * radius),
        ("closest to an obstacle", "min_obstacle_distance", radius),
    ):
        if s[f"{key}_m"] is not None:
            time, *who = s[f"{key}_at"]
            names = html.escape(", ".join(who))
            more = f"<a href='#t={time:.1f}'>{time:.1f} s</a>, {names}; touch at {touch:.2f} m"
            yield what, f"{s[f'{key}_m']:.2f} m", more
    yield "speed while moving", f"{s['mean_speed_m_s']:.2f} m/s", f"± {s['std_speed_m_s']:.2f}"
    if (recall := s["perception"].get("recall")) is not None:
        right = s["perception"].get("precision")
        more = "of neighbours in view to 8 m" + (f"; {right:.1%} right" if right else "")
        yield "neighbours seen", f"{recall:.1%}", more
    if (slow := s["tick_ms"]["p99"]) is not None:
        late = f"{s['deadline_misses']} later than {_TICK_MS} ms"
        yield "tick, 99 of 100 within", f"{slow:.0f} ms", late
