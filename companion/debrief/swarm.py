"""The flights of a swarm, debriefed together."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from companion.debrief.flight import Event, Flight, read_flight
from mavlink_bridge.shared.mcap_file import LogError

_LINES = 12  # most guard events and others that a table tells of one drone


def debrief(logs: Iterable[Path]) -> tuple[list[Flight], list[str]]:
    """Return the flights of the logs, and the problems of those that cannot be read."""
    flights, problems = [], []
    for log in logs:
        try:
            flights.append(read_flight(log))
        except LogError as error:
            problems.append(str(error))
    return flights, problems


def row(f: Flight) -> dict[str, str]:
    """Return the cells of a flight's row, by the names of their columns."""
    a = f.approach
    closest = "–" if a is None else f"{a.distance:.2f} m at {a.time:.1f} s (±{a.sigma:.2f})"
    if a is not None and not a.seen:
        closest += ", out of sight"
    trunk = "–" if f.trunk is None else f"{f.trunk[0]:.2f} m at {f.trunk[1]:.1f} s"
    tick = f.stages.get("tick")
    end = f.phases[-1].what if f.phases else "–"
    return {
        "drone": f.name,
        "flown": f"{f.flown:.0f} of {f.seconds:.0f} s",
        "ends": end if f.whole else f"{end}, log cut off",
        "goals": f"{f.goals[0]} of {f.goals[1]}",
        "closest drone": closest,
        "closest trunk": trunk,
        "guard": "plan only" if f.quiet else _counted(len(interventions(f))),
        "tick p99": "–" if tick is None else f"{tick[1]:.1f} ms",
    }


def _counted(n: int) -> str:
    return f"{n} intervention" + "s" * (n != 1)


def interventions(f: Flight) -> list[Event]:
    """Return the times in which the guard did not let the plan fly."""
    return [e for e in f.guard if e.what != "plan"]


def text(flights: list[Flight]) -> str:
    """Return the debriefing as a table, with the events and estimates of each flight below it."""
    rows = [row(f) for f in flights]
    names = list(rows[0]) if rows else []
    widths = [max(len(n), *(len(r[n]) for r in rows)) for n in names]
    cells = [names, *([r[n] for n in names] for r in rows)]
    lines = [
        "  ".join(c.ljust(w) for c, w in zip(line, widths, strict=True)).rstrip() for line in cells
    ]
    for f in flights:
        lines += ["", f"{f.name}  {f.path}"]
        told = sorted(
            [
                *(Event(e.time, e.seconds, f"guard: {e.what}") for e in interventions(f)),
                *f.events,
                *(Event(e.time, e.seconds, f"phase: {e.what}") for e in f.phases),
            ],
            key=lambda e: e.time,
        )
        lines += [f"  {e.time:7.1f} s  {e.seconds:6.1f} s  {e.what}" for e in told[:_LINES]]
        if len(told) > _LINES:
            lines.append(f"  … and {len(told) - _LINES} more; --html shows all")
        lines += [f"  {name}: {value}" for name, value in f.estimates.items()]
        stages = ", ".join(f"{n} {t[1]:.1f}" for n, t in f.stages.items())
        lines.append(f"  stages p99: {stages} ms")
    return "\n".join(lines)
