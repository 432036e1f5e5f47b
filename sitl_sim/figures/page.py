"""An HTML page: headings, figures, and plotly's own script, inside the page or beside it."""

from __future__ import annotations

import html
from collections.abc import Iterable
from pathlib import Path

import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

PLOTLY = "plotly.min.js"
"""Name of plotly's script where pages share it."""


def page(
    title: str, verdict: str, sections: Iterable[tuple[str, str]], shared: str | None = None
) -> str:
    """Return the whole page; sections: (heading, content as HTML).

    shared: where plotly's script is, seen from the page; None: in the page (5 MB).
    """
    parts = list(sections)
    links = "".join(f"<a href=#s{n}>{html.escape(name)}</a>" for n, (name, _) in enumerate(parts))
    body = "".join(
        f"<section id=s{n}><h2>{html.escape(name)}</h2>{content}</section>"
        for n, (name, content) in enumerate(parts)
    )
    style = Path(__file__).with_name("page.css").read_text("utf-8")
    script = f"<script src='{shared}'>" if shared else f"<script>{get_plotlyjs()}"
    return (
        "<!doctype html><html lang=en><head><meta charset=utf-8>"
        "<meta name=viewport content='width=device-width,initial-scale=1'>"
        f"<title>{html.escape(title)}</title><style>{style}</style>{script}</script></head>"
        f"<body><h1>{html.escape(title)}</h1>{verdict}<nav>{links}</nav>{body}</body></html>"
    )


def share_plotly(folder: Path) -> None:
    """Write plotly's script into a folder, for the pages there and below."""
    (folder / PLOTLY).write_text(get_plotlyjs(), encoding="utf-8")


def draw(figure: go.Figure, name: str | None = None) -> str:
    """Return a figure as a part of a page; name: its id there."""
    config = {"responsive": True, "displaylogo": False}
    made = figure.to_html(full_html=False, include_plotlyjs=False, div_id=name, config=config)
    return str(made)
