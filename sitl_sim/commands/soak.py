"""`sitl-sim soak`: hours of flights with random faults; collisions, memory and open files."""

from __future__ import annotations

import argparse
import sys

from sitl_sim.commands.exit_status import EXIT_FELL_SHORT, EXIT_OK
from sitl_sim.commands.extras import require

HELP = "fly for hours with random faults; does memory grow?"
_LEAST = {"hours": 0.001, "minutes": 0.01, "drones": 1, "seed": 0}
_MEMORY_MB, _FILES = 5.0, 0  # growth that is allowed


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add duration, swarm size and seed."""
    parser.add_argument("--hours", type=float, default=2.0, help="simulated (2)")
    parser.add_argument("--drones", type=int, default=3, metavar="N")
    parser.add_argument("--minutes", type=float, default=5.0, help="of one flight (5)")
    parser.add_argument("--seed", type=int, default=0, metavar="S")


def run(options: argparse.Namespace) -> int:
    """Fly and print a line after each flight; fall short where drones collide or memory grows.

    Raises:
        SettingsError: a duration, number of drones or seed is too small.
    """
    require("numba", "plotly")
    from mavlink_bridge.shared.settings import SettingsError
    from sitl_sim.campaigns.soak import growth, soak

    wrong = [
        f"--{name}: must be at least {low:g}"
        for name, low in _LEAST.items()
        if not getattr(options, name) >= low
    ]
    if wrong:
        raise SettingsError(wrong)
    results = []
    try:
        for r in soak(options.hours, options.drones, options.minutes, options.seed):
            results.append(r)
            print(
                f"{r.hours:6.3f} h  {r.faults:3d} faults  {r.grounded} grounded  "
                f"{r.collisions} collisions  {r.rss_mb:7.1f} MB  {r.files} files",
                flush=True,
            )
    except RuntimeError as error:  # a companion's, with its traceback
        print(error, file=sys.stderr)
        return EXIT_FELL_SHORT
    memory, files = growth(results)
    collisions = sum(r.collisions for r in results)
    print(
        f"{results[-1].hours:.2f} h: {collisions} collisions of healthy drones, "
        f"memory {memory:+.1f} MB, files {files:+d} since the second flight"
    )
    fine = collisions == 0 and memory <= _MEMORY_MB and files <= _FILES
    return EXIT_OK if fine else EXIT_FELL_SHORT
