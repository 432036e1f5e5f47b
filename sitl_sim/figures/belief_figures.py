"""Figures from the companions' logs: network, plans, times, perception, events."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from mavlink_bridge.shared.arrays import Vector
from sitl_sim.figures.belief import Beliefs
from sitl_sim.figures.curves import add_map, colours, window
from sitl_sim.figures.events import Event, faults
from sitl_sim.figures.metrics import AIRBORNE
from sitl_sim.figures.perception import FrameScore
from sitl_sim.recording.run_folder import Run, ours

_SYMBOLS = {
    "fault": "hexagram",
    "phase": "circle",
    "target": "star",
    "guard": "triangle-up",
    "deadline": "line-ns-open",
    "silence": "square",
    "vehicle": "diamond-open",
    "collision": "x",
}


def chosen_times(run: Run) -> list[float]:
    """Return four times [s]: a quarter, a half, three quarters, and the closest approach."""
    t, p = run.truth["t"], run.truth["position"].astype(float)
    up = np.flatnonzero((p[..., 2] > AIRBORNE).any(axis=1))
    if not len(up):
        return []
    first, last = t[up[0]], t[up[-1]]
    times = [float(first + s * (last - first)) for s in (0.25, 0.5, 0.75)]
    flying = p[..., 2] > AIRBORNE
    apart = np.linalg.norm(p[:, :, None] - p[:, None], axis=-1)
    apart[~(flying[:, :, None] & flying[:, None])] = np.inf
    apart[:, *np.diag_indices(p.shape[1])] = np.inf
    foreign = ~ours(run.world, run.names)
    apart[:, foreign[:, None] & foreign] = np.inf
    if np.isfinite(apart).any():
        times.append(float(t[np.unravel_index(int(apart.argmin()), apart.shape)[0]]))
    return sorted(times)


def network(run: Run, beliefs: Beliefs, times: list[float]) -> go.Figure:
    """Draw the network of critical neighbours; a wider line is a greater threat (Fig. 6c)."""
    figure, arrows = _panels(run, beliefs, times), []
    for panel, time in enumerate(times, start=1):
        for i in range(len(run.names)):
            belief = beliefs.at(i, time)
            a = beliefs.positions(time)[i]
            for threat in belief.critical if belief else []:
                b, x, y = threat.position, f"x{panel}", f"y{panel}"
                arrows.append(
                    {
                        "x": b[0],
                        "y": b[1],
                        "ax": a[0],
                        "ay": a[1],
                        "xref": x,
                        "yref": y,
                        "axref": x,
                        "ayref": y,
                        "showarrow": True,
                        "arrowhead": 2,
                        "arrowwidth": 1 + 2 * min(threat.value, 1.5),
                        "text": "",
                        "arrowcolor": "rgba(200,0,0,0.6)",
                        "standoff": 4,
                        "startstandoff": 4,
                    }
                )
    figure.layout.annotations += tuple(map(go.layout.Annotation, arrows))
    return figure


def plans(run: Run, beliefs: Beliefs, times: list[float]) -> go.Figure:
    """Draw the trajectories that the companions predicted (Fig. 6d)."""
    figure = _panels(run, beliefs, times)
    for column, time in enumerate(times):
        for i, colour in enumerate(colours(len(run.names))):
            belief = beliefs.at(i, time)
            if belief is not None:
                figure.add_scatter(
                    x=belief.plan[:, 0],
                    y=belief.plan[:, 1],
                    mode="lines",
                    line_color=colour,
                    row=1,
                    col=column + 1,
                )
    return figure


def _panels(run: Run, beliefs: Beliefs, times: list[float]) -> go.Figure:
    """Return a figure with a square map of the swarm at each time."""
    figure = make_subplots(
        rows=1,
        cols=len(times),
        horizontal_spacing=0.04,
        subplot_titles=[f"t = {t:.1f} s" for t in times],
    )
    for column, time in enumerate(times):
        p = beliefs.positions(time)
        numbers = [n.removeprefix("drone") for n in run.names]
        add_map(figure, run.world, row=1, col=column + 1)
        figure.add_scatter(
            x=p[:, 0],
            y=p[:, 1],
            mode="markers+text",
            text=numbers,
            textposition="top center",
            row=1,
            col=column + 1,
            marker={"color": colours(len(p)), "size": 8},
        )
        centre = p[:, :2].mean(axis=0)
        half = float(np.abs(p[:, :2] - centre).max()) + 3.0
        window(figure, column + 1, centre, half)
    figure.update_layout(height=420, margin={"l": 40, "r": 10, "t": 30, "b": 30}, showlegend=False)
    return figure


def times(run: Run) -> go.Figure:
    """Draw histograms of solve and tick times, over all drones."""
    ticks = [r for log in run.logs.values() for r in log]
    series = {
        "solve": [r["solver"]["solve_ms"] for r in ticks if "solver" in r],
        "tick": [r["stages_ms"]["tick"] for r in ticks if "tick" in r["stages_ms"]],
    }
    figure = make_subplots(rows=1, cols=2, subplot_titles=[f"{k} time [ms]" for k in series])
    for column, values in enumerate(series.values()):
        counts, edges = np.histogram(values or [0.0], bins=60)
        figure.add_bar(
            x=edges[:-1].round(2), y=counts, width=np.diff(edges), offset=0, row=1, col=column + 1
        )
    figure.update_yaxes(type="log", title="ticks")
    figure.update_layout(height=320, margin={"l": 60, "r": 10, "t": 30, "b": 30}, showlegend=False)
    return figure


def perception(scores: dict[str, list[FrameScore]]) -> go.Figure:
    """Draw recall, precision, and errors of bearing, range and velocity, a point each second."""
    every = [s for one in scores.values() for s in one]
    titles = ("share", "bearing [°]", "range [%]", "velocity [m/s]")
    figure = make_subplots(rows=4, cols=1, shared_xaxes=True, vertical_spacing=0.04)
    seconds: dict[int, list[FrameScore]] = {}
    for s in every:
        seconds.setdefault(int(s.time), []).append(s)
    x = sorted(seconds)
    lines = [
        (1, "recall", [_ratio(seconds[k], "found", "in_view") for k in x]),
        (1, "precision", [_ratio(seconds[k], "right", "detections") for k in x]),
        (2, "bearing, median", [_median([np.degrees(s.bearing) for s in seconds[k]]) for k in x]),
        (
            3,
            "range, median of size",
            [_median([np.abs(s.range_error) * 100 for s in seconds[k]]) for k in x],
        ),
        (
            4,
            "velocity, rms",
            [_rms([np.linalg.norm(s.velocity, axis=1) for s in seconds[k]]) for k in x],
        ),
    ]
    for row, name, values in lines:
        figure.add_scatter(x=x, y=values, name=name, mode="lines", row=row, col=1)
    for row, title in enumerate(titles):
        figure.update_yaxes(title=title, row=row + 1)
    figure.update_xaxes(title="time [s]", row=4)
    figure.update_layout(
        height=640,
        margin={"l": 60, "r": 10, "t": 10, "b": 40},
        legend={"orientation": "h", "y": 1.05},
    )
    return figure


def timeline(run: Run, happened: list[Event]) -> go.Figure:
    """Draw each drone's events on a line, and the scenario's faults as bars."""
    figure = go.Figure()
    for span in faults(run):
        figure.add_scatter(
            x=[span.start, span.end],
            y=[span.drone] * 2,
            mode="lines",
            showlegend=False,
            line={"color": "rgba(200,0,0,0.25)", "width": 16},
            text=span.text,
            hovertemplate="%{x:.1f} s: %{text}<extra></extra>",
        )
    for kind, symbol in _SYMBOLS.items():
        some = [e for e in happened if e.kind == kind]
        if some:
            figure.add_scatter(
                x=[e.time for e in some],
                y=[e.drone for e in some],
                mode="markers",
                name=kind,
                text=[e.text for e in some],
                hovertemplate="%{x:.1f} s: %{text}",
                marker={"symbol": symbol, "size": 9},
            )
    figure.update_yaxes(categoryorder="array", categoryarray=run.names[::-1])
    figure.update_xaxes(title="time [s]")
    figure.update_layout(
        height=120 + 26 * len(run.names),
        legend={"orientation": "h"},
        margin={"l": 60, "r": 10, "t": 10, "b": 40},
    )
    return figure


def _ratio(scores: list[FrameScore], part: str, whole: str) -> float | None:
    total = sum(getattr(s, whole) for s in scores)
    return sum(getattr(s, part) for s in scores) / total if total else None


def _median(values: list[Vector]) -> float | None:
    every = np.concatenate(values)
    return float(np.median(every)) if len(every) else None


def _rms(values: list[Vector]) -> float | None:
    every = np.concatenate(values)
    return float(np.sqrt((every**2).mean())) if len(every) else None
