"""The page of a study: table in Markdown, plot as SVG, figures as JSON; with the flown commit."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from sitl_sim.campaigns.study import Cell, Study

Row = tuple[Cell, dict[str, Any]]
_Bar = tuple[float, float, float]  # low, middle, high
_HEAD = (
    "scenario",
    "case",
    "success",
    "95 % interval",
    "runs with a collision",
    "between drones, least / median [m]",
    "to obstacles, least / median [m]",
    "all targets, median [s]",
    "speed [m/s]",
    "solve p50 / p99 [ms]",
)


def write_page(name: str, study: Study, rows: list[Row], command: str, folder: Path) -> Path:
    """Write NAME.md, NAME.svg and NAME.json into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    plot(study.title, rows, folder / f"{name}.svg")
    found = [{"scenario": c.scenario, "case": c.case, **s} for c, s in rows]
    (folder / f"{name}.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    commits = list(dict.fromkeys(str(s["commit"]) for _, s in rows))
    seeds = rows[0][0].campaign.seeds
    text = "\n".join(
        [
            f"# {study.title}",
            "",
            f"`{command}`, seeds {seeds.start} to {seeds.stop - 1}, commit {', '.join(commits)}.",
            "",
            *_table(rows),
            "",
            f"![success, distances, times]({name}.svg)",
            "",
            *_failures(rows),
        ]
    )
    path = folder / f"{name}.md"
    path.write_text(text, encoding="utf-8")
    return path


def _table(rows: list[Row]) -> list[str]:
    lines = ["| " + " | ".join(_HEAD) + " |", "|---" * len(_HEAD) + "|"]
    for cell, s in rows:
        low, high = s["wilson_95"]
        cells = [
            cell.scenario,
            cell.case,
            f"{s['ok']} of {s['tried']}",
            f"{low:.0%} – {high:.0%}",
            str(s["collided"]),
            _two(s["min_agent_distance_m"]),
            _two(s["min_obstacle_distance_m"]),
            _one(s["mission_time_s"]["median"], 1),
            _one(s["mean_speed_m_s"], 2),
            f"{_one(s['solve_ms']['p50'], 1)} / {_one(s['solve_ms']['p99'], 1)}",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def _failures(rows: list[Row]) -> list[str]:
    """Return the lines that name every run that fell short, by seed and reason."""
    lines = []
    for cell, s in rows:
        for seed, why in {**s["failures"], **{k: [v] for k, v in s["not_flown"].items()}}.items():
            lines.append(f"- {cell.scenario}, {cell.case}, seed {seed}: {'; '.join(why)}")
    return ["## What fell short", "", *lines, ""] if lines else []


def new_figure(width: float, height: float) -> Any:
    """Return an empty figure [inch] that is saved as the same SVG whenever its data are equal."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    mpl.rcParams["svg.fonttype"] = "none"
    mpl.rcParams["svg.hashsalt"] = "swarm-companion"
    return Figure(figsize=(width, height), layout="constrained")


def plot(title: str, rows: list[Row], path: Path) -> None:
    """Draw success with its interval; distances and times as median, least and most."""
    cases = list(dict.fromkeys(c.case for c, _ in rows))
    scenarios = list(dict.fromkeys(c.scenario for c, _ in rows))
    figure = new_figure(11, 1.1 + 0.2 * len(cases) * len(scenarios))
    panels = figure.subplots(1, len(_PANELS), sharey=True)
    for k, case in enumerate(cases):
        mine = [(scenarios.index(c.scenario), s) for c, s in rows if c.case == case]
        offset = (k - (len(cases) - 1) / 2) * 0.8 / len(cases)
        for axes, (_, bar) in zip(panels, _PANELS, strict=True):
            found = [(at + offset, *b) for at, s in mine if (b := bar(s)) is not None]
            y, low, middle, high = np.array(found).reshape(-1, 4).T
            error = np.maximum([middle - low, high - middle], 0)
            axes.errorbar(
                middle, y, xerr=error, fmt="o", markersize=4, capsize=2, color=f"C{k}", label=case
            )
    for axes, (label, _) in zip(panels, _PANELS, strict=True):
        axes.set_xlabel(label)
        axes.set_xlim(left=min(0.0, axes.get_xlim()[0]))
    panels[0].set_xlim(-0.02, 1.02)
    panels[0].set_yticks(range(len(scenarios)), scenarios)
    panels[0].invert_yaxis()
    figure.suptitle(title)
    panels[-1].legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path, metadata={"Date": None})


def _success(s: dict[str, Any]) -> _Bar | None:
    return (s["wilson_95"][0], s["success"], s["wilson_95"][1]) if s["tried"] else None


def _range(key: str) -> Callable[[dict[str, Any]], _Bar | None]:
    def bar(s: dict[str, Any]) -> _Bar | None:
        spread = s[key]
        known = spread["median"] is not None
        return (spread["least"], spread["median"], spread["most"]) if known else None

    return bar


_PANELS = (
    ("success, 95 % interval (Wilson)", _success),
    ("between drones [m]", _range("min_agent_distance_m")),
    ("to a surface [m]", _range("min_obstacle_distance_m")),
    ("all targets [s]", _range("mission_time_s")),
)


def _one(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _two(spread: dict[str, float | None]) -> str:
    return f"{_one(spread['least'], 2)} / {_one(spread['median'], 2)}"
