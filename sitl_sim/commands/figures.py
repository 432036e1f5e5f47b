"""`sitl-sim figures`: a flight's figures as vectors, for papers."""

from __future__ import annotations

import argparse
from pathlib import Path

from sitl_sim.commands.exit_status import EXIT_OK
from sitl_sim.commands.extras import require

HELP = "a flight's figures for papers (PDF)"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the run folder, the format and the place."""
    parser.add_argument("folder", type=Path, metavar="RUN", help="run folder")
    parser.add_argument("--to", choices=["pdf", "svg", "png"], default="pdf")
    parser.add_argument("--out", type=Path, metavar="DIR", help="where they go (RUN/figures)")


def run(options: argparse.Namespace) -> int:
    """Write, and print the path of each file.

    Raises:
        RunError: the folder holds no whole flight.
        SettingsError: the place cannot be written, or matplotlib is not installed.
    """
    require("matplotlib", "plotly")
    from mavlink_bridge.shared.settings import SettingsError
    from sitl_sim.figures.paper import write_figures
    from sitl_sim.recording.run_folder import load_run

    flight = load_run(options.folder)
    try:
        made = write_figures(flight, options.out or options.folder / "figures", options.to)
    except OSError as error:
        raise SettingsError([f"--out {options.out}: {error.strerror}"]) from error
    for path in made:
        print(path)
    return EXIT_OK
