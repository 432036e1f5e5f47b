"""`sitl-sim bench`: where the time of a flight goes, stage by stage, against another release."""

from __future__ import annotations

import argparse
import json
import sys

from mavlink_bridge.shared.options import count
from sitl_sim.commands.exit_status import EXIT_OK
from sitl_sim.commands.extras import require
from sitl_sim.commands.scenario_options import add_scenario_arguments, overrides

HELP = "processor time of each stage of a tick in flight, and against another release"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the flight, how often it is flown, and the other release."""
    add_scenario_arguments(parser)
    parser.add_argument("--seed", type=int, default=0, metavar="S")
    parser.add_argument("--seconds", type=count, default=20, metavar="T", help="flown (20)")
    parser.add_argument("--rounds", type=count, default=3, metavar="K", help="flights each (3)")
    parser.add_argument(
        "--against",
        metavar="PYTHON",
        help="interpreter of another release's environment; both fly in turn",
    )
    parser.add_argument("--json", action="store_true", help="print figures, not a table")


def run(options: argparse.Namespace) -> int:
    """Fly in turn, and print medians over the rounds.

    Raises:
        SettingsError: bad input, or a release that cannot fly this.
    """
    require("numba", "plotly")
    from mavlink_bridge.shared.stage_costs import table
    from sitl_sim.campaigns.bench import measure

    changes = [*overrides(options), f"mission.time_limit={options.seconds}"]
    flown = (options.scenario, changes, options.seed, options.rounds)
    pythons = [sys.executable, *([options.against] if options.against else [])]
    results = measure(pythons, *flown)
    if options.json:
        print(json.dumps(results, indent=1))
    else:
        print(table(*results))
    return EXIT_OK
