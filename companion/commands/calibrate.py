"""`companion calibrate`: a drone's camera, thrust and delay from a flight; a lens from a board."""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path

HELP = "configure a drone from a commissioning flight, or a fisheye from pictures of a chessboard"
EXIT_REFUSED = 1  # something cannot be told from this flight
EXIT_BAD_INPUT = 2
_REACH = 0.7  # of the half diagonal; beyond the corners found, the lens is extrapolated


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument(
        "files",
        type=Path,
        nargs="+",
        metavar="FLIGHT.mcap | PICTURE",
        help="the log of one flight with mission.commission, or pictures of a chessboard",
    )
    flight = parser.add_argument_group("from a flight")
    flight.add_argument(
        "--write",
        type=Path,
        metavar="DRONE.yaml",
        help="change the drone's file; without it the keys are printed",
    )
    board = parser.add_argument_group("from a chessboard")
    board.add_argument(
        "--board",
        type=_board,
        default=(9, 6),
        metavar="COLUMNSxROWS",
        help="inner corners of the board (9x6)",
    )
    board.add_argument(
        "--square", type=float, default=0.025, metavar="METRES", help="side of a square (0.025)"
    )
    board.add_argument("--out", type=Path, default=Path("camera.yaml"), metavar="FILE")
    parser.add_argument("--json", action="store_true", help="for machines")


def run(options: argparse.Namespace) -> int:
    """Calibrate by what is given."""
    logs = [file for file in options.files if file.suffix == ".mcap"]
    if not logs:
        if options.write is not None:
            return _bad("--write: takes a flight (FLIGHT.mcap), not pictures")
        return _from_board(options)
    if len(options.files) > 1:
        return _bad("one flight at a time, or pictures alone")
    from companion.commands.calibrate_flight import from_flight

    return from_flight(logs[0], options.write, machine=options.json)


def _bad(problem: object) -> int:
    print(problem, file=sys.stderr)
    return EXIT_BAD_INPUT


def _from_board(options: argparse.Namespace) -> int:
    """Calibrate a lens, write the file, and print how well it fits."""
    from companion.perception.camera import CalibrationError
    from companion.perception.chessboard import calibrate

    try:
        made = calibrate(options.files, options.board, options.square)
        made.camera.save(options.out)
    except (CalibrationError, OSError) as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT
    camera = made.camera
    if options.json:
        print(
            json.dumps(
                {
                    "file": str(options.out),
                    "rms_px": made.rms,
                    "errors_px": made.errors,
                    "unused": made.unused,
                    "reach": made.reach,
                },
                indent=1,
            )
        )
        return 0
    for name, why in made.unused.items():
        print(f"{name}: left out: {why}")
    print(
        f"{options.out}: {camera.width}×{camera.height}, f {camera.fx:.2f} {camera.fy:.2f} px, "
        f"centre {camera.cx:.2f} {camera.cy:.2f}, k {camera.k.round(5).tolist()}"
    )
    print(f"RMS error {made.rms:.3f} px over {len(made.errors)} pictures")
    if made.reach < _REACH:
        print(
            f"corners reach {100 * made.reach:.0f} % of the way to the picture's corners: "
            "add pictures with the board near the edges"
        )
    return 0


def _board(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"([0-9]+)x([0-9]+)", text)
    if found is None or min(int(found[1]), int(found[2])) < 3:
        raise argparse.ArgumentTypeError(f"must be COLUMNSxROWS of inner corners, got {text!r}")
    return int(found[1]), int(found[2])
