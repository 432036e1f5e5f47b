"""`sitl-sim window`: the world around a vehicle that has physics of its own.

It ends when the companion has landed, the vehicle reboots, or by a signal: SIGTERM with the
flight's exit status, Ctrl-C with 130. Truth, metrics and report are written in each case.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sitl_sim.commands.exit_status import EXIT_FELL_SHORT, EXIT_INTERRUPTED, EXIT_OK
from sitl_sim.commands.extras import require

if TYPE_CHECKING:
    from sitl_sim.flight.window import Window

HELP = "the world around a vehicle with physics of its own: PX4 SIH, Gazebo, a drone on a bench"
_PX4_ONBOARD = "udpin:127.0.0.1:14540"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scenario, the run folder and the vehicle's links."""
    parser.add_argument("scenario", help="a name (forest, …) or a YAML file; one drone of it")
    parser.add_argument(
        "--vehicle",
        required=True,
        metavar="URL",
        help="the vehicle's MAVLink for the window: udpin:HOST:PORT, udpout:HOST:PORT, "
        "tcp:HOST:PORT or serial:DEVICE:BAUD",
    )
    parser.add_argument("--system", type=int, default=1, metavar="ID", help="MAVLink id (1)")
    parser.add_argument(
        "--companion",
        default=_PX4_ONBOARD,
        metavar="URL",
        help=f"another of its links, for the companion's configuration ({_PX4_ONBOARD})",
    )
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides")
    parser.add_argument("--seed", type=int, metavar="S")
    parser.add_argument("--out", type=Path, metavar="DIR", help="run folder (runs/NAME-SEED)")
    parser.add_argument("--json", action="store_true", help="print metrics.json instead of a table")


def run(options: argparse.Namespace) -> int:
    """Find the vehicle, show the world, write and print the figures.

    Raises:
        SettingsError, EndpointError, VideoError, ExternalError: bad input.
    """
    require("numba", "plotly")
    import cv2

    from mavlink_bridge.shared.settings import SettingsError
    from mavlink_bridge.wire.link import parse_endpoint
    from sitl_sim.flight.results import finish, table
    from sitl_sim.flight.stop_signals import stop_on_signals
    from sitl_sim.flight.window import open_window
    from sitl_sim.recording.code_version import commit
    from sitl_sim.recording.new_run_folder import new_run_folder
    from sitl_sim.scenarios import scenario as scenarios

    cv2.setNumThreads(1)
    commit()  # looked up now: a commit made meanwhile was not flown
    started = time.monotonic()
    if not 1 <= options.system <= 255:
        raise SettingsError([f"--system: must be 1 to 255, got {options.system}"])
    parse_endpoint(options.companion)
    seed = [] if options.seed is None else [f"seed={options.seed}"]
    scenario = scenarios.load(options.scenario, [*options.overrides, *seed, "drones.count=1"])
    if scenario.faults:
        raise SettingsError(["faults: a window has none; they need vehicles of the simulator"])
    default = Path("runs") / f"{scenario.name}-{scenario.seed}"
    with (
        new_run_folder(options.out, default) as folder,
        open_window(scenario, folder, options.vehicle, options.system, _say) as window,
        stop_on_signals(window),
    ):
        window.find_vehicle()
        config = window.write_inputs(options.companion)
        _say(f"{window.vehicle.autopilot}, system {options.system}, is at the start of the world")
        _say(f"companion: companion run {config}")
        setup_seconds = time.monotonic() - started
        window.run()
        interrupted = window.stopped_by == signal.SIGINT
        if not window.shown:
            _say("no companion came: nothing is recorded")
            return EXIT_INTERRUPTED if interrupted else EXIT_FELL_SHORT
        metrics = finish(window, setup_seconds, interrupted=interrupted)
        metrics |= _of_window(window)
        (folder / "metrics.json").write_text(json.dumps(metrics, indent=1), encoding="utf-8")
    print(json.dumps(metrics, indent=1) if options.json else table(metrics, folder))
    if not options.json:
        print(_summary(metrics))
    if interrupted:
        return EXIT_INTERRUPTED
    return EXIT_OK if metrics["ok"] else EXIT_FELL_SHORT


def _of_window(window: Window) -> dict[str, Any]:
    from sitl_sim.figures.metrics import quantiles

    ages = quantiles([age * 1e3 for age in window.ages])
    return {"contacts": window.contacts, "pictures": len(window.ages), "picture_age_ms": ages}


def _summary(metrics: dict[str, Any]) -> str:
    age = " / ".join("–" if v is None else f"{v:.0f}" for v in metrics["picture_age_ms"].values())
    return f"{metrics['pictures']} pictures, {age} ms old when sent (p50 / p99 / max)"


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
