"""`sitl-sim campaign`: one scenario with many seeds; success rate, table and page."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mavlink_bridge.shared.options import count
from sitl_sim.commands.exit_status import EXIT_FELL_SHORT, EXIT_OK
from sitl_sim.commands.extras import require, require_controller
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
    parser.add_argument("--json", action="store_true", help="print summary.json, not a table")


def run(options: argparse.Namespace) -> int:
    """Fly what is missing, write summary and page, print; OK where every run succeeded.

    Raises:
        SettingsError: bad input.
    """
    require_for_campaigns(options.scheduler)
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
    require_controller(campaign.controller)
    result = fly(campaign, options.workers or os.cpu_count() or 1, options.scheduler)
    print(json.dumps(result, indent=1) if options.json else table(result))
    if not options.json and result["flown"]:
        print(f"{folder / 'campaign.html'}")
    return EXIT_OK if result["ok"] == result["runs"] else EXIT_FELL_SHORT


def require_for_campaigns(scheduler: str | None) -> None:
    """Refuse to start where a module that campaigns need is not installed.

    Raises:
        SettingsError: the missing modules and the command that installs them.
    """
    require("numba", "plotly", "tqdm", *(["distributed"] if scheduler else []))


def fly(campaign: Campaign, workers: int, scheduler: str | None = None) -> dict[str, Any]:
    """Fly what is missing, write `summary.json` and `campaign.html`, return the summary.

    Raises:
        SettingsError: the folder cannot be used.
    """
    from mavlink_bridge.shared.settings import SettingsError
    from sitl_sim.campaigns.campaign import run as run_campaign
    from sitl_sim.campaigns.campaign_folder import campaign_folder
    from sitl_sim.campaigns.executors import job_executor
    from sitl_sim.campaigns.report import make_campaign_report
    from sitl_sim.campaigns.run import metrics_of
    from sitl_sim.campaigns.summary import summary

    def sum_up(not_flown: dict[int, str]) -> tuple[dict[int, Any], dict[str, Any]]:
        flights = {seed: metrics_of(campaign.run_folder(seed)) for seed in campaign.seeds}
        flown = {seed: m for seed, m in flights.items() if m is not None}
        try:
            return flown, summary(campaign.name, flown, not_flown, campaign.runs)
        except KeyError as error:
            why = f"holds runs of another version, without {error}; choose another --out"
            raise SettingsError([f"{campaign.folder}: {why}"]) from error

    with campaign_folder(campaign.folder, campaign.settings()):
        missing = campaign.runs - len(sum_up({})[0])  # unusable runs show here, before any flight
        not_flown: dict[int, str] = {}
        if missing:
            with (
                job_executor(min(workers, missing), scheduler) as executor,
                run_progress(campaign.runs, campaign.runs - missing) as done,
            ):
                not_flown = run_campaign(campaign, executor, done)
        flown, result = sum_up(not_flown)
        text = json.dumps(result, indent=1)
        (campaign.folder / "summary.json").write_text(text, encoding="utf-8")
        if flown:
            names = [campaign.run_folder(seed).name for seed in flown]
            make_campaign_report(campaign.folder, names, result["not_flown"])
    return result


def _default_folder(options: argparse.Namespace) -> Path:
    parts = [Path(options.scenario).stem, options.controller]
    return Path("runs") / "-".join(["campaign", *(p for p in parts if p)])
