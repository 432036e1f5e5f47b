"""`companion status`: the state of a running daemon, from the end of its flight log."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from companion.flightlog.status import Status

HELP = "show the state of a running daemon: phase, stage times, tracks, guard reason"
EXIT_BAD_INPUT = 2
_PERIOD = 0.5  # s between updates: as often as the log grows


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("config", type=Path, help="the drone's YAML file, or its flight log")
    parser.add_argument("--json", action="store_true", help="the whole record of the last tick")
    parser.add_argument("--watch", action="store_true", help="update until Ctrl-C")


def run(options: argparse.Namespace) -> int:
    """Print the last tick of the log, once or again and again."""
    from companion.flightlog.status import NoStatus, Status
    from mavlink_bridge.shared.mcap_file import LogError
    from mavlink_bridge.shared.settings import SettingsError

    try:
        status = Status(options.config)
        while True:
            try:
                print(_newest(status, options.json), flush=True)
            except FileNotFoundError:
                if not options.watch:
                    raise
                print(f"{options.config}: the log is gone, waiting", file=sys.stderr, flush=True)
                status = _wait_for_log(options.config)
                continue
            if not options.watch:
                return 0
            time.sleep(_PERIOD)
    except (SettingsError, LogError, NoStatus, FileNotFoundError) as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT


def _newest(status: Status, as_json: bool) -> str:
    """Return the last tick.

    Raises:
        NoStatus: the log has no tick so far.
        FileNotFoundError: the log is gone.
    """
    status.update()
    text = status.text()
    return json.dumps(status.record) if as_json else text


def _wait_for_log(config: Path) -> Status:
    """Wait for another log with a tick: the one before was moved or deleted."""
    from companion.flightlog.status import NoStatus, Status
    from mavlink_bridge.shared.mcap_file import LogError

    while True:
        time.sleep(_PERIOD)
        try:
            status = Status(config)
            status.update()
            return status
        except (LogError, NoStatus, FileNotFoundError):
            continue
