"""`companion calibrate`: the calibration file of a fisheye from pictures of a chessboard."""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path

HELP = "calibrate a fisheye from pictures of a chessboard"
EXIT_BAD_INPUT = 2
_REACH = 0.7  # of the half diagonal; beyond the corners found, the lens is extrapolated


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("pictures", type=Path, nargs="+", metavar="PICTURE")
    parser.add_argument(
        "--board",
        type=_board,
        default=(9, 6),
        metavar="COLUMNSxROWS",
        help="inner corners of the board (9x6)",
    )
    parser.add_argument(
        "--square", type=float, default=0.025, metavar="METRES", help="side of a square (0.025)"
    )
    parser.add_argument("--out", type=Path, default=Path("camera.yaml"), metavar="FILE")
    parser.add_argument("--json", action="store_true", help="for machines")


def run(options: argparse.Namespace) -> int:
    """Calibrate, write the file, and print how well it fits."""
    from companion.perception.camera import CalibrationError
    from companion.perception.chessboard import calibrate

    try:
        made = calibrate(options.pictures, options.board, options.square)
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
