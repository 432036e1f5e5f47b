"""`sitl-sim frames`: rendered frames with labels, to measure or train perception."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from sitl_sim.commands.exit_status import EXIT_OK
from sitl_sim.commands.extras import require

HELP = "render labelled frames, to measure perception on"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add folder, seed, number and appearance."""
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--seed", type=int, default=0, metavar="S")
    parser.add_argument("--count", type=int, default=200, help="clean frames (200)")
    parser.add_argument(
        "--looks",
        choices=["marked", "bare", "tree", "mixed"],
        default="marked",
        help="of the drones (marked)",
    )
    parser.add_argument(
        "--look",
        metavar="NAMES",
        help="of the world: comma-separated names of docs/scenarios.md, or all; then --count is "
        "for each look and body",
    )
    parser.add_argument(
        "--bodies",
        metavar="NAMES",
        default="bare",
        help="with --look: quad-x, quad-h, hexa, ducted, toy, bare (any), mixed (any size), or all",
    )
    parser.add_argument(
        "--open-ground",
        action="store_true",
        help="with --look: worlds with few trunks or none, where the horizon shows",
    )


def run(options: argparse.Namespace) -> int:
    """Render the frames into the folder.

    Raises:
        SettingsError: the seed is negative, a look or a body is not known.
    """
    require("numba", "tqdm")
    from tqdm import tqdm

    from sitl_sim.sensors.labelled_frames import write
    from sitl_sim.sensors.look_frames import write_looks

    degraded, flights = options.count // 4, max(options.count // 20, 1)
    with tqdm(unit=" frames", disable=not sys.stderr.isatty()) as bar:
        if options.look is not None:
            written = write_looks(
                options.folder,
                options.seed,
                options.count,
                options.look,
                options.bodies,
                lambda _: bar.update(),
                float(options.open_ground),
            )
            print(f"{options.folder}: {written} frames")
            return EXIT_OK
        written = write(
            options.folder,
            options.seed,
            options.count,
            degraded,
            flights,
            options.looks,
            lambda _: bar.update(),
        )
    print(f"{options.folder}: {written} frames")
    return EXIT_OK
