"""`companion doctor`: preflight check of a board: green, amber or red, and what to do."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from companion.doctor import Finding

HELP = "check a board before flight"
EXIT_RED, EXIT_BAD_INPUT = 1, 2
_COLOUR = {"green": "\033[32m", "amber": "\033[33m", "red": "\033[31m"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("config", type=Path, help="the drone's YAML file")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides")
    parser.add_argument("--json", action="store_true", help="for machines")


def run(options: argparse.Namespace) -> int:
    """Print the findings as they are made; 1 where one is red."""
    from companion.doctor import Level
    from mavlink_bridge.shared.settings import SettingsError

    found: list[Finding] = []
    try:
        for finding in examine(options.config, options.overrides):
            found.append(finding)
            if not options.json:
                _print(finding)
    except SettingsError as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT
    worst = [level for level in reversed(Level) if any(f.level is level for f in found)]
    if options.json:
        rows = [
            {"name": f.name, "level": f.level.value, "text": f.text, "todo": f.todo} for f in found
        ]
        print(json.dumps({"level": worst[0].value, "findings": rows}, indent=1))
    return EXIT_RED if worst[0] is Level.RED else 0


def examine(path: Path, overrides: list[str]) -> Iterator[Finding]:
    """Return every finding, as it is made.

    Raises:
        SettingsError: the configuration is wrong; nothing else is examined.
    """
    import cv2

    from companion.doctor import Level, camera, machine, vehicle
    from companion.doctor.finding import either
    from companion.settings.config import CompanionConfig, resolve
    from mavlink_bridge.shared.settings import validate

    cv2.setNumThreads(1)
    document = resolve(path, overrides)
    config = validate(CompanionConfig, document, str(path))
    yield either(
        "config",
        not config.mission.auto,
        str(path),
        "mission.auto is true: the drone arms and takes off by itself",
        Level.AMBER,
    )
    yield from machine.examine(config)
    yield from camera.examine(config)
    yield from vehicle.examine(config, ("airframe", "hover_thrust") in document.places)


def _print(finding: Finding) -> None:
    colourful = sys.stdout.isatty() and not os.environ.get("NO_COLOR")  # https://no-color.org
    colour, plain = (_COLOUR[finding.level.value], "\033[0m") if colourful else ("", "")
    print(f"{colour}{finding.level.value:<5}{plain}  {finding.name:<14}  {finding.text}")
    if finding.todo:
        print(f"{'':<23}→ {finding.todo}", flush=True)
