"""The report of a benchmark as text: its figures and their goals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Goal:
    """A figure with its goal, an upper limit; up to `floor`, if any, it is accepted."""

    name: str
    value: float
    goal: float
    floor: float | None = None

    @property
    def verdict(self) -> str:
        """Return `reached`, `accepted` or `missed`."""
        if self.value <= self.goal:
            return "reached"
        return "accepted" if self.floor is not None and self.value <= self.floor else "missed"


def goals(report: dict[str, Any]) -> Iterator[Goal]:
    """Yield the figures of a report that have a goal."""
    solvers = report["solvers"]
    for name in ("rti", "rti-vm"):
        if name in solvers:
            yield from _of_real_time(name, solvers)


def _of_real_time(name: str, solvers: dict[str, Any]) -> Iterator[Goal]:
    row = solvers[name]
    compiled = row["backend"] == "compiled"
    if compiled:
        for other, goal, floor in (("ipopt-sx", 1 / 10, 1 / 5), ("ipopt-mx", 1 / 80, 1 / 40)):
            if other in solvers:
                ratio = row["warm_ms"]["p99"] / solvers[other]["warm_ms"]["p99"]
                yield Goal(f"{name}: p99 over that of {other}", ratio, goal, floor)
    yield Goal(f"{name}: median [ms]", row["warm_ms"]["p50"], 1.0 if compiled else 2.5)
    if "endurance" in row:
        times = row["endurance"]
        yield Goal(f"{name}: largest over median", times["max"] / times["p50"], 3.0, 5.0)
    yield from _of_plans(name, row)


def _of_plans(name: str, row: dict[str, Any]) -> Iterator[Goal]:
    worse = row["worse_percent_by_flight"]
    worst = f"{name}: worse than the optimum [%]"
    if "forest" in worse:
        yield Goal(f"{worst}, forest, median", worse["forest"]["p50"], 0.05)
        yield Goal(f"{worst}, forest, p99", worse["forest"]["p99"], 0.7, 1.5)
    if "crossing" in worse:
        yield Goal(f"{worst}, crossing, p99", worse["crossing"]["p99"], 2.0, 6.0)
        yield Goal(f"{worst}, crossing, max", worse["crossing"]["max"], 10.0)
    yield Goal(f"{name}: plans out of bounds [%]", 100.0 * (1.0 - row["within_bounds"]), 0.0)


def table(report: dict[str, Any]) -> str:
    """Return a report as text."""
    parts = [_figures(report), _endurance(report), _worse(report), _goals(report)]
    return "\n\n".join(part for part in parts if part)


def _figures(report: dict[str, Any]) -> str:
    lines = [
        f"{report['instances']} instances; ms of the whole call, warm (cold: first of a sequence)",
        f"{'solver':<10}{'p50':>9}{'p95':>9}{'p99':>9}{'max':>9}{'cold p50':>10}{'max':>9}"
        f"{'success':>9}{'in bounds':>11}{'slack m':>9}{'p99 ratio':>11}{'MB':>6}",
    ]
    for name, row in report["solvers"].items():
        w, c = row["warm_ms"], row["cold_ms"]
        lines.append(
            f"{name:<10}{w['p50']:9.2f}{w['p95']:9.2f}{w['p99']:9.2f}{w['max']:9.2f}"
            f"{c['p50']:10.2f}{c['max']:9.2f}{row['success']:9.3f}{row['within_bounds']:11.3f}"
            f"{row['deepest_intrusion_m']:9.2f}{row['ratio_p99']:11.1f}{row['memory_mb']:6.0f}"
        )
    return "\n".join(lines)


def _endurance(report: dict[str, Any]) -> str:
    lines = []
    for name, row in report["solvers"].items():
        if "endurance" in row:
            found = row["endurance"]
            numbers = "".join(f"{found[p]:9.2f}" for p in ("p50", "p95", "p99", "max"))
            lines.append(f"{name:<10}{numbers}{found['ticks']:9}{found['growth_mb']:10.1f}")
    head = f"{'on end, ms':<10}{'p50':>9}{'p95':>9}{'p99':>9}{'max':>9}{'ticks':>9}{'MB more':>10}"
    return "\n".join([head, *lines]) if lines else ""


def _worse(report: dict[str, Any]) -> str:
    lines = []
    for name, row in report["solvers"].items():
        for flight, gap in sorted(row.get("worse_percent_by_flight", {}).items()):
            numbers = "".join(f"{gap[p]:9.3f}" for p in ("p50", "p95", "p99", "max"))
            lines.append(f"{name:<10}{flight:<12}{numbers}")
    head = f"{'worse %':<22}{'p50':>9}{'p95':>9}{'p99':>9}{'max':>9}"
    return "\n".join([head, *lines]) if lines else ""


def _goals(report: dict[str, Any]) -> str:
    lines = [f"{g.name:<52}{g.value:10.4f}{g.goal:10.4f}  {g.verdict}" for g in goals(report)]
    head = f"{'figure':<52}{'is':>10}{'goal':>10}"
    return "\n".join([head, *lines]) if lines else ""
