"""Command line of the companion: each subcommand is a module of `companion.commands`."""

from __future__ import annotations

import argparse
import importlib
import os
import signal
import sys
from importlib.metadata import version

# One drone, one core: BLAS threads would only fight the other processes of the board.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

COMMANDS = (
    "run",
    "check",
    "schema",
    "config",
    "deploy",
    "doctor",
    "calibrate",
    "fleet",
    "ground",
    "debrief",
    "replay",
    "bench",
    "log",
    "status",
)
EXIT_NO_EXTRA = 2
EXIT_INTERRUPTED = 128 + signal.SIGINT  # the shell's convention


def main(arguments: list[str] | None = None) -> int:
    """Run one subcommand of `companion` and return its exit status."""
    try:
        return _run(arguments)
    except KeyboardInterrupt as interrupt:
        print(": ".join(["interrupted", *map(str, interrupt.args)]), file=sys.stderr)
        return EXIT_INTERRUPTED


def _run(arguments: list[str] | None) -> int:
    from companion.commands.extras import missing_extra
    from mavlink_bridge.shared.completion import complete

    options = complete(_parser()).parse_args(arguments)
    try:
        return int(options.run(options))
    except ModuleNotFoundError as error:
        line = missing_extra(error)
        if line is None:
            raise
        print(line, file=sys.stderr)
        return EXIT_NO_EXTRA


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="companion", description="Per-drone flight application.")
    parser.add_argument("--version", action="version", version=version("swarm-companion"))
    commands = parser.add_subparsers(dest="command", required=True)
    for name in COMMANDS:
        module = importlib.import_module(f"companion.commands.{name}")
        sub = commands.add_parser(name, help=module.HELP, description=module.HELP)
        module.add_arguments(sub)
        sub.set_defaults(run=module.run)
    return parser


if __name__ == "__main__":
    sys.exit(main())
