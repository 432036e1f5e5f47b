"""`sitl-sim view`: a recorded flight in the browser."""

from __future__ import annotations

import argparse
from pathlib import Path

from sitl_sim.commands.exit_status import EXIT_OK
from sitl_sim.commands.extras import require

HELP = "replay a flight in the browser"


def add_port_argument(parser: argparse.ArgumentParser) -> None:
    """Add --port."""
    parser.add_argument("--port", type=int, default=8080, help="of the page (8080)")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the run folder and the port."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="run folder")
    parser.add_argument("--time", type=float, metavar="S", help="shown first (take-off)")
    add_port_argument(parser)


def run(options: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C.

    Raises:
        RunError: the folder holds no whole flight.
    """
    require("numba", "plotly", "viser")
    from sitl_sim.recording.run_folder import load_run

    recorded = load_run(options.folder)
    from sitl_sim.viewer import Page, Replay

    page = Page(Replay(recorded), port=options.port, time=options.time)
    print(f"{page.url}  (Ctrl-C ends it)", flush=True)
    try:
        page.run()
    finally:
        page.close()
    return EXIT_OK
