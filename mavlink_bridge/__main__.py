"""Command line of the bridge."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from importlib.metadata import version
from pathlib import Path
from types import FrameType

EXIT_UNFIT, EXIT_BAD_INPUT, EXIT_UNAVAILABLE = 1, 2, os.EX_UNAVAILABLE
EXIT_INTERRUPTED = 128 + signal.SIGINT  # the shell's convention
_STATUSES = """\
exit status:
  0    stopped by SIGTERM, or --check found a controller that can fly
  1    the controller does not answer, or cannot fly as it is set up
  2    wrong arguments or configuration; trying again cannot help
  69   no such device, or a port is taken; try again later
  130  interrupted by Ctrl-C
"""


def main(arguments: list[str] | None = None) -> int:
    """Run `mavlink-bridge` and return its exit status, as `--help` lists them."""
    from mavlink_bridge.shared.completion import complete

    options = complete(_parser()).parse_args(arguments)
    try:
        return _betaflight(options)
    except KeyboardInterrupt:
        return _interrupted()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="mavlink-bridge",
        description="Bridge from autopilots without MAVLink offboard control to MAVLink over UDP.",
        epilog=_STATUSES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=version("swarm-companion"))
    commands = parser.add_subparsers(dest="command", required=True)
    betaflight = commands.add_parser(
        "betaflight",
        help="bridge a Betaflight flight controller over MSP",
        description="Bridge a Betaflight flight controller, over MSP, to MAVLink over UDP.",
        epilog=_STATUSES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    betaflight.add_argument("config", type=Path, help="the bridge's YAML file")
    betaflight.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="overrides",
        help="override one value of the file, e.g. link.system_id=3; may be repeated",
    )
    betaflight.add_argument(
        "--check",
        action="store_true",
        help="read the controller's setup, print it and exit",
    )
    return parser


def _betaflight(options: argparse.Namespace) -> int:
    # Imported here so that `main` catches a Ctrl-C during the import, too.
    from mavlink_bridge.betaflight.config import load_bridge_config
    from mavlink_bridge.betaflight.msp import MspError
    from mavlink_bridge.betaflight.process import (
        BridgeLoop,
        open_controller,
        wait_for_controller,
    )
    from mavlink_bridge.shared.settings import SettingsError
    from mavlink_bridge.wire.udp import EndpointError

    try:
        config = load_bridge_config(options.config, options.overrides)
        line = open_controller(config.controller)
        controller = wait_for_controller(line)
        print("\n".join(controller.report()), file=sys.stderr, flush=True)
        if options.check:
            return 0
        loop = BridgeLoop(config, line, controller)
    except MspError as error:
        print(error, file=sys.stderr)
        return EXIT_UNFIT
    except SettingsError as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT
    except EndpointError as error:
        print(error, file=sys.stderr)
        return EXIT_UNAVAILABLE
    stop = _StopSignals()
    loop.run(lambda: stop.received is not None)
    return _interrupted() if stop.received == signal.SIGINT else 0


def _interrupted() -> int:
    print("interrupted", file=sys.stderr)
    return EXIT_INTERRUPTED


class _StopSignals:
    """The first SIGTERM or SIGINT, kept as a flag: the bridge still sends its final frame."""

    def __init__(self) -> None:
        self.received: int | None = None
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._keep)

    def _keep(self, number: int, frame: FrameType | None) -> None:
        if self.received is None:
            self.received = number


if __name__ == "__main__":
    sys.exit(main())
