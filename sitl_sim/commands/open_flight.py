"""What `run` and `serve` have in common: the scenario, its run folder, its wire table."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from sitl_sim.commands.extras import require_controllers
from sitl_sim.commands.scenario_options import add_scenario_arguments, overrides

if TYPE_CHECKING:
    from sitl_sim.flight.runner import Flight


def add_flight_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scenario with its changes, --seed and --out."""
    add_scenario_arguments(parser)
    parser.add_argument("--seed", type=int, metavar="S")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="run folder (runs/NAME-SEED, or the next free one)"
    )


_MANY = 3  # drones from which further processes pay for an in-process flight
_HOSTS_MOST = 8  # this process, which simulates, feeds no more


@contextmanager
def open_flight(
    options: argparse.Namespace, real_time: bool, in_process: bool = False
) -> Iterator[Flight]:
    """Yield the flight that the options ask for, with its inputs written; stop signals stop it.

    Raises:
        SettingsError: the scenario or the run folder cannot be used.
        EndpointError, VideoError: a port is in use.
    """
    import cv2

    from sitl_sim.flight.hosts import cores
    from sitl_sim.flight.runner import flight
    from sitl_sim.flight.stop_signals import stop_on_signals
    from sitl_sim.recording.code_version import commit
    from sitl_sim.recording.new_run_folder import new_run_folder
    from sitl_sim.scenarios import scenario as scenarios

    cv2.setNumThreads(1)
    commit()  # looked up now: a commit made during the flight did not fly
    changes = overrides(options)
    if options.seed is not None:
        changes.append(f"seed={options.seed}")
    scenario = scenarios.load(options.scenario, changes)
    require_controllers(scenarios.controllers(scenario))
    shared = in_process and not real_time and scenario.drones.count >= _MANY
    hosts = min(cores(), _HOSTS_MOST) if shared else 0
    default = Path("runs") / f"{scenario.name}-{scenario.seed}"
    with (
        new_run_folder(options.out, default) as folder,
        flight(scenario, folder, real_time, in_process, hosts) as f,
        stop_on_signals(f),
    ):
        if options.out is None and folder != default:
            print(f"{default} holds a flight; this one goes to {folder}", file=sys.stderr)
        f.write_inputs()
        for line in f.wire_table():
            print(line, file=sys.stderr)
        yield f
