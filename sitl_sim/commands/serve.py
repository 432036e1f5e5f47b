"""`sitl-sim serve`: the world and its vehicles alone, until told to stop.

Neither the mission's time limit nor a landed swarm ends it. SIGTERM ends it in order with exit
status 0, Ctrl-C just so with status 130. Truth, metrics and report of the last ten minutes are
written.
"""

from __future__ import annotations

import argparse
import signal
import sys
import time

from sitl_sim.commands.exit_status import EXIT_INTERRUPTED, EXIT_OK
from sitl_sim.commands.extras import require
from sitl_sim.commands.open_flight import add_flight_arguments, open_flight

HELP = "the world alone, until told to stop; companions connect themselves"
_TRUTH_SECONDS = 600.0  # of truth that are kept: memory must not grow


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scenario and the run folder."""
    add_flight_arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Serve in real time; write and print the figures in the end.

    Raises:
        SettingsError, EndpointError, VideoError, ExternalError: bad input.
    """
    require("numba", "plotly")
    from sitl_sim.flight.results import finish, table
    from sitl_sim.recording.truth import Truth

    started = time.monotonic()
    with open_flight(options, real_time=True) as f:
        setup_seconds = time.monotonic() - started
        f.truth = Truth(f.names, _TRUTH_SECONDS)
        f.run(until_stopped=True)
    interrupted = f.stopped_by == signal.SIGINT
    if interrupted:
        print(f"interrupted: what was served is kept in {f.folder}", file=sys.stderr)
    print(table(finish(f, setup_seconds, interrupted=interrupted), f.folder))
    return EXIT_INTERRUPTED if interrupted else EXIT_OK
