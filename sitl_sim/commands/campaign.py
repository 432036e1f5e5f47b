"""`sitl-sim campaign`: one scenario with many seeds; success rate, table and page."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mavlink_bridge.shared.options import count
from sitl_sim.commands.exit_status import EXIT_FELL_SHORT, EXIT_OK
from sitl_sim.commands.extras import require, require_controllers
from sitl_sim.commands.progress import run_progress
from sitl_sim.commands.scenario_options import (
    add_controller_argument,
    add_scenario_arguments,
    overrides,
)

if TYPE_CHECKING:
    from sitl_sim.campaigns.campaign import Campaign

HELP = "fly a scenario many times, a seed each"


def add_executor_arguments(parser: argparse.ArgumentParser) -> None:
    """Add --workers and --scheduler."""
    parser.add_argument(
        "--workers", type=count, metavar="W", help="flights at a time (one for each core)"
    )
    parser.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT", help="of a Dask cluster, instead of processes"
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scenario, the seeds, and where and how they are flown."""
    add_scenario_arguments(parser)
    add_controller_argument(parser)
    parser.add_argument("--runs", type=count, default=10, metavar="K", help="seeds (10)")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="the first one (0)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="runs/campaign-NAME; resumed")
    add_executor_arguments(parser)
    parser.add_argument(
        "--in-process", action="store_true", help="a flight's companions in one process: faster"
    )
    parser.add_argument(
        "--table", action="store_true", help="a row per flight in DIR/flights.parquet, as it flies"
    )
    parser.add_argument("--json", action="store_true", help="print summary.json, not a table")


def run(options: argparse.Namespace) -> int:
    """Fly what is missing, write summary and page, print; OK where every run succeeded.

    Raises:
        SettingsError: bad input.
    """
    require_for_campaigns(options.scheduler, options.table)
    from sitl_sim.campaigns.campaign import Campaign
    from sitl_sim.campaigns.summary import table

    folder = options.out or _default_folder(options)
    campaign = Campaign(
        options.scenario,
        overrides(options),
        options.runs,
        options.seed,
        folder,
        options.in_process,
    )
    require_controllers(campaign.controllers)
    workers = options.workers or os.cpu_count() or 1
    result = fly(campaign, workers, options.scheduler, options.table)
    print(json.dumps(result, indent=1) if options.json else table(result))
    if not options.json and result["flown"]:
        print(f"{folder / 'campaign.html'}")
    return EXIT_OK if result["ok"] == result["runs"] else EXIT_FELL_SHORT


def require_for_campaigns(scheduler: str | None, with_table: bool = False) -> None:
    """Refuse to start where a module that campaigns need is not installed.

    Raises:
        SettingsError: the missing modules and the command that installs them.
    """
    optional = {"distributed": scheduler, "pyarrow": with_table}
    require("numba", "plotly", "tqdm", *(module for module, asked in optional.items() if asked))


def fly(
    campaign: Campaign, workers: int, scheduler: str | None = None, with_table: bool = False
) -> dict[str, Any]:
    """Fly what is missing, showing each run; return the summary.

    Raises:
        SettingsError: the folder cannot be used.
    """
    from sitl_sim.campaigns.fly import fly as fly_campaign

    return fly_campaign(campaign, workers, scheduler, run_progress, with_table)


def _default_folder(options: argparse.Namespace) -> Path:
    parts = [Path(options.scenario).stem, options.controller]
    return Path("runs") / "-".join(["campaign", *(p for p in parts if p)])
