"""`sitl-sim study`: flies every case of a study and writes its page."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from mavlink_bridge.shared.options import count

if TYPE_CHECKING:
    from sitl_sim.campaigns.study import Study


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Its options."""
    command.add_argument("study", help="a name (leaderboard, …) or a YAML file")
    command.add_argument("--runs", type=count, default=20, metavar="K", help="seeds each (20)")
    command.add_argument(
        "--seed", type=int, default=60000, metavar="S", help="the first one (60000)"
    )
    command.add_argument("--scenarios", metavar="A,B", help="only these of the study's")
    command.add_argument("--cases", metavar="A;B", help="only these of the study's")
    command.add_argument("--out", type=Path, metavar="DIR", help="runs/study-NAME; resumed")
    command.add_argument("--page", type=Path, default=Path("docs/studies"), metavar="DIR",
                         help="where table and plot go (docs/studies)")  # fmt: skip
    command.add_argument("--workers", type=count, metavar="W", help="flights at a time")
    command.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="of a Dask cluster")
    command.add_argument("--processes", action="store_true",
                         help="each companion in a process of its own, as on a drone")  # fmt: skip


def run_study(options: argparse.Namespace) -> bool:
    """Fly what is missing, write the page, print where it is; whether all could be flown.

    Raises:
        SettingsError: bad input.
    """
    from sitl_sim.campaigns import study as studies
    from sitl_sim.campaigns.study_page import new_figure, write_page
    from sitl_sim.commands.campaign import fly

    name = Path(options.study).stem
    study = _chosen(studies.load(options.study), options)
    folder = options.out or Path("runs") / f"study-{name}"
    rows = []
    new_figure(1.0, 1.0)  # now, not after all flights, is told what is missing
    for cell in studies.cells(study, folder, options.runs, options.seed, not options.processes):
        print(f"{cell.scenario}, {cell.case}", file=sys.stderr, flush=True)
        workers = options.workers or os.cpu_count() or 1
        rows.append((cell, fly(cell.campaign, workers, options.scheduler)))
    print(write_page(name, study, rows, _command(options), options.page))
    return not any(s["not_flown"] for _, s in rows)


def _command(options: argparse.Namespace) -> str:
    """What flies the same again, for the page."""
    asked = {"runs": options.runs, "seed": options.seed,
             "scenarios": options.scenarios, "cases": options.cases}  # fmt: skip
    words = [
        f"--{name} {shlex.quote(str(value))}" for name, value in asked.items() if value is not None
    ]
    return " ".join(["sitl-sim study", options.study, *words])


def _chosen(study: Study, options: argparse.Namespace) -> Study:
    """The study, or the part of it that was asked for."""
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
            raise SettingsError([f"--cases: no {unknown[0]!r} in this study; "
                                 f"valid: {'; '.join(cases)}"])  # fmt: skip
        cases = {w: cases[w] for w in wanted}
    return study.model_copy(update={"scenarios": scenarios, "cases": cases})
