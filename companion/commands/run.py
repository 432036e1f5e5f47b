"""`companion run`: the daemon of one drone."""

from __future__ import annotations

import argparse
import logging
from pathlib import Path

HELP = "fly one drone"
EXIT_UNAVAILABLE = 69  # EX_UNAVAILABLE: no port or camera now; another try may succeed
EXIT_BAD_CONFIG = 78  # EX_CONFIG: another try cannot succeed


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("config", type=Path, help="the drone's YAML file")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides")


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
    try:
        config = load_config(options.config, options.overrides)
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
