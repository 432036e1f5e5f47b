"""`sitl-sim video`: a flight as a film."""

from __future__ import annotations

import argparse
from pathlib import Path

from mavlink_bridge.shared.options import count
from sitl_sim.commands.exit_status import EXIT_OK
from sitl_sim.commands.extras import require

HELP = "a flight as a film: the swarm, one drone's camera, and what it knows"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the run folder, whose eyes, how fast, which part, and the place."""
    parser.add_argument("folder", type=Path, metavar="RUN", help="run folder")
    parser.add_argument("--drone", metavar="NAME", help="whose camera (the middle one)")
    parser.add_argument("--speed", type=float, default=2.0, help="times real time (2)")
    parser.add_argument("--rate", type=float, default=20.0, help="pictures a second (20)")
    parser.add_argument("--width", type=count, default=1280, metavar="PX", help="px (1280)")
    parser.add_argument("--start", type=float, metavar="S", help="first second (take-off)")
    parser.add_argument("--end", type=float, metavar="S", help="last second (landing)")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="RUN/flight.mp4; .webm plays in browsers, .webp is a moving picture",
    )


def run(options: argparse.Namespace) -> int:
    """Write the film and print its path.

    Raises:
        RunError: the folder holds no whole flight.
        SettingsError: no such drone, no time to show, or the place cannot be written.
    """
    require("numba", "plotly", "tqdm")
    import cv2
    import numpy as np
    from tqdm import tqdm

    from mavlink_bridge.shared.settings import SettingsError
    from sitl_sim.figures.film import Film, span, write_film
    from sitl_sim.recording.run_folder import load_run
    from sitl_sim.scenarios.scenario import companion_names

    cv2.setNumThreads(1)
    flight = load_run(options.folder)
    names = flight.names
    flown = companion_names(flight.scenario)
    drone = options.drone or flown[len(flown) // 2]
    if drone not in names:
        raise SettingsError([f"--drone {drone}: no such drone; valid: {', '.join(names)}"])
    if min(options.speed, options.rate) <= 0:
        raise SettingsError(["--speed and --rate must be greater than 0"])
    first, last = span(flight)
    first = first if options.start is None else options.start
    last = last if options.end is None else options.end
    times = np.arange(first, last, options.speed / options.rate)
    if not len(times):
        raise SettingsError([f"--start {first:g}, --end {last:g}: no time between them"])
    film = Film(flight, names.index(drone))
    frames = (film.at(float(t)) for t in tqdm(times, unit=" pictures", disable=None))
    out = options.out or options.folder / "flight.mp4"
    print(write_film(frames, out, options.rate, options.width))
    return EXIT_OK
