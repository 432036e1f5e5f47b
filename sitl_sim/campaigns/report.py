"""campaign.html: all runs of a folder on one page, with links to their reports."""

from __future__ import annotations

import html
import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sitl_sim.figures.metrics import wilson
from sitl_sim.figures.page import PLOTLY, draw, page, share_plotly
from sitl_sim.recording.run_folder import RunError

_COLUMNS = {
    "scenario": "scenario",
    "seed": "seed",
    "drones": "drones",
    "ok": "verdict",
    "agent_collisions": "drone collisions",
    "obstacle_collisions": "obstacle collisions",
    "min_agent_distance_m": "least between drones [m]",
    "min_obstacle_distance_m": "least to obstacle [m]",
    "mean_speed_m_s": "speed [m/s]",
    "mission_time_s": "all targets [s]",
    "duration_s": "flown [s]",
    "real_time_factor": "real-time factor",
}
_HISTOGRAMS = ("min_agent_distance_m", "min_obstacle_distance_m", "mean_speed_m_s", "duration_s")


@dataclass(frozen=True)
class Entry:
    """One run of a campaign: its folder's name and its metrics."""

    name: str
    metrics: dict[str, Any]


def is_campaign(folder: Path) -> bool:
    """Return whether a folder holds run folders rather than being one."""
    return not (folder / "world.json").exists() and any(folder.glob("*/metrics.json"))


def read_campaign(folder: Path) -> list[Entry]:
    """Return the runs in a folder, by name.

    Raises:
        RunError: the metrics of a run are empty or foreign; the message names the file.
    """
    entries = []
    for path in sorted(folder.glob("*/metrics.json")):
        try:
            # Earlier versions wrote Infinity where no two drones flew at the same time.
            metrics = json.loads(path.read_text("utf-8"), parse_constant=lambda _: None)
            if not {"ok", "seed", "min_obstacle_distance_m"} <= set(metrics):
                raise ValueError("no metrics of a flight")
        except (ValueError, TypeError) as error:
            raise RunError(f"{path}: {error}") from error
        entries.append(Entry(path.parent.name, metrics))
    return entries


def make_campaign_report(
    folder: Path, names: Collection[str] | None = None, not_flown: Mapping[str, str] | None = None
) -> Path:
    """Write `campaign.html` into the folder.

    names: the run folders that count, else all. not_flown: seed → why it has no run folder.
    """
    entries = [e for e in read_campaign(folder) if names is None or e.name in names]
    broken = not_flown or {}
    good, tried = sum(e.metrics["ok"] for e in entries), len(entries) + len(broken)
    low, high = wilson(good, tried)
    kind = "good" if good == tried else "bad"
    verdict = (
        f"<p class='verdict {kind}'><b>{good} of {tried}</b> <span>flights reached all targets and "
        f"touched nothing: {good / tried:.1%}, 95 % interval {low:.1%} to {high:.1%} "
        "(Wilson).</span>"
    )
    why = "".join(f"<p class=bad>Seed {s} not flown: {html.escape(w)}" for s, w in broken.items())
    runs = _table(folder, entries) + why
    sections = [("Over all flights", draw(histograms(entries))), ("Flights", runs)]
    path = folder / "campaign.html"
    share_plotly(folder)
    text = page(f"campaign {folder.name}", verdict, sections, PLOTLY)
    path.write_text(text, encoding="utf-8")
    return path


def histograms(entries: list[Entry]) -> go.Figure:
    """Return histograms over the runs; those that fell short are red."""
    figure = make_subplots(
        rows=1, cols=len(_HISTOGRAMS), subplot_titles=[_COLUMNS[k] for k in _HISTOGRAMS]
    )
    for column, key in enumerate(_HISTOGRAMS):
        values = [e.metrics.get(key) for e in entries]
        known = np.array([v for v in values if v is not None], float)
        edges = np.histogram_bin_edges(known, bins="auto") if len(known) else np.array([0.0, 1.0])
        for ok, colour in ((True, "#2ca02c"), (False, "#d62728")):
            some = [
                v
                for v, e in zip(values, entries, strict=True)
                if v is not None and e.metrics["ok"] is ok
            ]
            counts, _ = np.histogram(some, bins=edges)
            figure.add_bar(
                x=edges[:-1],
                y=counts,
                width=np.diff(edges),
                offset=0,
                marker_color=colour,
                row=1,
                col=column + 1,
            )
    figure.update_layout(
        height=320, barmode="stack", showlegend=False, margin={"l": 40, "r": 10, "t": 30, "b": 30}
    )
    return figure


def _table(folder: Path, entries: list[Entry]) -> str:
    head = "".join(f"<th>{html.escape(title)}" for title in _COLUMNS.values())
    rows = []
    for e in entries:
        name = html.escape(e.name, quote=True)
        cells = "".join(f"<td>{_cell(key, e.metrics.get(key))}" for key in _COLUMNS)
        there = (folder / e.name / "report.html").exists()
        link = f"{name}/report.html" if there else f"{name}/"
        rows.append(f"<tr><td><a href='{link}'>{name}</a>{cells}")
    return f"<div class=wide><table><tr><th>run{head}{''.join(rows)}</table></div>"


def _cell(key: str, value: Any) -> str:
    if key == "ok":
        return "<b class=good>OK</b>" if value else "<b class=bad>FALLS SHORT</b>"
    if isinstance(value, float):
        return f"{value:.2f}"
    return "–" if value is None else html.escape(str(value))
