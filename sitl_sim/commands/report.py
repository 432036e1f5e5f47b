"""`sitl-sim report`: one flight, or a folder of flights, on one page."""

from __future__ import annotations

import argparse
import gc
from pathlib import Path

from sitl_sim.commands.exit_status import EXIT_OK
from sitl_sim.commands.extras import require

HELP = "one page about a flight, or about a folder of flights"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the folder."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="run folder, or folder of them")


def run(options: argparse.Namespace) -> int:
    """Write the page and print its path.

    Raises:
        RunError: the folder holds no whole flight.
    """
    require("plotly")
    from sitl_sim.campaigns.report import is_campaign, make_campaign_report
    from sitl_sim.figures.report import make_report
    from sitl_sim.recording.run_folder import load_run

    gc.disable()  # millions of records live to the end: collecting garbage costs a second
    if is_campaign(options.folder):
        print(make_campaign_report(options.folder))
    else:
        print(make_report(load_run(options.folder)))
    return EXIT_OK
