"""`companion check`: validate configurations, each alone and all together."""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from companion.settings.config import CompanionConfig
    from companion.settings.conflicts import Drone

HELP = "validate configurations, each alone and all together"
EXIT_BAD_INPUT = 2
_PROBLEM = re.compile(r"(?:(?P<file>.*?):(?P<line>\d+):(?P<column>\d+): )?(?P<text>.*)", re.DOTALL)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("config", type=Path, nargs="+")
    parser.add_argument("--json", action="store_true", help="for machines")


def run(options: argparse.Namespace) -> int:
    """Print every mistake; return 0 where there is none."""
    from companion.settings.config import is_bridge
    from companion.settings.conflicts import bridge_problems, conflicts

    problems: dict[Path, list[str]] = {}
    drones: list[Drone] = []
    for path in dict.fromkeys(p for p in options.config if not is_bridge(p)):
        problems[path] = _check(path, drones)
    together = [*conflicts(drones), *(p for d in drones for p in bridge_problems(d))]
    if options.json:
        print(json.dumps(_report(problems, together), indent=1))
    else:
        for path, found in problems.items():
            if not found:
                print(f"{path}: fine")
        for problem in [*(p for found in problems.values() for p in found), *together]:
            print(problem, file=sys.stderr)
    return EXIT_BAD_INPUT if together or any(problems.values()) else 0


def _check(path: Path, drones: list[Drone]) -> list[str]:
    """Return the problems of one file; a valid drone is appended to `drones`."""
    from companion.settings.config import CompanionConfig, is_layer, resolve
    from companion.settings.conflicts import Drone
    from mavlink_bridge.shared.settings import SettingsError, validate

    try:
        document = resolve(path)
        config = validate(CompanionConfig, document, str(path))
    except SettingsError as error:
        return error.problems
    if is_layer(path):
        return []
    drones.append(Drone(path, document, config))
    return _unfit_files(config)


def _unfit_files(config: CompanionConfig) -> list[str]:
    """Return the problems of the calibration and the model that a drone names."""
    from companion.perception.camera import CalibrationError
    from companion.perception.detectors import ModelError, make_detector
    from companion.perception.eyes import Eyes
    from companion.perception.view import load_camera

    try:
        make_detector(load_camera(config.camera), config.sensing)
        if config.sensing.uses_network:
            Eyes()
    except (CalibrationError, ModelError) as error:
        return [str(error)]
    return []


def _report(problems: dict[Path, list[str]], together: list[str]) -> dict[str, Any]:
    """Return the problems for machines; line and column count from 1."""
    files = [
        {"file": str(path), "ok": not found, "problems": [_split(p) for p in found]}
        for path, found in problems.items()
    ]
    return {
        "ok": not together and not any(problems.values()),
        "files": files,
        "conflicts": [_split(p) for p in together],
    }


def _split(problem: str) -> dict[str, Any]:
    found = _PROBLEM.fullmatch(problem)
    assert found is not None  # the pattern matches any text
    place = {k: int(found[k]) for k in ("line", "column") if found[k]}
    return {"file": found["file"], **place, "text": found["text"]}
