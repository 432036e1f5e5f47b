"""`companion check`: validate configurations."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

HELP = "validate configurations"
EXIT_BAD_INPUT = 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its command line."""
    parser.add_argument("config", type=Path, nargs="+")


def run(options: argparse.Namespace) -> int:
    """Every file; one line each."""
    from companion.config import load_config
    from mavlink_bridge.settings import SettingsError

    status = 0
    for path in options.config:
        try:
            load_config(path)
            print(f"{path}: fine")
        except SettingsError as error:
            print(error, file=sys.stderr)
            status = EXIT_BAD_INPUT
    return status
