"""Options that several commands share: the scenario, and what is changed in it."""

from __future__ import annotations

import argparse

_BALLS = ("world.look=plain", "drones.look=ball", "sensing.eyes=color")


def add_scenario_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scenario, --drones, --balls and --set."""
    parser.add_argument("scenario", help="a name (forest, …) or a YAML file")
    parser.add_argument("--drones", type=int, metavar="N")
    parser.add_argument(
        "--balls",
        action="store_true",
        help="as in a laboratory: drones with magenta balls in the plain look, found by colour",
    )
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides")


def add_controller_argument(parser: argparse.ArgumentParser) -> None:
    """Add --controller."""
    parser.add_argument("--controller", metavar="NAME", help="nmpc, or one to compare it with")


def overrides(options: argparse.Namespace) -> list[str]:
    """Return --balls, --set, --drones and --controller as path.to.key=value."""
    changes = list(options.overrides)
    if options.balls:
        changes = [*_BALLS, *changes]
    if options.drones is not None:
        changes.append(f"drones.count={options.drones}")
    if getattr(options, "controller", None) is not None:
        changes.append(f"companion.controller={options.controller}")
    return changes
