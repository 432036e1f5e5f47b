"""`companion log`: work on flight logs."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

HELP = "work on flight logs"
EXIT_BAD_INPUT = 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its command line."""
    actions = parser.add_subparsers(dest="action", required=True)
    recover = actions.add_parser("recover", help="save what a cut-off log still holds")
    recover.add_argument("log", type=Path, help="the cut-off MCAP file")
    recover.add_argument("--out", type=Path, help="default: NAME.recovered.mcap beside it")


def run(options: argparse.Namespace) -> int:
    """Recover, the one action so far."""
    from companion.flightlog.reader import recover
    from mavlink_bridge.shared.mcap_file import LogError

    to = options.out or options.log.with_suffix(".recovered.mcap")
    try:
        if to.exists() and to.samefile(options.log):
            # Whoever still writes it would write on into a file that no longer has a name.
            raise LogError(f"--out {to}: is the log itself; give another name")
        count = recover(options.log, to)
    except (LogError, OSError) as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT
    print(f"{to}: {count} messages")
    return 0
