"""Command line of the companion: each subcommand is a module of `companion.commands`."""

from __future__ import annotations

import argparse
import importlib
import os
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
    "replay",
    "bench",
    "log",
    "status",
)


def main(arguments: list[str] | None = None) -> int:
    """Entry point of `companion`."""
    parser = argparse.ArgumentParser(prog="companion", description="Per-drone flight application.")
    parser.add_argument("--version", action="version", version=version("swarm-companion"))
    commands = parser.add_subparsers(dest="command", required=True)
    for name in COMMANDS:
        module = importlib.import_module(f"companion.commands.{name}")
        sub = commands.add_parser(name, help=module.HELP, description=module.HELP)
        module.add_arguments(sub)
        sub.set_defaults(run=module.run)
    options = parser.parse_args(arguments)
    return int(options.run(options))


if __name__ == "__main__":
    sys.exit(main())
