"""Flying a campaign: what is missing, then summary and page."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.campaigns.campaign import Campaign
from sitl_sim.campaigns.campaign import run as run_campaign
from sitl_sim.campaigns.campaign_folder import campaign_folder
from sitl_sim.campaigns.cost import cost_of, mean_cost
from sitl_sim.campaigns.executors import job_executor
from sitl_sim.campaigns.report import make_campaign_report
from sitl_sim.campaigns.run import metrics_of
from sitl_sim.campaigns.summary import summary
from sitl_sim.campaigns.table import TABLE, Table

Progress = Callable[[int, int], AbstractContextManager[Callable[[int, str], None]]]
"""(runs, runs flown before) → a context that gives a function of a seed and its result."""


def fly(
    campaign: Campaign,
    workers: int,
    scheduler: str | None,
    progress: Progress,
    with_table: bool = False,
) -> dict[str, Any]:
    """Fly what is missing, write `summary.json` and `campaign.html`, return the summary.

    with_table: keep `flights.parquet`, too; one that is there is kept up in any case.

    Raises:
        SettingsError: the folder cannot be used.
    """
    with campaign_folder(campaign.folder, campaign.settings()):
        # Unusable runs show here, before any flight.
        missing = campaign.runs - len(_sum_up(campaign, {})[0])
        table = Table(campaign) if with_table or (campaign.folder / TABLE).exists() else None
        not_flown: dict[int, str] = {}
        if missing:
            with (
                job_executor(min(workers, missing), scheduler) as executor,
                progress(campaign.runs, campaign.runs - missing) as done,
            ):
                not_flown = run_campaign(campaign, executor, _also(done, table))
        if table:
            table.write()
        flown, result = _sum_up(campaign, not_flown)
        text = json.dumps(result, indent=1)
        (campaign.folder / "summary.json").write_text(text, encoding="utf-8")
        if flown:
            names = [campaign.run_folder(seed).name for seed in flown]
            make_campaign_report(campaign.folder, names, result["not_flown"])
    return result


def _also(done: Callable[[int, str], None], table: Table | None) -> Callable[[int, str], None]:
    """Return `done`, which then enters a finished flight into the table, too."""

    def both(seed: int, result: str) -> None:
        if table:
            table.add(seed, result)
        done(seed, result)

    return both


def _sum_up(campaign: Campaign, not_flown: dict[int, str]) -> tuple[dict[int, Any], dict[str, Any]]:
    """Return the metrics of each run that was flown, by seed, and the summary of all."""
    flights = {seed: metrics_of(campaign.run_folder(seed)) for seed in campaign.seeds}
    flown = {seed: m for seed, m in flights.items() if m is not None}
    try:
        figures = summary(campaign.name, flown, not_flown, campaign.runs)
    except KeyError as error:
        why = f"holds runs of another version, without {error}; choose another --out"
        raise SettingsError([f"{campaign.folder}: {why}"]) from error
    cost = mean_cost(cost_of(campaign.run_folder(seed)) for seed in flown)
    return flown, figures | {"cost": cost}
