"""flights.parquet: a row for each flight of a campaign, whole at any moment while it flies.

The run folders are what counts: the table is made of them when a campaign begins or goes on, and is
replaced, never appended to, so that a kill leaves the last whole one and no row is lost or doubled.
"""

from __future__ import annotations

import json
import time
from typing import Any

from sitl_sim.campaigns.campaign import Campaign
from sitl_sim.campaigns.cost import cost_of
from sitl_sim.campaigns.run import metrics_of
from sitl_sim.figures.verdict import shortcomings

TABLE = "flights.parquet"
_SHARE = 0.1  # of the time: the most that a large table, written after each flight, may take

_METRICS = {
    "controller": "string",
    "commit": "string",
    "truth_sha256": "string",
    "drones": "int32",
    "agent_collisions": "int32",
    "obstacle_collisions": "int32",
    "ground_strikes": "int32",
    "min_agent_distance_m": "float64",
    "min_obstacle_distance_m": "float64",
    "mission_time_s": "float64",
    "duration_s": "float64",
    "mean_speed_m_s": "float64",
    "longest_standstill_s": "float64",
    "longest_deadlock_s": "float64",
}
OF_FLIGHT = {"scenario": "string", "seed": "int64", "verdict": "string", "why": "string"} | _METRICS
"""Column → type, of what is the same on any machine. verdict: OK, falls short, not flown."""
OF_WORKER = {
    "worker": "string",
    "version": "string",
    "processor_s": "float64",
    "wall_s": "float64",
    "solve_p50_ms": "float64",
    "solve_p99_ms": "float64",
}
"""Column → type, of what depends on who flew it."""


class Table:
    """The table of a campaign in its folder; needs pyarrow."""

    def __init__(self, campaign: Campaign) -> None:
        """Write the table of all flights that are there."""
        self._campaign = campaign
        self._about = {"campaign": json.dumps(campaign.settings())}
        self._rows: dict[int, dict[str, Any]] = {}
        for seed in campaign.seeds:
            if metrics_of(campaign.run_folder(seed)) is not None:
                self._rows[seed] = _row(campaign, seed, "")
        self.write()

    def add(self, seed: int, result: str) -> None:
        """Take in a flight that has ended; result: why, where it was not flown."""
        self._rows[seed] = _row(self._campaign, seed, result)
        if time.monotonic() >= self._next:
            self.write()

    def write(self) -> None:
        """Replace the file by one with all rows, by seed; the campaign's settings in its schema."""
        import pyarrow
        import pyarrow.parquet

        started = time.monotonic()
        columns = [(k, getattr(pyarrow, t)()) for k, t in (OF_FLIGHT | OF_WORKER).items()]
        rows = [self._rows[seed] for seed in sorted(self._rows)]
        table = pyarrow.Table.from_pylist(rows, pyarrow.schema(columns, self._about))
        path = self._campaign.folder / TABLE
        unfinished = path.with_suffix(".part")
        pyarrow.parquet.write_table(table, unfinished)
        unfinished.replace(path)
        self._next = time.monotonic() + (time.monotonic() - started) / _SHARE


def _row(campaign: Campaign, seed: int, result: str) -> dict[str, Any]:
    """Return a row; a column that is left out is null."""
    folder = campaign.run_folder(seed)
    row: dict[str, Any] = {"scenario": campaign.name, "seed": seed}
    metrics, cost = metrics_of(folder), cost_of(folder)
    if metrics is None:
        return row | {"verdict": "not flown", "why": result}
    row |= {key: metrics.get(key) for key in _METRICS}
    row |= {"verdict": "OK" if metrics["ok"] else "falls short"}
    row |= {"why": "; ".join(shortcomings(metrics)) or None}
    row |= {f"solve_{q}_ms": metrics["solve_ms"][q] for q in ("p50", "p99")}
    return row | (vars(cost) if cost else {})
