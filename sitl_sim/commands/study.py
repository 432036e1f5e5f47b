"""`sitl-sim study`: every case of a study as a campaign, compared on one page."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from mavlink_bridge.shared.options import count
from sitl_sim.commands.campaign import add_executor_arguments, fly, require_for_campaigns
from sitl_sim.commands.exit_status import EXIT_FELL_SHORT, EXIT_OK
from sitl_sim.commands.extras import require, require_controllers

if TYPE_CHECKING:
    from sitl_sim.campaigns.study import Study

HELP = "campaigns side by side: table and plot"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the study, the part of it to fly, the seeds, and where results go."""
    parser.add_argument("study", help="a name (leaderboard, …) or a YAML file")
    parser.add_argument("--runs", type=count, default=20, metavar="K", help="seeds each (20)")
    parser.add_argument(
        "--seed", type=int, default=60000, metavar="S", help="the first one (60000)"
    )
    parser.add_argument("--scenarios", metavar="A,B", help="only these of the study's")
    parser.add_argument("--cases", metavar="A;B", help="only these of the study's")
    parser.add_argument("--out", type=Path, metavar="DIR", help="runs/study-NAME; resumed")
    parser.add_argument(
        "--page",
        type=Path,
        default=Path("docs/studies"),
        metavar="DIR",
        help="where table and plot go (docs/studies)",
    )
    add_executor_arguments(parser)
    parser.add_argument(
        "--processes",
        action="store_true",
        help="each companion in a process of its own, as on a drone",
    )


def run(options: argparse.Namespace) -> int:
    """Fly what is missing, write the page, print its path; OK where every run was flown.

    Raises:
        SettingsError: bad input.
    """
    require_for_campaigns(options.scheduler)
    require("matplotlib")
    from sitl_sim.campaigns import study as studies
    from sitl_sim.campaigns.study_page import write_page

    name = Path(options.study).stem
    study = _chosen(studies.load(options.study), options)
    folder = options.out or Path("runs") / f"study-{name}"
    cells = studies.cells(study, folder, options.runs, options.seed, not options.processes)
    for cell in cells:
        require_controllers(cell.campaign.controllers)
    rows = []
    for cell in cells:
        print(f"{cell.scenario}, {cell.case}", file=sys.stderr, flush=True)
        workers = options.workers or os.cpu_count() or 1
        rows.append((cell, fly(cell.campaign, workers, options.scheduler)))
    print(write_page(name, study, rows, _command(options), options.page))
    return EXIT_FELL_SHORT if any(s["not_flown"] for _, s in rows) else EXIT_OK


def _command(options: argparse.Namespace) -> str:
    """Return the command line that flies the same again, for the page."""
    asked = {
        "runs": options.runs,
        "seed": options.seed,
        "scenarios": options.scenarios,
        "cases": options.cases,
    }
    words = [
        f"--{name} {shlex.quote(str(value))}" for name, value in asked.items() if value is not None
    ]
    return " ".join(["sitl-sim study", options.study, *words])


def _chosen(study: Study, options: argparse.Namespace) -> Study:
    """Return the study, or the part of it that --scenarios and --cases name."""
    from mavlink_bridge.shared.settings import SettingsError

    scenarios, cases = study.scenarios, study.cases
    if options.scenarios:
        wanted = options.scenarios.split(",")
        if unknown := [w for w in wanted if w not in scenarios]:
            valid = ", ".join(scenarios)
            raise SettingsError([f"--scenarios: no {unknown[0]!r} in this study; valid: {valid}"])
        scenarios = wanted
    if options.cases:
        wanted = options.cases.split(";")
        if unknown := [w for w in wanted if w not in cases]:
            valid = "; ".join(cases)
            raise SettingsError([f"--cases: no {unknown[0]!r} in this study; valid: {valid}"])
        cases = {w: cases[w] for w in wanted}
    return study.model_copy(update={"scenarios": scenarios, "cases": cases})
