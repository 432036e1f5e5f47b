"""The cost of each stage of a tick: a recorded flight runs through the present code.

A log keeps no pixels: `see` reads what was found in the pictures of the flight, and costs next to
nothing. Processor time of this thread is measured, so that other work on the machine hardly counts.
"""

from __future__ import annotations

import json
import subprocess
import time
from importlib import resources
from pathlib import Path

import numpy as np

from companion.flightlog.reader import read_log
from companion.flightlog.replay import configured, flown
from mavlink_bridge.shared.settings import SettingsError
from mavlink_bridge.shared.stage_costs import Costs

WHOLE = "tick"


def stored() -> Path:
    """Return the packaged flight: one of five drones through a few trunks."""
    return Path(str(resources.files("companion.bench").joinpath("flight.mcap")))


def stage_costs(log: Path) -> Costs:
    """Return the processor time [ms] of each stage, and of their sum, in a flight's ticks.

    Raises:
        LogError, SettingsError: a log that cannot be read or flown any more.
    """
    recorded = read_log(log)
    config = configured(recorded)
    ticks = [tick.stages for tick in flown(config, recorded.inputs, time.thread_time)]
    names = dict.fromkeys(name for stages in ticks for name in stages)
    times = {WHOLE: [sum(stages.values()) for stages in ticks]}
    times |= {name: [stages[name] for stages in ticks if name in stages] for name in names}
    return {
        name: {"p50": _milliseconds(taken, 50), "p99": _milliseconds(taken, 99)}
        for name, taken in times.items()
    }


def stage_costs_of(python: str, log: Path) -> Costs:
    """Return what `stage_costs` of the release in another environment returns.

    Raises:
        SettingsError: there is no such interpreter, or its release cannot measure this.
    """
    command = [python, "-m", "companion", "bench", "tick", str(log), "--json"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise SettingsError([f"--against {python}: {error.strerror}"]) from error
    if done.returncode != 0:
        said = done.stderr.strip().splitlines()
        raise SettingsError([f"{' '.join(command)}: {said[-1] if said else 'it failed'}"])
    found: list[Costs] = json.loads(done.stdout)
    return found[0]


def _milliseconds(taken: list[float], quantile: float) -> float:
    return round(float(np.percentile(taken, quantile)) * 1e3, 3)
