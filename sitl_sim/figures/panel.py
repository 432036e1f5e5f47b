"""The flight on one cursor: map, cameras, curves and events; its script is `panel.js`."""

from __future__ import annotations

import base64
import html
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import plotly.graph_objects as go

from sitl_sim.figures.belief import Beliefs
from sitl_sim.figures.belief_figures import timeline
from sitl_sim.figures.camera_pictures import Pictures
from sitl_sim.figures.curves import colours, curves, stride, top_view
from sitl_sim.figures.events import Event
from sitl_sim.figures.metrics import AIRBORNE
from sitl_sim.figures.page import draw
from sitl_sim.recording.run_folder import Run

_PICTURES = 300  # of all cameras together: about 2 MB
_LEAST_PERIOD = 0.5  # s between pictures of one camera
_WIDTH = 320  # px of a picture
_QUALITY = 60  # of JPEG
_SPEEDS = ("0.25", "1", "2", "4", "10")


def panel(run: Run, beliefs: Beliefs, happened: list[Event], with_pictures: bool) -> str:
    """Return the part of the page that shows the flight at the cursor's time."""
    data = _paths(run)
    if with_pictures:
        data["pictures"] = _pictures(run, beliefs)
    speeds = "".join(f"<option{' selected' * (s == '2')}>{s}" for s in _SPEEDS)
    text = json.dumps(data, separators=(",", ":"))
    return (
        "<div id=flown><div class=controls><button id=play aria-label='play or pause'>▶</button>"
        "<input id=time type=range min=0 step=0.1 value=0 aria-label='time'>"
        f"<b id=shown></b><label>× <select id=speed>{speeds}</select></label></div>"
        f"<div class=two><figure>{draw(_map(run), 'map')}</figure>"
        f"<div>{_cameras(run, with_pictures)}<h3>Events</h3>{_events(happened)}</div></div>"
        f"{draw(_scrubbed(run, curves(run)), 'curves')}"
        f"{draw(_scrubbed(run, timeline(run, happened)), 'timeline')}"
        "<p class=hint>Move the time by the slider, the arrow keys, or in the curves; space plays. "
        "The address keeps it.</div>"
        f"<script type=application/json id=flight>{text}</script>"
        f"<script>{(Path(__file__).with_name('panel.js')).read_text('utf-8')}</script>"
    )


def _paths(run: Run) -> dict[str, Any]:
    """Return times [s], places [m] of each drone, and when the first is in the air."""
    step = stride(run.truth)
    t, p = run.truth["t"][::step], run.truth["position"][::step].astype(float)
    up = np.flatnonzero((p[..., 2] > AIRBORNE).any(axis=1))
    return {
        "t": t.round(2).tolist(),
        "x": p[..., 0].T.round(2).tolist(),
        "y": p[..., 1].T.round(2).tolist(),
        "start": float(t[up[len(up) // 2]]) if len(up) else 0.0,
    }


def _map(run: Run) -> go.Figure:
    """Return the flight from above, with a trace `now` that the cursor moves."""
    figure = top_view(run)
    count = len(run.names)
    figure.add_scatter(
        x=[None] * count,
        y=[None] * count,
        name="now",
        mode="markers+text",
        text=[n.removeprefix("drone") for n in run.names],
        textposition="top center",
        showlegend=False,
        marker={"color": colours(count), "size": 12, "line": {"color": "white", "width": 1.5}},
    )
    return figure


def _scrubbed(run: Run, figure: go.Figure) -> go.Figure:
    """Return a figure in which a pointer moves the cursor, over the common axis of time."""
    first, last = float(run.truth["t"][0]), float(run.truth["t"][-1])
    figure.update_layout(dragmode=False, margin={"l": 80, "r": 20})
    figure.update_xaxes(range=[first - 0.01 * (last - first), last], fixedrange=True)
    figure.update_yaxes(fixedrange=True)
    return figure


def _cameras(run: Run, with_pictures: bool) -> str:
    if not with_pictures:
        return (
            "<h3>Cameras</h3><p>Left out, as in every campaign; "
            f"<code>sitl-sim report {html.escape(run.folder.name)}</code> adds the pictures."
        )
    tiles = "".join(
        f"<figure style='border-color:{colour}'><img alt='camera of {html.escape(name)}'>"
        f"<figcaption>{html.escape(name)}</figcaption></figure>"
        for name, colour in zip(run.names, colours(len(run.names)), strict=True)
    )
    return (
        "<h3>Cameras, <span id=taken></span></h3>"
        f"<div id=cameras>{tiles}</div><p class=hint>Rendered from the truth; rings: what the "
        "companion found, green drones, orange obstacles, with distances [m]."
    )


def _pictures(run: Run, beliefs: Beliefs) -> dict[str, Any]:
    """Return times [s], and of each camera the pictures of those times as base64 of JPEG."""
    t = run.truth["t"]
    wanted = max(_PICTURES // len(run.names), 1)
    period = max(np.ceil((t[-1] - t[0]) / wanted / _LEAST_PERIOD), 1.0) * _LEAST_PERIOD
    times = np.arange(t[0], t[-1] + 1e-9, period)
    renderer = Pictures(run.scenario, run.world)
    scale = _WIDTH / run.scenario.sensing.width
    p, q = (run.truth[k].astype(float) for k in ("position", "attitude"))
    jpeg: list[list[str]] = [[] for _ in run.names]
    for time in times:
        k = min(int(np.searchsorted(t, time)), len(t) - 1)
        for i, made in enumerate(jpeg):
            image = renderer.take(p[k], q[k], i, beliefs.at(i, float(time)), scale)
            _, coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
            made.append(base64.b64encode(coded.tobytes()).decode())
    return {"t": times.round(2).tolist(), "jpeg": jpeg}


def _events(happened: list[Event]) -> str:
    """Return the events as rows that lead to their time."""
    rows = "".join(
        f"<tr data-t={e.time:.2f} class={e.kind}><td><a href='#t={max(e.time, 0.0):.1f}'>"
        f"{e.time:.1f} s</a><td>{html.escape(e.drone)}<td>{html.escape(e.text)}"
        for e in happened
    )
    return f"<div id=events><table>{rows}</table></div>"
