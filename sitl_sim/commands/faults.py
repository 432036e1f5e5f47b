"""`sitl-sim faults`: the kinds of faults that a scenario can have."""

from __future__ import annotations

import argparse

from sitl_sim.commands.exit_status import EXIT_OK

HELP = "kinds of faults that a scenario can have"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add nothing: the command takes no arguments."""


def run(options: argparse.Namespace) -> int:
    """Print a line for each kind: its name, its default amount and what the amount means."""
    from sitl_sim.faults.catalogue import KINDS

    width = max(map(len, KINDS))
    print(f"{'kind':<{width}}  {'amount':>7}  means")
    for kind, meaning in KINDS.items():
        amount = "" if meaning.default is None else f"{meaning.default:g}"
        print(f"{kind:<{width}}  {amount:>7}  {meaning.text}")
    return EXIT_OK
