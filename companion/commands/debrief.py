"""`companion debrief`: a flight as its logs tell it, without a simulator's truth."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

HELP = "debrief a flight from its logs: closest approach, guard events, stage times, estimates"
EXIT_BAD_INPUT = 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("log", type=Path, nargs="+", help="flight logs (.mcap), one for each drone")
    parser.add_argument("--html", type=Path, metavar="FILE", help="also write a page")
    parser.add_argument("--json", action="store_true", help="for machines")


def run(options: argparse.Namespace) -> int:
    """Print the table; 2 where a log cannot be read."""
    from companion.debrief.page import page
    from companion.debrief.swarm import debrief, text

    flights, problems = debrief(options.log)
    for problem in problems:
        print(problem, file=sys.stderr)
    if options.json:
        print(json.dumps([asdict(f) | {"path": str(f.path)} for f in flights], indent=1))
    elif flights:
        print(text(flights))
    if options.html and flights:
        try:
            options.html.write_text(page((flights, problems)), encoding="utf-8")
        except OSError as error:
            print(f"{options.html}: cannot be written: {error.strerror}", file=sys.stderr)
            return EXIT_BAD_INPUT
    return EXIT_BAD_INPUT if problems else 0
