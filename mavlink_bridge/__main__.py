"""Command line of the bridge."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from pathlib import Path
from types import FrameType

from mavlink_bridge.betaflight.config import load_bridge_config
from mavlink_bridge.betaflight.msp import MspError
from mavlink_bridge.betaflight.process import BridgeLoop, meet, open_controller
from mavlink_bridge.shared.settings import SettingsError
from mavlink_bridge.wire.link import EndpointError

EXIT_UNFIT, EXIT_BAD_INPUT, EXIT_UNAVAILABLE = 1, 2, os.EX_UNAVAILABLE


def main(arguments: list[str] | None = None) -> int:
    """Entry point of `mavlink-bridge`.

    Exit 0: told to stop; 1: controller silent or unfit; 2: bad input; 69: no such device, or a
    port is taken: may be otherwise in a moment.
    """
    parser = argparse.ArgumentParser(
        prog="mavlink-bridge", description="Autopilots that speak no MAVLink, as MAVLink vehicles."
    )
    commands = parser.add_subparsers(dest="command", required=True)
    betaflight = commands.add_parser("betaflight", help="a Betaflight over MSP")
    betaflight.add_argument("config", type=Path, help="the bridge's YAML file")
    betaflight.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides"
    )
    betaflight.add_argument("--check", action="store_true", help="meet the controller, no more")
    return _betaflight(parser.parse_args(arguments))


def _betaflight(options: argparse.Namespace) -> int:
    try:
        config = load_bridge_config(options.config, options.overrides)
        line = open_controller(config.controller)
        controller = meet(line)
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
    stop = _Stop()
    loop.run(lambda: stop.asked)
    return 0


class _Stop:
    """Set by SIGTERM and SIGINT."""

    def __init__(self) -> None:
        self.asked = False
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._ask)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.asked = True


if __name__ == "__main__":
    sys.exit(main())
