"""Command line of the simulator: each subcommand is a module of `sitl_sim.commands`."""

from __future__ import annotations

import argparse
import importlib
import os
import signal
import sys
from importlib.metadata import version

# One flight, one core: BLAS threads would only fight the companions. numpy reads these.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

from sitl_sim.commands.exit_status import EXIT_BAD_INPUT, EXIT_INTERRUPTED  # noqa: E402

COMMANDS = (
    "run",
    "serve",
    "window",
    "campaign",
    "study",
    "commissioning",
    "scenarios",
    "report",
    "export",
    "figures",
    "video",
    "schema",
    "frames",
    "faults",
    "soak",
    "bench",
    "view",
)


def main(arguments: list[str] | None = None) -> int:
    """Run one subcommand and return its exit status; SIGTERM counts as Ctrl-C."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return _run(arguments)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED


def _run(arguments: list[str] | None) -> int:
    from mavlink_bridge.shared.completion import complete
    from sitl_sim.commands.extras import missing_extra

    options = complete(_parser()).parse_args(arguments)
    try:
        return int(options.run(options))
    except _bad_input() as error:
        print(error, file=sys.stderr)
    except ModuleNotFoundError as error:
        line = missing_extra(error)
        if line is None:
            raise
        print(line, file=sys.stderr)
    return EXIT_BAD_INPUT


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="sitl-sim", description="The simulated world.")
    parser.add_argument("--version", action="version", version=version("swarm-companion"))
    commands = parser.add_subparsers(dest="command", required=True)
    for name in COMMANDS:
        module = importlib.import_module(f"sitl_sim.commands.{name}")
        sub = commands.add_parser(name, help=module.HELP, description=module.HELP)
        module.add_arguments(sub)
        sub.set_defaults(run=module.run)
    return parser


def _bad_input() -> tuple[type[Exception], ...]:
    """Return the errors that are a user's mistake: printed as one line, never as a traceback."""
    from mavlink_bridge.shared.settings import SettingsError
    from mavlink_bridge.wire.udp import EndpointError
    from mavlink_bridge.wire.video import VideoError
    from sitl_sim.external.external_sitl import ExternalError
    from sitl_sim.external.namespace import NamespaceError
    from sitl_sim.recording.run_folder import RunError

    return ExternalError, NamespaceError, SettingsError, EndpointError, VideoError, RunError


if __name__ == "__main__":
    sys.exit(main())
