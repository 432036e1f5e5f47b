"""Options that several commands share: the scenario, and what is changed in it."""

from __future__ import annotations

import argparse


def add_scenario_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scenario, --drones, --bare and --set."""
    parser.add_argument("scenario", help="a name (forest, …) or a YAML file")
    parser.add_argument("--drones", type=int, metavar="N")
    parser.add_argument(
        "--bare",
        action="store_true",
        help="a world in a look drawn by the seed, drones as they are, without balls, all seen by "
        "the packaged networks",
    )
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides")


def add_controller_argument(parser: argparse.ArgumentParser) -> None:
    """Add --controller."""
    parser.add_argument("--controller", metavar="NAME", help="nmpc, or one to compare it with")


def overrides(options: argparse.Namespace) -> list[str]:
    """Return --bare, --set, --drones and --controller as path.to.key=value.

    Raises:
        SettingsError: the scenario cannot be read.
    """
    changes = list(options.overrides)
    if options.bare:
        changes = [*_bare(options.scenario, changes), *changes]
    if options.drones is not None:
        changes.append(f"drones.count={options.drones}")
    if getattr(options, "controller", None) is not None:
        changes.append(f"companion.controller={options.controller}")
    return changes


def _bare(scenario: str, changes: list[str]) -> list[str]:
    """Return what --bare changes; where obstacles need a depth camera, it stays."""
    from sitl_sim.scenarios.scenario import read

    bare = ["world.look=random", "drones.look=bare", "companion.sensing.detector=network"]
    if read(scenario, [*bare, *changes]).sensing.obstacles == "camera":
        bare.append("companion.sensing.obstacles=network")
    return bare
