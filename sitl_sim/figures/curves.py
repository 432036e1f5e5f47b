"""The paper's figures of one flight, from its truth: trajectories, top view, curves over time."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.colors import qualitative, sample_colorscale
from plotly.subplots import make_subplots

from mavlink_bridge.shared.arrays import Vector
from sitl_sim.figures.metrics import AIRBORNE
from sitl_sim.recording.run_folder import Run, Truth, ours
from sitl_sim.worlds.world import surface_distance

OBSTACLE, TARGET, LIMIT = "#9c8567", "#d00000", "#b00000"
_STEP = 0.2  # s between drawn points
_SIDES = 24  # of a drawn cylinder


def colours(count: int) -> list[str]:
    """Return a colour for each drone, the same in every figure."""
    if count <= len(qualitative.D3):
        return list(qualitative.D3[:count])
    return list(sample_colorscale("hsv", np.linspace(0.0, 0.95, count)))


def rgb(colour: str) -> tuple[int, ...]:
    """Return `#rrggbb` or `rgb(r, g, b)` as numbers 0…255."""
    if colour.startswith("#"):
        return tuple(bytes.fromhex(colour[1:]))
    return tuple(int(float(part)) for part in colour[4:-1].split(","))


def stride(truth: Truth) -> int:
    """Return the number of truth samples between two drawn points."""
    return (
        max(round(_STEP / float(np.median(np.diff(truth["t"])))), 1) if len(truth["t"]) > 1 else 1
    )


def top_view(run: Run) -> go.Figure:
    """Draw all trajectories from above, with obstacles, starts and targets (Fig. 7a)."""
    figure = go.Figure()
    add_map(figure, run.world, legend=True)
    p = run.truth["position"][:: stride(run.truth)].astype(float).round(3)
    for i, (name, colour) in enumerate(zip(run.names, colours(p.shape[1]), strict=True)):
        figure.add_scatter(
            x=p[:, i, 0],
            y=p[:, i, 1],
            name=name,
            mode="lines",
            line={"color": colour, "width": 1.5},
        )
        figure.add_scatter(
            x=p[:1, i, 0],
            y=p[:1, i, 1],
            mode="markers",
            showlegend=False,
            marker={"color": colour, "size": 7},
            hoverinfo="skip",
        )
    return square(figure, 560)


def add_map(figure: go.Figure, world: dict[str, Any], legend: bool = False, **place: Any) -> None:
    """Add obstacles and shared targets from above; place: row and col of a subplot.

    They are one trace, because a shape for each makes large forests slow.
    """
    outlines = [_circle(c["x"], c["y"], c["radius"]) for c in world["cylinders"]]
    for b in world["boxes"]:
        (x0, y0, _), (x1, y1, _) = b["min"], b["max"]
        outlines.append(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]))
    x, y = _joined(outlines)
    figure.add_scatter(
        x=x,
        y=y,
        mode="lines",
        fill="toself",
        fillcolor=OBSTACLE,
        line_width=0,
        hoverinfo="skip",
        name="obstacles",
        showlegend=legend and bool(outlines),
        **place,
    )
    reach = world["target_tolerance"]
    x, y = _joined([_circle(x, y, reach) for x, y, _ in shared_targets(world)])
    figure.add_scatter(
        x=x,
        y=y,
        mode="lines",
        hoverinfo="skip",
        name="targets",
        showlegend=legend,
        line={"color": TARGET, "width": 1, "dash": "dot"},
        **place,
    )


def _circle(x: float, y: float, radius: float) -> Vector:
    angle = np.linspace(0, 2 * np.pi, _SIDES + 1)
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])


def _joined(outlines: list[Vector]) -> tuple[Vector, Vector]:
    """Return many outlines as x and y, with gaps between them."""
    gap = np.full((1, 2), np.nan)
    every = np.vstack([part for outline in outlines for part in (outline, gap)] or [gap])
    x, y = every.round(2).T
    return x, y


def shared_targets(world: dict[str, Any]) -> list[tuple[float, ...]]:
    """Return the targets of all drones without their last, which is their own home."""
    return sorted(
        {tuple(t) for targets in world["targets"].values() for t in targets[:-1] or targets}
    )


def square(figure: go.Figure, height: int) -> go.Figure:
    """Give both axes equal scales and their names; return the figure."""
    figure.update_layout(
        height=height, margin={"l": 40, "r": 10, "t": 30, "b": 40}, legend={"orientation": "h"}
    )
    figure.update_xaxes(title="east [m]", constrain="domain")
    figure.update_yaxes(title="north [m]", scaleanchor="x")
    return figure


def window(figure: go.Figure, column: int, centre: Vector, half: float) -> None:
    """Show `half` [m] around `centre` in one subplot of a row."""
    figure.update_xaxes(range=[centre[0] - half, centre[0] + half], row=1, col=column)
    figure.update_yaxes(
        range=[centre[1] - half, centre[1] + half], row=1, col=column, scaleanchor=f"x{column}"
    )


def trajectories(run: Run) -> go.Figure:
    """Draw the flight in three dimensions (Fig. 6a)."""
    figure = go.Figure()
    p = run.truth["position"][:: stride(run.truth)].astype(float).round(3)
    for i, (name, colour) in enumerate(zip(run.names, colours(p.shape[1]), strict=True)):
        figure.add_scatter3d(
            x=p[:, i, 0],
            y=p[:, i, 1],
            z=p[:, i, 2],
            name=name,
            mode="lines",
            line={"color": colour, "width": 4},
        )
    top = float(p[..., 2].max()) + 2.0
    if run.world["cylinders"]:
        figure.add_trace(_trunks(run.world["cylinders"], top))
    for b in run.world["boxes"]:
        figure.add_trace(_box(b))
    targets = np.array(shared_targets(run.world)).reshape(-1, 3)
    figure.add_scatter3d(
        x=targets[:, 0],
        y=targets[:, 1],
        z=targets[:, 2],
        mode="markers",
        name="targets",
        marker={"color": TARGET, "size": 5},
    )
    figure.update_layout(
        height=720,
        margin={"l": 0, "r": 0, "t": 0, "b": 0},
        legend={"orientation": "h"},
        scene={
            "aspectmode": "data",
            "xaxis_title": "east [m]",
            "yaxis_title": "north [m]",
            "zaxis_title": "up [m]",
        },
    )
    return figure


def _trunks(cylinders: list[dict[str, float]], top: float) -> go.Mesh3d:
    """Return all trunks as one mesh, drawn up to `top` [m]."""
    angle = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points, faces = [], []
    for n, c in enumerate(cylinders):
        flat = ring * c["radius"] + [c["x"], c["y"]]
        for z in (0.0, min(c["height"], top)):
            points.append(np.column_stack([flat, np.full(_SIDES, z)]))
        low = np.arange(_SIDES) + 2 * n * _SIDES
        following = np.roll(low, -1)
        faces.append(np.stack([low, following, low + _SIDES], axis=1))
        faces.append(np.stack([following, following + _SIDES, low + _SIDES], axis=1))
    x, y, z = np.concatenate(points).round(2).T
    i, j, k = np.concatenate(faces).T
    return go.Mesh3d(x=x, y=y, z=z, i=i, j=j, k=k, color=OBSTACLE, opacity=0.5, hoverinfo="skip")


def _box(box: dict[str, list[float]]) -> go.Mesh3d:
    corners = np.array(list(itertools.product(*zip(box["min"], box["max"], strict=True))))
    x, y, z = corners.T
    return go.Mesh3d(x=x, y=y, z=z, alphahull=0, color=OBSTACLE, opacity=0.5, hoverinfo="skip")


def curves(run: Run) -> go.Figure:
    """Draw mean ± std of distances between drones and to obstacles, and of speed (Fig. 7b-d)."""
    found = bands(run)
    rows = max(len(found), 1)
    figure = make_subplots(rows=rows, cols=1, shared_xaxes=True, vertical_spacing=0.04)
    for row, (name, contact, shown) in enumerate(found, start=1):
        _draw_band(figure, row, shown)
        figure.update_yaxes(title=name, row=row)
        if contact is not None:
            line = {"color": LIMIT, "dash": "dash"}
            figure.add_hline(contact, row=row, line=line, name="contact", showlegend=row == 1)
    figure.update_xaxes(title="time [s]", row=rows)
    figure.update_layout(
        height=60 + 170 * rows,
        margin={"l": 60, "r": 10, "t": 10, "b": 40},
        legend={"orientation": "h", "y": 1.06},
    )
    return figure


def pair_distances(
    p: Vector, flying: NDArray[np.bool_], own: NDArray[np.bool_]
) -> tuple[Vector, NDArray[np.bool_]]:
    """Return the distance (T,pairs) m of each two drones, and whether both were in the air.

    own: (N,) which drones are ours; of two foreign ones there is none.
    """
    pairs = np.array(list(itertools.combinations(range(p.shape[1]), 2)), int).reshape(-1, 2)
    a, b = pairs[own[pairs].any(axis=1)].T
    return np.linalg.norm(p[:, a] - p[:, b], axis=-1), flying[:, a] & flying[:, b]


@dataclass(frozen=True)
class Band:
    """A quantity over the swarm: times (n,) s; mean, standard deviation and least, each (n,)."""

    t: Vector
    mean: Vector
    std: Vector
    least: Vector


def band(t: Vector, values: Vector, valid: NDArray[np.bool_]) -> Band | None:
    """Return a band of values (T,k) over their valid columns, a point each `_STEP`; None: none."""
    some = np.flatnonzero(valid.any(axis=1))
    if not len(some):
        return None
    masked = np.ma.masked_array(values, ~valid)[some]
    starts = np.arange(0, len(some), max(round(_STEP / float(np.median(np.diff(t)))), 1))
    mean, std = (np.asarray(a)[starts] for a in (masked.mean(axis=1), masked.std(axis=1)))
    least = np.minimum.reduceat(masked.min(axis=1).filled(np.inf), starts)
    return Band(t[some][starts].round(2), mean, std, least)


def bands(run: Run) -> list[tuple[str, float | None, Band]]:
    """Return name, contact [m] or None, and band of our distances and speed, those that exist."""
    t, p = run.truth["t"], run.truth["position"].astype(float)
    flying, radius = p[..., 2] > AIRBORNE, run.world["drone_radius"]
    own = ours(run.world, run.names)
    found = [("between drones [m]", 2 * radius, band(t, *pair_distances(p, flying, own)))]
    p, flying = p[:, own], flying[:, own]
    if run.world["cylinders"] or run.world["boxes"]:
        surface = surface_distance(p, run.world)
        found.append(("to nearest obstacle [m]", radius, band(t, surface, flying)))
    speed = np.linalg.norm(run.truth["velocity"][:, own].astype(float), axis=-1)
    found.append(("speed [m/s]", None, band(t, speed, flying)))
    return [(name, contact, b) for name, contact, b in found if b is not None]


def _draw_band(figure: go.Figure, row: int, shown: Band) -> None:
    """Draw mean ± std and least."""
    low, high = shown.mean - shown.std, shown.mean + shown.std
    for y, fill in ((low, None), (high, "tonexty")):
        figure.add_scatter(
            x=shown.t,
            y=y.round(3),
            mode="lines",
            line_width=0,
            fill=fill,
            row=row,
            col=1,
            fillcolor="rgba(31,119,180,0.2)",
            hoverinfo="skip",
            name="± 1 standard deviation",
            showlegend=row == 1 and fill is not None,
        )
    lines = (
        ("mean over the swarm", shown.mean, 2, "#1f77b4"),
        ("least", shown.least, 1, "#ff7f0e"),
    )
    for name, y, width, colour in lines:
        figure.add_scatter(
            x=shown.t,
            y=y.round(3),
            line={"color": colour, "width": width},
            name=name,
            legendgroup=name,
            showlegend=row == 1,
            row=row,
            col=1,
        )
