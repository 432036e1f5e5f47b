"""`sitl-sim campaign`: arguments, progress, what is printed and written."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mavlink_bridge.shared.options import count

if TYPE_CHECKING:
    from sitl_sim.campaigns.campaign import Campaign


def add_arguments(command: argparse.ArgumentParser) -> None:
    """The options beside scenario, --set and --controller."""
    command.add_argument("--runs", type=count, default=10, metavar="K", help="seeds (10)")
    command.add_argument("--seed", type=int, default=0, metavar="S", help="the first one (0)")
    command.add_argument("--out", type=Path, metavar="DIR", help="runs/campaign-NAME; resumed")
    command.add_argument(
        "--workers", type=count, metavar="W", help="flights at a time (one for each core)"
    )
    command.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT", help="of a Dask cluster, instead of processes"
    )
    command.add_argument(
        "--in-process", action="store_true", help="a flight's companions in one process: faster"
    )
    command.add_argument("--json", action="store_true", help="print summary.json, not a table")


def fly_campaign(options: argparse.Namespace, overrides: list[str]) -> bool:
    """Fly, write summary and page, print; whether every run succeeded.

    Raises:
        SettingsError: bad input.
    """
    from sitl_sim.campaigns.campaign import Campaign
    from sitl_sim.campaigns.summary import table

    folder = options.out or _folder(options)
    campaign = Campaign(
        options.scenario, overrides, options.runs, options.seed, folder, options.in_process
    )
    result = fly(campaign, options.workers or os.cpu_count() or 1, options.scheduler)
    print(json.dumps(result, indent=1) if options.json else table(result))
    if not options.json and result["flown"]:
        print(f"{folder / 'campaign.html'}")
    return bool(result["ok"] == result["runs"])


def fly(campaign: Campaign, workers: int, scheduler: str | None = None) -> dict[str, Any]:
    """Fly what is missing and sum up what is there; writes `summary.json`, `campaign.html`.

    Raises:
        SettingsError: a folder that cannot be used.
    """
    from mavlink_bridge.shared.settings import SettingsError
    from sitl_sim.campaigns.campaign import run
    from sitl_sim.campaigns.claim import claimed
    from sitl_sim.campaigns.crew import crew
    from sitl_sim.campaigns.report import make_campaign_report
    from sitl_sim.campaigns.run import metrics_of
    from sitl_sim.campaigns.summary import summary

    def sum_up(broken: dict[int, str]) -> tuple[dict[int, Any], dict[str, Any]]:
        flights = {seed: metrics_of(campaign.run_folder(seed)) for seed in campaign.seeds}
        flown = {seed: m for seed, m in flights.items() if m is not None}
        try:
            return flown, summary(campaign.name, flown, broken, campaign.runs)
        except KeyError as error:
            why = f"holds runs of another version, without {error}; choose another --out"
            raise SettingsError([f"{campaign.folder}: {why}"]) from error

    with claimed(campaign.folder, campaign.settings()):
        missing = campaign.runs - len(sum_up({})[0])  # what is there can be used, or none flies
        broken: dict[int, str] = {}
        if missing:
            with (
                crew(min(workers, missing), scheduler) as who,
                _progress(campaign.runs, campaign.runs - missing) as done,
            ):
                broken = run(campaign, who, done)
        flown, result = sum_up(broken)
        text = json.dumps(result, indent=1)
        (campaign.folder / "summary.json").write_text(text, encoding="utf-8")
        if flown:
            names = [campaign.run_folder(seed).name for seed in flown]
            make_campaign_report(campaign.folder, names, result["not_flown"])
    return result


def _folder(options: argparse.Namespace) -> Path:
    parts = [Path(options.scenario).stem, options.controller]
    return Path("runs") / "-".join(["campaign", *(p for p in parts if p)])


@contextmanager
def _progress(total: int, before: int) -> Iterator[Callable[[int, str], None]]:
    """A bar over runs where a person watches; a line each where not."""
    from tqdm import tqdm

    watched = sys.stderr.isatty()
    with tqdm(total=total, initial=before, unit="run", disable=not watched) as bar:

        def done(seed: int, what: str) -> None:
            line = f"seed {seed}: {what}"
            bar.update()
            if watched:
                bar.write(line, file=sys.stderr)
            else:
                print(line, file=sys.stderr, flush=True)

        yield done
