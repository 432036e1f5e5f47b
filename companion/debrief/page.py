"""The debriefing as one HTML page that needs nothing else."""

from __future__ import annotations

from html import escape

from companion.debrief.flight import Event, Flight
from companion.debrief.swarm import interventions, row

_STYLE = """
:root { color-scheme: light dark; --line: #8886; --quiet: #8883; --good: #3b9b5f; --bad: #d9534f;
  --accent: #3f7fd0; }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem } h2 { font-size: 1.15rem; margin: 2.2rem 0 .5rem }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums }
th, td { text-align: left; padding: .3rem .7rem .3rem 0; border-bottom: 1px solid var(--line) }
th { font-weight: 600 } .bad { color: var(--bad) } .note { opacity: .7 }
svg { width: 100%; height: 3.4rem; display: block }
svg text { font: 11px system-ui; fill: currentColor }
.columns { display: grid; gap: 0 2.5rem;
  grid-template-columns: repeat(auto-fit, minmax(22rem, 1fr)) }
"""
_COLOURS = {
    "wait": "#8886", "arm": "#c9a227", "takeoff": "#c9a227", "engage": "#3f7fd0", "fly": "#3b9b5f",
    "land": "#8a63c9", "done": "#8886", "passive": "#d9534f",
}  # fmt: skip
_WIDTH = 1000  # of a time line, in its own units


def page(debriefed: tuple[list[Flight], list[str]]) -> str:
    """Return the page of the flights, and of the logs that cannot be read."""
    flights, problems = debriefed
    told = "".join(f'<p class="bad">{escape(p)}</p>' for p in problems)
    if not flights:
        body = "<p>No flight log so far: pull the logs first.</p>"
    else:
        body = _overview(flights) + "".join(map(_flight, flights))
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>Debriefing</title>'
        '<meta name="viewport" content="width=device-width">'
        f"<style>{_STYLE}</style><h1>Debriefing</h1>"
        '<p class="note">Distances are as each drone believed them, between centres, in its own '
        "log; nobody measured the truth.</p>"
        f"{told}{body}</html>"
    )


def _overview(flights: list[Flight]) -> str:
    rows = [row(f) for f in flights]
    return _table(list(rows[0]), [list(r.values()) for r in rows])


def _flight(f: Flight) -> str:
    guard = [[f"{e.time:.1f} s", f"{e.seconds:.1f} s", e.what] for e in interventions(f)]
    events = [[f"{e.time:.1f} s", f"{e.seconds:.1f} s", e.what] for e in f.events]
    stages = [[n, *(f"{v:.2f}" for v in t)] for n, t in f.stages.items()]
    quiet = '<p class="note">none</p>'
    return (
        f"<h2>{escape(f.name)}</h2><p class='note'>{escape(str(f.path))}</p>"
        + _timeline(f)
        + '<div class="columns"><section><h3>Guard interventions</h3>'
        + (_table(["at", "for", "reason"], guard) if guard else quiet)
        + "<h3>Events</h3>"
        + (_table(["at", "for", "what"], events) if events else quiet)
        + "</section><section><h3>Estimates</h3>"
        + _table(["", ""], [[k, v] for k, v in f.estimates.items()])
        + "</section><section><h3>Stage times [ms]</h3>"
        + _table(["stage", "median", "p99", "most"], stages)
        + "</section></div>"
    )


def _table(head: list[str], rows: list[list[str]]) -> str:
    top = "".join(f"<th>{escape(h)}</th>" for h in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(c)}</td>" for c in r) + "</tr>" for r in rows)
    return f"<table><tr>{top}</tr>{body}</table>"


def _timeline(f: Flight) -> str:
    """Return phases above, interventions of the guard below, over the time of the log."""
    scale = _WIDTH / max(f.seconds, 1e-6)

    def bar(e: Event, y: int, height: int, colour: str) -> str:
        x, width = e.time * scale, max(e.seconds * scale, 1.5)
        name = f"{e.what}, {e.time:.1f} s for {e.seconds:.1f} s"
        label = f'<text x="{x + 3:.1f}" y="{y + 13}">{escape(e.what)}</text>' if width > 45 else ""
        return (
            f'<rect x="{x:.1f}" y="{y}" width="{width:.1f}" height="{height}" fill="{colour}">'
            f"<title>{escape(name)}</title></rect>{label}"
        )

    bars = [bar(e, 0, 18, _COLOURS.get(e.what, "#8886")) for e in f.phases]
    bars += [bar(e, 22, 10, "#d9534f") for e in interventions(f)]
    return (
        f'<svg viewBox="0 0 {_WIDTH} 50" preserveAspectRatio="none" role="img" '
        f'aria-label="phases and guard of {escape(f.name)}">{"".join(bars)}'
        f'<text x="0" y="47">0 s</text>'
        f'<text x="{_WIDTH}" y="47" text-anchor="end">{f.seconds:.0f} s</text></svg>'
    )
