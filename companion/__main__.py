"""Command line of the companion."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

# One drone, one core: BLAS threads would only fight the other processes of the board.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

EXIT_BAD_INPUT = 2


def main(arguments: list[str] | None = None) -> int:
    """Entry point of `companion`."""
    parser = argparse.ArgumentParser(prog="companion", description="Per-drone flight application.")
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run", help="fly one drone")
    run.add_argument("config", type=Path, help="the drone's YAML file")
    run.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides")
    check = commands.add_parser("check", help="validate configurations")
    check.add_argument("config", type=Path, nargs="+")
    options = parser.parse_args(arguments)
    return {"run": _run, "check": _check}[options.command](options)


def _run(options: argparse.Namespace) -> int:
    import cv2

    from companion.config import load_config
    from companion.daemon import Daemon
    from mavlink_bridge.link import EndpointError
    from mavlink_bridge.settings import SettingsError
    from mavlink_bridge.video import VideoError

    cv2.setNumThreads(1)
    try:
        daemon = Daemon(load_config(options.config, options.overrides))
    except (SettingsError, EndpointError, VideoError) as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT
    daemon.run()
    return 0


def _check(options: argparse.Namespace) -> int:
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


if __name__ == "__main__":
    sys.exit(main())
