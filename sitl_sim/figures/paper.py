"""Figures of a flight for papers, as vectors: as the paper's figures 6c, 6d, 7, 10 and 13."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from mavlink_bridge.shared.arrays import Vector
from sitl_sim.figures.belief import Beliefs
from sitl_sim.figures.belief_figures import chosen_times
from sitl_sim.figures.curves import (
    LIMIT,
    OBSTACLE,
    TARGET,
    bands,
    colours,
    rgb,
    shared_targets,
    stride,
)
from sitl_sim.recording.run_folder import Run

_WIDE = 7.16  # in, two columns of an IEEE page
_STYLE: Any = {
    "font.size": 8,
    "axes.linewidth": 0.6,
    "axes.titlesize": 8,
    "legend.fontsize": 7,
    "pdf.fonttype": 42,  # letters stay letters: journals refuse type 3
    "svg.fonttype": "none",
    "svg.hashsalt": "swarm-companion",  # the same flight, the same file
}


def write_figures(run: Run, folder: Path, kind: str) -> list[Path]:
    """Write the figures of a flight into a folder; kind: pdf, svg or png; return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    beliefs, times = Beliefs(run), chosen_times(run)
    with mpl.rc_context(_STYLE):
        made = {"flight": _flight(run)}
        if times:
            made["network"] = _panels(run, beliefs, times, _threats)
            made["plans"] = _panels(run, beliefs, times, _plans)
        paths = []
        for name, figure in made.items():
            path = folder / f"{name}.{kind}"
            figure.savefig(path, dpi=300, metadata=_metadata(run, kind))
            paths.append(path)
    return paths


def _metadata(run: Run, kind: str) -> dict[str, str | None]:
    """Return title and date (none, so that files can be compared) of a file."""
    commit = run.metrics.get("commit") or "unknown"
    title = f"{run.scenario.name}, seed {run.scenario.seed}, commit {commit}"
    dates = {"pdf": "CreationDate", "svg": "Date"}
    return {"Title": title} | ({dates[kind]: None} if kind in dates else {})


def _flight(run: Run) -> Figure:
    """Draw paths from above (a), and distances and speed over time (b, c, d)."""
    found = bands(run)
    figure = Figure(figsize=(_WIDE, 3.7), layout="constrained")
    grid = figure.add_gridspec(max(len(found), 1), 2, width_ratios=[1, 1.25])
    paths = figure.add_subplot(grid[:, 0])
    _map(paths, run)
    p = run.truth["position"][:: stride(run.truth)].astype(float)
    for i, (name, colour) in enumerate(zip(run.names, _rgb(len(run.names)), strict=True)):
        paths.plot(p[:, i, 0], p[:, i, 1], color=colour, lw=0.8, label=name)
        paths.plot(*p[0, i, :2], "o", color=colour, ms=2.5)
    paths.set(xlabel="east [m]", ylabel="north [m]", aspect="equal")
    paths.set_title("(a)", loc="left")
    paths.autoscale_view()
    if len(run.names) <= 10:
        below: Any = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.14)}
        paths.legend(ncols=4, frameon=False, handlelength=1.2, **below)
    first = None
    for row, (name, contact, band) in enumerate(found):
        axes = figure.add_subplot(grid[row, 1], sharex=first)
        first = first or axes
        low, high = band.mean - band.std, band.mean + band.std
        axes.fill_between(band.t, low, high, color="#1f77b4", alpha=0.2, lw=0, label="± 1 std")
        axes.plot(band.t, band.mean, color="#1f77b4", lw=1, label="mean")
        axes.plot(band.t, band.least, color="#ff7f0e", lw=0.8, label="least")
        if contact is not None:
            axes.axhline(contact, color=LIMIT, ls="--", lw=0.8, label="contact")
        axes.set_ylabel(name.replace(" drones", "\ndrones").replace(" obstacle", "\nobstacle"))
        axes.set_title(f"({'bcd'[row]})", loc="left")
        axes.set_ylim(bottom=0)
        axes.tick_params(labelbottom=row == len(found) - 1)
        if row == 0:
            axes.legend(ncols=4, frameon=False, loc="lower right", bbox_to_anchor=(1, 0.96))
    if first is not None:
        figure.axes[-1].set_xlabel("time [s]")
    return figure


def _panels(run: Run, beliefs: Beliefs, times: list[float], draw: Any) -> Figure:
    """Draw the swarm from above at some times, each with what `draw` adds."""
    figure = Figure(figsize=(_WIDE, 2.1), layout="constrained")
    for panel, time in enumerate(times):
        axes = figure.add_subplot(1, len(times), panel + 1)
        p = beliefs.positions(time)
        _map(axes, run)
        draw(axes, run, beliefs, time)
        axes.scatter(p[:, 0], p[:, 1], s=14, c=_rgb(len(p)), zorder=3)
        for name, place in zip(run.names, p, strict=True):
            axes.annotate(name.removeprefix("drone"), place[:2], (2, 2), textcoords="offset points")
        centre = p[:, :2].mean(axis=0)
        half = float(np.abs(p[:, :2] - centre).max()) + 3.0
        axes.set(xlim=centre[0] + np.array([-half, half]), ylim=centre[1] + np.array([-half, half]))
        axes.set(title=f"({'abcd'[panel]}) {time:.1f} s", aspect="equal", xlabel="east [m]")
        if panel == 0:
            axes.set_ylabel("north [m]")
    return figure


def _threats(axes: Any, run: Run, beliefs: Beliefs, time: float) -> None:
    """Draw an arrow to each critical neighbour; a wider one is a greater threat."""
    for i, at in enumerate(beliefs.positions(time)):
        belief = beliefs.at(i, time)
        for threat in belief.critical if belief else []:
            arrow = {"arrowstyle": "->", "color": "#c00000", "lw": 0.5 + min(threat.value, 1.5)}
            axes.annotate("", threat.position[:2], at[:2], arrowprops=arrow | {"shrinkA": 3})


def _plans(axes: Any, run: Run, beliefs: Beliefs, time: float) -> None:
    """Draw the trajectory that each companion planned."""
    for i, colour in enumerate(_rgb(len(run.names))):
        belief = beliefs.at(i, time)
        if belief is not None:
            axes.plot(belief.plan[:, 0], belief.plan[:, 1], color=colour, lw=1)


def _map(axes: Any, run: Run) -> None:
    """Draw obstacles and shared targets."""
    for c in run.world["cylinders"]:
        axes.add_patch(Circle((c["x"], c["y"]), c["radius"], color=OBSTACLE, lw=0))
    for b in run.world["boxes"]:
        low, high = np.array(b["min"][:2]), np.array(b["max"][:2])
        axes.add_patch(Rectangle(tuple(low), *(high - low), color=OBSTACLE, lw=0))
    for x, y, _ in shared_targets(run.world):
        reach = run.world["target_tolerance"]
        axes.add_patch(Circle((x, y), reach, fill=False, ec=TARGET, ls=":", lw=0.8))


def _rgb(count: int) -> Vector:
    """Return the drones' colours (count,3), 0…1."""
    return np.array([rgb(c) for c in colours(count)]) / 255
