"""`sitl-sim commissioning`: mis-mounted drones, calibrated from a flight, and flown."""

from __future__ import annotations

import argparse
from pathlib import Path

from mavlink_bridge.shared.options import count
from sitl_sim.commands.exit_status import EXIT_FELL_SHORT, EXIT_OK
from sitl_sim.commands.extras import require

HELP = "calibrate drones that are mis-mounted at random, each from one flight"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the drones, and what they fly afterwards."""
    parser.add_argument("--runs", type=count, default=30, metavar="K", help="drones (30)")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the first one (0)")
    parser.add_argument("--then", metavar="SCENARIO", help="fly it with what was found, as forest")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides")
    parser.add_argument("--out", type=Path, default=Path("runs/commissioning"), metavar="DIR")


def run(options: argparse.Namespace) -> int:
    """Commission each drone, print a line for each and a table; OK where the goals are reached.

    Raises:
        SettingsError: bad input.
    """
    require("numba", "plotly")
    from mavlink_bridge.shared.settings import SettingsError
    from sitl_sim.campaigns.commissioning import commission, reached, table
    from sitl_sim.scenarios import scenario as scenarios

    if options.seed < 0:
        raise SettingsError(["--seed: must be at least 0"])
    if options.then is not None:
        scenarios.read(options.then, options.overrides)
    drones = []
    for seed in range(options.seed, options.seed + options.runs):
        folder = options.out / f"drone-{seed}"
        drones.append(commission(seed, folder, options.overrides, options.then))
        d = drones[-1]
        errors = ", ".join(f"{k} {'–' if e is None else f'{e:.4f}'}" for k, e in d.errors.items())
        flown = {None: "", True: ", flew", False: ", FELL SHORT"}[d.flown]
        print(f"{seed}: {errors}; {d.seconds:.1f} s{flown}", flush=True)
        for name, why in d.refused.items():
            print(f"   {name}: {why}", flush=True)
    print(table(drones), end="")
    if options.then is not None:
        print(f"{options.then}: {sum(d.flown is True for d in drones)} of {len(drones)}")
    return EXIT_OK if reached(drones) else EXIT_FELL_SHORT
