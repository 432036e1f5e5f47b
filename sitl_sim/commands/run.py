"""`sitl-sim run`: one flight, from take-off to a table of its figures."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from sitl_sim.commands.exit_status import EXIT_FELL_SHORT, EXIT_INTERRUPTED, EXIT_OK
from sitl_sim.commands.extras import require
from sitl_sim.commands.open_flight import add_flight_arguments, open_flight
from sitl_sim.commands.progress import flight_progress
from sitl_sim.commands.scenario_options import add_controller_argument
from sitl_sim.commands.view import add_port_argument

if TYPE_CHECKING:
    from sitl_sim.flight.runner import Flight

HELP = "fly one scenario"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scenario, the run folder, and how to fly and show it."""
    add_flight_arguments(parser)
    add_controller_argument(parser)
    parser.add_argument("--real-time", action="store_true", help="the world waits for no companion")
    parser.add_argument(
        "--in-process",
        action="store_true",
        help="companions without sockets, in a process for each core: for studies",
    )
    parser.add_argument("--json", action="store_true", help="print metrics.json instead of a table")
    parser.add_argument("--view", action="store_true", help="show the flight in the browser, live")
    add_port_argument(parser)


def run(options: argparse.Namespace) -> int:
    """Fly, write truth, metrics and report into the run folder, print the figures.

    An interrupted flight is written, too: never OK, exit status 130.

    Raises:
        SettingsError, EndpointError, VideoError, ExternalError: bad input.
    """
    require("numba", "plotly", "tqdm", *(["viser"] if options.view else []))
    from sitl_sim.flight.results import finish, table

    started = time.monotonic()
    with open_flight(options, options.real_time, options.in_process) as f:
        try:
            f.launch()
            f.wait_for_companions()
        except RuntimeError as error:
            print(error, file=sys.stderr)
            return EXIT_FELL_SHORT
        setup_seconds = time.monotonic() - started
        limit = f.scenario.mission.time_limit
        with flight_progress(limit) as show_progress, _live_page(f, options) as show_page:
            f.run(_both(show_progress, show_page))
    interrupted = f.stopped_by is not None
    if interrupted:
        print(f"interrupted: what was flown is kept in {f.folder}", file=sys.stderr)
    metrics = finish(f, setup_seconds, interrupted=interrupted)
    print(json.dumps(metrics, indent=1) if options.json else table(metrics, f.folder))
    if interrupted:
        return EXIT_INTERRUPTED
    return EXIT_OK if metrics["ok"] else EXIT_FELL_SHORT


@contextmanager
def _live_page(f: Flight, options: argparse.Namespace) -> Iterator[Callable[[float], None]]:
    """Yield a function that takes the simulated time [s] and shows the flight where asked for."""
    if not options.view:
        yield lambda t: None
        return
    from sitl_sim.viewer import Live, Page

    live = Live(f.scenario, f.world, f.folder)
    page = Page(live, port=options.port)
    print(f"live: {page.url}", file=sys.stderr, flush=True)
    page.start()
    try:
        yield lambda t: live.update(t, f.vehicles.p, f.vehicles.q)
    finally:
        page.close()


def _both(
    first: Callable[[float], None], second: Callable[[float], None]
) -> Callable[[float], None]:
    """Return a function that calls both."""

    def call(t: float) -> None:
        first(t)
        second(t)

    return call
