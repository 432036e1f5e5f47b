"""`sitl-sim export`: a flight as tables, or as one log of the whole swarm."""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from sitl_sim.commands.exit_status import EXIT_OK
from sitl_sim.commands.extras import require

if TYPE_CHECKING:
    from sitl_sim.recording.run_folder import Run

HELP = "a flight as tables (Parquet, CSV) or as one log of the swarm (MCAP, Rerun)"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the run folder, the format and the place."""
    parser.add_argument("folder", type=Path, metavar="RUN", help="run folder")
    parser.add_argument("--to", choices=["parquet", "csv", "mcap", "rerun"], default="mcap")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="PATH",
        help="folder of tables (RUN), or file (RUN/swarm.mcap, RUN/swarm.rrd)",
    )


def run(options: argparse.Namespace) -> int:
    """Write, and print the path of each file.

    Raises:
        RunError: the folder holds no whole flight.
        SettingsError: the place cannot be written, or pyarrow is not installed.
    """
    require("numba", *{"parquet": ["pyarrow"], "rerun": ["rerun"]}.get(options.to, []))
    from mavlink_bridge.shared.settings import SettingsError
    from sitl_sim.recording.run_folder import load_run
    from sitl_sim.recording.tables import write_tables

    flight = load_run(options.folder)
    folder = options.folder
    try:
        if options.to == "mcap":
            made = _mcap(flight, options.out or folder / "swarm.mcap")
        elif options.to == "rerun":
            made = [_rerun(flight, options.out or folder / "swarm.rrd")]
        else:
            made = write_tables(flight, options.to, options.out or folder)
    except OSError as error:
        raise SettingsError([f"--out {options.out}: {error.strerror}"]) from error
    for path in made:
        print(path)
    return EXIT_OK


def _mcap(flight: Run, path: Path) -> list[Path]:
    """Write the log of the swarm, and beside it a layout for Foxglove."""
    from sitl_sim.recording.layouts import write_foxglove_layout
    from sitl_sim.recording.swarm_log import write_swarm_log

    layout = path.with_name(f"{path.stem}.foxglove.json")
    return [write_swarm_log(flight, path), write_foxglove_layout(_names(flight), layout)]


def _rerun(flight: Run, path: Path) -> Path:
    """Write the log of the swarm as a recording of Rerun, with its blueprint."""
    from sitl_sim.recording.layouts import write_rerun
    from sitl_sim.recording.run_folder import radii
    from sitl_sim.recording.swarm_log import write_swarm_log
    from sitl_sim.scenarios.scenario import companion_names

    names = _names(flight)
    with TemporaryDirectory() as folder:
        log = write_swarm_log(flight, Path(folder) / "swarm.mcap")
        sizes = dict(zip(names, radii(flight.world, names).tolist(), strict=True))
        return write_rerun(log, sizes, path, companion_names(flight.scenario))


def _names(flight: Run) -> list[str]:
    """Return the names of the drones; those with companions first, as the first one's is shown."""
    from sitl_sim.scenarios.scenario import companion_names

    flown = companion_names(flight.scenario)
    return [*flown, *(n for n in flight.names if n not in flown)]
