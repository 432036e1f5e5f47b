"""`companion replay`: a flight log through the present code."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

HELP = "run recorded inputs through the present code; exit 1 where decisions or commands differ"
EXIT_DIFFERS, EXIT_BAD_INPUT = 1, 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("log", type=Path, help="a flight log (MCAP)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides")
    parser.add_argument("--json", action="store_true")


def run(options: argparse.Namespace) -> int:
    """Compare, and print where the first difference is; 1 where there is one."""
    from companion.flightlog.reader import read_log
    from companion.flightlog.replay import replay
    from companion.perception.camera import CalibrationError
    from mavlink_bridge.shared.mcap_file import LogError
    from mavlink_bridge.shared.settings import SettingsError

    try:
        outcome = replay(read_log(options.log), options.overrides)
    except (CalibrationError, LogError, SettingsError) as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT
    print(json.dumps(asdict(outcome), indent=1) if options.json else outcome.text())
    return 0 if outcome.first is None else EXIT_DIFFERS
