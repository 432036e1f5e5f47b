"""`companion log`: recover flight logs that were cut off."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

HELP = "recover flight logs"
EXIT_BAD_INPUT = 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    actions = parser.add_subparsers(dest="action", required=True)
    recover = actions.add_parser("recover", help="save the messages that a cut-off log still holds")
    recover.add_argument("log", type=Path, help="the cut-off MCAP file")
    recover.add_argument("--out", type=Path, help="default: NAME.recovered.mcap beside it")


def run(options: argparse.Namespace) -> int:
    """Recover a log, the only action so far."""
    from companion.flightlog.reader import recover
    from mavlink_bridge.shared.mcap_file import LogError

    to = options.out or options.log.with_suffix(".recovered.mcap")
    try:
        if to.exists() and to.samefile(options.log):
            # A daemon that still writes it would go on in a file without a name.
            raise LogError(f"--out {to}: is the log itself; give another name")
        count = recover(options.log, to)
    except (LogError, OSError) as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT
    print(f"{to}: {count} messages")
    return 0
