"""The ten seconds before a collision: paths, distances, and what each companion believed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from mavlink_bridge.shared.arrays import Vector
from sitl_sim.figures.belief import Beliefs
from sitl_sim.figures.curves import LIMIT, add_map, colours, square, stride, window
from sitl_sim.figures.events import Collision
from sitl_sim.recording.run_folder import Run
from sitl_sim.worlds.world import surface_distance

_BEFORE, _AFTER = 10.0, 1.0  # s shown
_AROUND = 6.0  # m shown
_OTHER = 3.0  # m: a track farther away than this belongs to another drone
Indices = NDArray[np.int_]
Curve = tuple[str, list[float | None]]


def collision(run: Run, beliefs: Beliefs, crash: Collision) -> go.Figure:
    """Draw a collision from above, and distance and estimation errors over time."""
    t = run.truth["t"]
    shown = np.flatnonzero((t >= crash.time - _BEFORE) & (t <= crash.time + _AFTER))
    drawn = shown[:: stride(run.truth)]
    figure = make_subplots(rows=1, cols=2, column_widths=[0.45, 0.55])
    _paths(figure, run, crash, drawn)
    curves = _with_drone if crash.other is not None else _with_obstacle
    for n, (name, values) in enumerate(curves(run, beliefs, crash, drawn)):
        figure.add_scatter(
            x=t[drawn],
            y=values,
            mode="lines",
            name=name,
            row=1,
            col=2,
            line_dash="dot" if n else "solid",
        )
    figure.update_xaxes(title="time [s]", row=1, col=2)
    figure.update_yaxes(title="m", scaleanchor=None, range=[0, 5], row=1, col=2)
    figure.add_vline(crash.time, line={"color": LIMIT, "dash": "dash"}, row=1, col=2)
    return figure


def _paths(figure: go.Figure, run: Run, crash: Collision, drawn: Indices) -> None:
    """Draw the paths of all drones near the place; those that collide are bold."""
    t, p = run.truth["t"], run.truth["position"].astype(float)
    place = p[np.searchsorted(t, crash.time), crash.drone, :2]
    add_map(figure, run.world, row=1, col=1)
    for i, (name, colour) in enumerate(zip(run.names, colours(len(run.names)), strict=True)):
        if np.linalg.norm(p[drawn, i, :2] - place, axis=1).min() > _AROUND:
            continue
        width = 3 if i in (crash.drone, crash.other) else 1
        figure.add_scatter(
            x=p[drawn, i, 0],
            y=p[drawn, i, 1],
            name=name,
            mode="lines+markers",
            line={"color": colour, "width": width},
            marker_size=3,
            text=[f"{a:.1f} s" for a in t[drawn]],
            row=1,
            col=1,
        )
    square(figure, 460)
    window(figure, 1, place, _AROUND)


def _with_drone(run: Run, beliefs: Beliefs, crash: Collision, drawn: Indices) -> Iterator[Curve]:
    """Yield the distance between the two drones, and the error of each one's nearest track."""
    t, p = run.truth["t"], run.truth["position"].astype(float)
    a, b = crash.drone, crash.other
    assert b is not None
    yield "distance", _rounded(np.linalg.norm(p[drawn, a] - p[drawn, b], axis=1))
    for me, other in ((a, b), (b, a)):
        errors = [_track_error(beliefs, me, other, float(time)) for time in t[drawn]]
        yield f"{run.names[me]}'s error about {run.names[other]}", errors


def _with_obstacle(run: Run, beliefs: Beliefs, crash: Collision, drawn: Indices) -> Iterator[Curve]:
    """Yield the distance to the nearest surface, true and as the companion believed."""
    t, p = run.truth["t"], run.truth["position"].astype(float)
    yield "distance to the surface", _rounded(surface_distance(p[drawn, crash.drone], run.world))
    believed = [_believed_surface(beliefs, crash.drone, float(time)) for time in t[drawn]]
    yield f"as {run.names[crash.drone]} believed", believed


def _track_error(beliefs: Beliefs, me: int, other: int, time: float) -> float | None:
    """Return the error of the track nearest to the other drone [m]; None where none is near."""
    belief = beliefs.at(me, time)
    if belief is None or not len(belief.tracks):
        return None
    gap = float(np.linalg.norm(belief.tracks - beliefs.positions(time)[other], axis=1).min())
    return round(gap, 3) if gap < _OTHER else None


def _believed_surface(beliefs: Beliefs, drone: int, time: float) -> float | None:
    """Return the distance [m] to the nearest trunk that the companion believed in, or None."""
    belief = beliefs.at(drone, time)
    if belief is None or "own" not in belief.record or not belief.record["cylinders"]:
        return None
    c, own = np.array(belief.record["cylinders"]), np.array(belief.record["own"]["p"])
    return round(float((np.linalg.norm(c[:, :2] - own[:2], axis=1) - c[:, 2]).min()), 3)


def _rounded(values: Vector) -> list[float | None]:
    return [round(float(v), 3) for v in values]
