"""`companion status`: what a running daemon is doing, from the end of its flight log."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from companion.flightlog.status import Status

HELP = "show a running daemon: state, stage times, tracks, guard reason"
EXIT_BAD_INPUT = 2
_PERIOD = 0.5  # s between looks: as often as the log grows


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its command line."""
    parser.add_argument("config", type=Path, help="the drone's YAML file, or its flight log")
    parser.add_argument("--json", action="store_true", help="the last tick's whole record")
    parser.add_argument("--watch", action="store_true", help="again and again, until Ctrl-C")


def run(options: argparse.Namespace) -> int:
    """Follow the log; show its last tick."""
    from companion.flightlog.status import NoStatus, Status
    from mavlink_bridge.shared.mcap_file import LogError
    from mavlink_bridge.shared.settings import SettingsError

    try:
        status = Status(options.config)
        while True:
            try:
                print(_look(status, options.json), flush=True)
            except FileNotFoundError:
                if not options.watch:
                    raise
                print(f"{options.config}: the log is gone, waiting", file=sys.stderr, flush=True)
                status = _another(options.config)
                continue
            if not options.watch:
                return 0
            time.sleep(_PERIOD)
    except (SettingsError, LogError, NoStatus, FileNotFoundError) as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT


def _look(status: Status, as_json: bool) -> str:
    """The last tick.

    Raises:
        NoStatus: there has been none so far.
        FileNotFoundError: the log is no longer there.
    """
    status.update()
    text = status.text()
    return json.dumps(status.record) if as_json else text


def _another(config: Path) -> Status:
    """Wait for a log with a tick in it: the one followed was moved or deleted."""
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
