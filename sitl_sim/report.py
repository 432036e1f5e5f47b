"""report.html of one flight: summary, top view, and the paper's three curves (Fig. 7)."""

from __future__ import annotations

import base64
import html
import io
import itertools
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from numpy.typing import NDArray

from sitl_sim.metrics import AIRBORNE
from sitl_sim.world import Vector, surface_distance

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

_STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:72rem;margin:2rem auto;padding:0 1rem}
table{border-collapse:collapse}td{padding:.15rem .8rem;border-bottom:1px solid #ddd}
img{max-width:100%}.bad{color:#b00}.good{color:#060}"""


def write_report(
    folder: Path, truth: dict[str, NDArray[Any]], world: dict[str, Any], metrics: dict[str, Any]
) -> None:
    """Write a self-contained page into the run folder."""
    figure = top_view(truth, world)
    figure.savefig(folder / "top_view.png", dpi=110)
    parts = [_image(figure), _image(curves(truth, world))]
    verdict = "OK" if metrics["ok"] else "FALLS SHORT"
    rows = "".join(
        f"<tr><td>{html.escape(k)}</td><td>{html.escape(_text(v))}</td></tr>"
        for k, v in metrics.items()
        if k not in ("per_drone", "stage_ms")
    )
    title = f"{metrics['scenario']}, seed {metrics['seed']}, {metrics['drones']} drones"
    page = (
        f"<!doctype html><html lang=en><meta charset=utf-8><title>{html.escape(title)}</title>"
        f"<style>{_STYLE}</style><h1>{html.escape(title)}</h1>"
        f"<p class={'good' if metrics['ok'] else 'bad'}><b>{verdict}</b></p>"
        f"{''.join(parts)}<h2>Figures</h2><table>{rows}</table></html>"
    )
    (folder / "report.html").write_text(page, encoding="utf-8")


def top_view(truth: dict[str, NDArray[Any]], world: dict[str, Any]) -> Figure:
    """All trajectories from above, with obstacles, starts and targets (Fig. 7a)."""
    p = truth["position"]
    figure, ax = plt.subplots(figsize=(9, 9), layout="constrained")
    for c in world["cylinders"]:
        ax.add_patch(Circle((c["x"], c["y"]), c["radius"], color="#7a6a55"))
    for b in world["boxes"]:
        size = np.array(b["max"]) - np.array(b["min"])
        ax.add_patch(Rectangle(b["min"][:2], size[0], size[1], color="#999"))
    for i, name in enumerate(truth["names"]):
        (line,) = ax.plot(p[:, i, 0], p[:, i, 1], lw=1.1, label=str(name))
        ax.plot(*p[0, i, :2], "o", ms=4, color=line.get_color())
    shared = {tuple(t) for targets in world["targets"].values() for t in targets[:-1]}
    for x, y, _ in sorted(shared):
        ax.plot(x, y, "^", ms=11, color="#d00")
        reach = world["target_tolerance"]
        ax.add_patch(Circle((x, y), reach, fill=False, ls=":", color="#d00"))
    ax.set(xlabel="x, east [m]", ylabel="y, north [m]", aspect="equal")
    ax.legend(fontsize=7, ncols=2)
    ax.grid(alpha=0.3)
    return figure


def curves(truth: dict[str, NDArray[Any]], world: dict[str, Any]) -> Figure:
    """Mean ± std of distance between drones, to the nearest obstacle, and speed (Fig. 7b-d)."""
    t, p = truth["t"], truth["position"].astype(float)
    flying = p[..., 2] > AIRBORNE
    pairs = list(itertools.combinations(range(p.shape[1]), 2))
    figure, axes = plt.subplots(3, 1, figsize=(11, 9), sharex=True, layout="constrained")
    if pairs:
        apart = np.stack([np.linalg.norm(p[:, i] - p[:, j], axis=-1) for i, j in pairs], axis=1)
        both = np.stack([flying[:, i] & flying[:, j] for i, j in pairs], axis=1)
        _band(axes[0], t, apart, both)
    axes[0].axhline(2 * world["drone_radius"], color="#b00", lw=0.8, ls="--")
    axes[0].set_ylabel("between drones [m]")
    _band(axes[1], t, surface_distance(p, world), flying)
    axes[1].axhline(world["drone_radius"], color="#b00", lw=0.8, ls="--")
    axes[1].set_ylabel("to nearest obstacle [m]")
    _band(axes[2], t, np.linalg.norm(truth["velocity"], axis=-1), flying)
    axes[2].set(ylabel="speed [m/s]", xlabel="time [s]")
    return figure


def _band(ax: Axes, t: Vector, values: Vector, valid: NDArray[np.bool_]) -> None:
    """Mean, std and minimum over the columns that are valid at each time."""
    some = valid.any(axis=1) & np.isfinite(np.where(valid, values, 0.0)).all(axis=1)
    masked = np.ma.masked_array(values, ~valid)[some]
    if not len(masked):
        return
    mean, std = masked.mean(axis=1).filled(np.nan), masked.std(axis=1).filled(np.nan)
    ax.fill_between(t[some], mean - std, mean + std, alpha=0.25)
    ax.plot(t[some], mean, label="mean ± std")
    ax.plot(t[some], masked.min(axis=1).filled(np.nan), lw=0.7, label="minimum")
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8)


def _image(figure: Figure) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    plt.close(figure)
    data = base64.b64encode(buffer.getvalue()).decode()
    return f'<p><img alt="" src="data:image/png;base64,{data}">'


def _text(value: Any) -> str:
    return f"{value:.3f}" if isinstance(value, float) else str(value)
