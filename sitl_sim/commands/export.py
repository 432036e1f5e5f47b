"""`sitl-sim export`: a flight as tables, or as one log of the whole swarm."""

from __future__ import annotations

import argparse
from pathlib import Path

from sitl_sim.commands.exit_status import EXIT_OK
from sitl_sim.commands.extras import require

HELP = "a flight as tables (Parquet, CSV) or as one log of the swarm (MCAP)"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the run folder, the format and the place."""
    parser.add_argument("folder", type=Path, metavar="RUN", help="run folder")
    parser.add_argument("--to", choices=["parquet", "csv", "mcap"], default="mcap")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="PATH",
        help="folder of tables (RUN), or file (RUN/swarm.mcap)",
    )


def run(options: argparse.Namespace) -> int:
    """Write, and print the path of each file.

    Raises:
        RunError: the folder holds no whole flight.
        SettingsError: the place cannot be written, or pyarrow is not installed.
    """
    require("numba", *(["pyarrow"] if options.to == "parquet" else []))
    from mavlink_bridge.shared.settings import SettingsError
    from sitl_sim.recording.run_folder import load_run
    from sitl_sim.recording.swarm_log import write_swarm_log
    from sitl_sim.recording.tables import write_tables

    flight = load_run(options.folder)
    try:
        if options.to == "mcap":
            made = [write_swarm_log(flight, options.out or options.folder / "swarm.mcap")]
        else:
            made = write_tables(flight, options.to, options.out or options.folder)
    except OSError as error:
        raise SettingsError([f"--out {options.out}: {error.strerror}"]) from error
    for path in made:
        print(path)
    return EXIT_OK
