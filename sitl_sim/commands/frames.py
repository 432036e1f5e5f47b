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


def run(options: argparse.Namespace) -> int:
    """Render the frames into the folder.

    Raises:
        SettingsError: the seed is negative.
    """
    require("numba", "tqdm")
    from tqdm import tqdm

    from sitl_sim.sensors.labelled_frames import write

    degraded, flights = options.count // 4, max(options.count // 20, 1)
    with tqdm(unit=" frames", disable=not sys.stderr.isatty()) as bar:
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
