"""`companion config`: show a drone's resolved configuration; list or copy the examples."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

HELP = "show a resolved configuration; list or copy the examples"
EXIT_BAD_INPUT = 2
BUILT_IN = "built in"
Row = tuple[tuple[str, ...], Any, str]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    actions = parser.add_subparsers(dest="action", required=True)
    show = actions.add_parser("show", help="every value, and where it came from")
    show.add_argument("config", type=Path)
    show.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides")
    show.add_argument("--json", action="store_true", help="for machines")
    examples = actions.add_parser("examples", help="example drones of the package")
    examples.add_argument("--copy", type=Path, metavar="DIR", help="copy them to a new folder")


def run(options: argparse.Namespace) -> int:
    """Show, list or copy; return the exit status."""
    return _show(options) if options.action == "show" else _examples(options)


def _show(options: argparse.Namespace) -> int:
    from companion.settings.config import CompanionConfig, resolve
    from mavlink_bridge.shared.settings import SettingsError, validate

    try:
        document = resolve(options.config, options.overrides)
        config = validate(CompanionConfig, document, str(options.config))
    except SettingsError as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT
    rows = [
        (path, value, document.places.get(path, BUILT_IN))
        for path, value in _leaves(config.model_dump(), ())
    ]
    if options.json:
        table = {".".join(path): {"value": value, "from": place} for path, value, place in rows}
        print(json.dumps(table, indent=1))
    else:
        print("\n".join(_lines(rows)))
    return 0


def _leaves(data: dict[str, Any], path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    for key, value in data.items():
        if isinstance(value, dict):
            yield from _leaves(value, (*path, key))
        else:
            yield (*path, key), value


def _lines(rows: list[Row]) -> list[str]:
    """Return YAML that can be read back, each value with its place as a comment."""
    lines: list[tuple[str, str]] = []
    above: tuple[str, ...] = ()
    for path, value, place in rows:
        for n in range(len(path) - 1):
            if path[: n + 1] != above[: n + 1]:
                lines.append(("  " * n + f"{path[n]}:", ""))
        above = path[:-1]
        lines.append(("  " * (len(path) - 1) + f"{path[-1]}: {json.dumps(value)}", f"# {place}"))
    width = min(max(len(left) for left, _ in lines), 48)
    return [f"{left:<{width}}  {right}".rstrip() for left, right in lines]


def _examples(options: argparse.Namespace) -> int:
    from companion.settings.packaged import data_folder

    folder = data_folder("configs/drones")
    if options.copy is None:
        print("\n".join(str(p) for p in sorted(folder.glob("*.yaml"))))
        return 0
    if options.copy.exists():
        print(f"{options.copy}: exists already; name a new folder", file=sys.stderr)
        return EXIT_BAD_INPUT
    shutil.copytree(folder, options.copy)
    print("\n".join(str(p) for p in sorted(options.copy.rglob("*.yaml"))))
    return 0
