"""A self-contained HTML page: headings, figures, and plotly's own script."""

from __future__ import annotations

import html
from collections.abc import Iterable

import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

_STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:76rem;margin:2rem auto;padding:0 1rem}
table{border-collapse:collapse}td,th{padding:.15rem .8rem;border-bottom:1px solid #ddd}
th,td{text-align:left}.bad{color:#b00}.good{color:#060}section{margin:2rem 0}
nav a{margin-right:1rem}"""


def page(title: str, verdict: str, sections: Iterable[tuple[str, str]]) -> str:
    """Return the whole page; sections: (heading, content as HTML)."""
    parts = list(sections)
    links = "".join(f"<a href=#s{n}>{html.escape(name)}</a>" for n, (name, _) in enumerate(parts))
    body = "".join(
        f"<section id=s{n}><h2>{html.escape(name)}</h2>{content}</section>"
        for n, (name, content) in enumerate(parts)
    )
    return (
        f"<!doctype html><html lang=en><head><meta charset=utf-8><title>{html.escape(title)}"
        f"</title><style>{_STYLE}</style><script>{get_plotlyjs()}</script></head>"
        f"<body><h1>{html.escape(title)}</h1>{verdict}<nav>{links}</nav>{body}</body></html>"
    )


def draw(figure: go.Figure) -> str:
    """Return a figure as a part of a page."""
    return str(figure.to_html(full_html=False, include_plotlyjs=False))
