"""`companion run`: the daemon of one drone."""

from __future__ import annotations

import argparse
import json
import logging
from pathlib import Path

HELP = "fly one drone"
EXIT_UNAVAILABLE = 69  # EX_UNAVAILABLE: no port or camera now; another try may succeed
EXIT_BAD_CONFIG = 78  # EX_CONFIG: another try cannot succeed
_FENCE = 3.0  # m from the place of the boot to each side, in a commissioning flight


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("config", type=Path, help="the drone's YAML file")
    parser.add_argument(
        "--commission",
        type=Path,
        metavar="FLIGHT.mcap",
        help="instead of the mission, fly the moves that `companion calibrate` reads, and log them "
        "there; the drone does not look where it flies: 5 m of free air all round",
    )
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides")


def commissioning(log: Path) -> list[str]:
    """Return the overrides of a commissioning flight: no goals, a narrow fence, a log of its own.

    The fence is about the place where the autopilot booted, which is where it must take off.
    """
    return [
        "mission.commission=true",
        "mission.goals=[]",
        f"fence.east=[{-_FENCE:g}, {_FENCE:g}]",
        f"fence.north=[{-_FENCE:g}, {_FENCE:g}]",
        f"log.path={json.dumps(str(log))}",
    ]


def run(options: argparse.Namespace) -> int:
    """Start the daemon, and return its exit status when it ends."""
    import faulthandler

    import cv2

    from companion.commands.extras import missing_extra
    from companion.perception.camera import CalibrationError
    from companion.perception.detectors import ModelError
    from companion.process import journal
    from companion.process.daemon import Daemon
    from companion.settings.config import load_config
    from mavlink_bridge.shared.settings import SettingsError
    from mavlink_bridge.wire.udp import EndpointError
    from mavlink_bridge.wire.video import VideoError

    journal.set_up()
    faulthandler.enable()  # the watchdog's SIGABRT shows where a tick hung
    cv2.setNumThreads(1)
    moves = [] if options.commission is None else commissioning(options.commission)
    try:
        config = load_config(options.config, moves + options.overrides)
    except SettingsError as error:
        for problem in error.problems:
            journal.log.error(problem)
        return EXIT_BAD_CONFIG
    try:
        daemon = Daemon(config)
    except (CalibrationError, ModelError) as error:
        journal.event("cannot start", logging.ERROR, reason=error)
        return EXIT_BAD_CONFIG
    except ModuleNotFoundError as error:
        line = missing_extra(error)
        if line is None:
            raise
        journal.event("cannot start", logging.ERROR, reason=line)
        return EXIT_BAD_CONFIG
    except (EndpointError, VideoError, OSError) as error:
        journal.event("cannot start", logging.ERROR, reason=error)
        return EXIT_UNAVAILABLE
    return 0 if daemon.run() else EXIT_UNAVAILABLE
