"""A soak: flights there and back for simulated hours, with random faults from a seed.

Companions run inside this process, in lockstep, one flight after another. Counted after each:
collisions of the drones that no fault grounds, memory, and open files.
"""

from __future__ import annotations

import gc
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sitl_sim.faults.catalogue import FaultConfig
from sitl_sim.figures.metrics import AIRBORNE, ground_strikes
from sitl_sim.flight.runner import flight
from sitl_sim.flight.stop_signals import stop_on_signals
from sitl_sim.scenarios.scenario import Scenario
from sitl_sim.worlds.world import surface_distance

_LEG = 14.0  # m
_LEG_SECONDS = 12.0
_WARM_UP = 2  # flights before memory counts: compiled kernels, caches
# Faults that a drone flies on with, and the range that their amount is drawn from.
TRANSIENT: dict[str, tuple[float, float] | None] = {
    "link_loss": (0.05, 0.2), "link_duplicate": (0.1, 0.4), "link_reorder": (0.1, 0.4),
    "link_flip": (0.05, 0.3), "link_garbage": (1e4, 2e5), "link_foreign": (10, 200),
    "telemetry_nan": (0.05, 0.3), "clock_jump": (-3600, 3600), "timesync_jump": (-1, 1),
    "camera_dead": None, "camera_late": (0.2, 0.3), "missed": (0.1, 0.3), "ghosts": (0.01, 0.05),
    "swaps": (0.1, 0.5), "range_bias": (0.8, 1.2), "motor": (0.8, 1.0),
    "thrust_scale": (0.85, 1.15), "gust": (1.0, 4.0), "gyro_bias": (-0.03, 0.03),
    "pause": (0.05, 0.2),
}  # fmt: skip
# Faults that end the flight of their drone.
GROUNDING: dict[str, tuple[float, float] | None] = {
    "telemetry_stale": None, "position_lost": None, "position_jump": (2.0, 20.0),
    "quaternion": (0.2, 0.9), "reboot": None, "kill": None, "stop": None,
}  # fmt: skip


@dataclass(frozen=True)
class SoakResult:
    """After one flight: simulated hours so far, faults, collisions of healthy drones, cost now."""

    hours: float
    faults: int
    grounded: int
    collisions: int
    legs: int
    rss_mb: float
    files: int


def soak(hours: float, drones: int, minutes: float, seed: int) -> Iterator[SoakResult]:
    """Fly until `hours` of simulated time are over; yield a result after each flight.

    Raises:
        RuntimeError: a companion ended with an error; with its output.
        KeyboardInterrupt: SIGINT or SIGTERM.
    """
    flown, number = 0.0, 0
    while flown < hours * 3600.0:
        rng = np.random.default_rng([seed, number])
        seconds = min(minutes * 60.0, hours * 3600.0 - flown)
        scenario, grounded = _scenario(rng, drones, seconds, seed + number)
        yield _fly(scenario, grounded, flown)
        flown += seconds
        number += 1


def growth(results: list[SoakResult]) -> tuple[float, int]:
    """Return the growth of memory [MB] and of open files since the warm-up; 0 within it."""
    warm, last = results[min(_WARM_UP, len(results)) - 1], results[-1]
    return last.rss_mb - warm.rss_mb, last.files - warm.files


def _fly(scenario: Scenario, grounded: set[int], before: float) -> SoakResult:
    with (
        tempfile.TemporaryDirectory() as folder,
        flight(scenario, Path(folder), in_process=True) as f,
    ):
        f.write_inputs()
        with stop_on_signals(f):
            f.launch()
            f.run()
        if f.stopped_by is not None:
            raise KeyboardInterrupt
        if failed := [n for n, code in f.exit_codes().items() if code]:
            said = (Path(folder) / "drones" / failed[0] / "stderr.log").read_text("utf-8")
            raise RuntimeError(f"{failed[0]}: its companion ended:\n{said}")
        truth = f.truth.arrays()
        targets = f.world["targets"]
        world = f.world
    collisions = _collisions(truth, grounded, scenario.drones.radius, world)
    legs = sum(len(t) for t in targets.values())
    del truth, f
    gc.collect()
    hours = (before + scenario.mission.time_limit) / 3600.0
    return SoakResult(
        hours, len(scenario.faults), len(grounded), collisions, legs, _rss(), _files()
    )


def _scenario(
    rng: np.random.Generator, drones: int, seconds: float, seed: int
) -> tuple[Scenario, set[int]]:
    """Return a flight there and back with faults all along, and the drones that one grounds."""
    turns = max(int(seconds / _LEG_SECONDS), 1)
    faults = [_transient(rng, drones, seconds) for _ in range(max(int(seconds / 15.0), 1))]
    grounded: set[int] = set()
    if rng.random() < 0.5:
        victim = int(rng.integers(drones))
        grounded.add(victim)
        faults.append(_fault(rng, GROUNDING, victim, rng.uniform(0.5, 1.0) * seconds, None))
    data: dict[str, Any] = {
        "name": "soak",
        "seed": seed,
        "world": {"cylinders": [{"x": 7.0, "y": 0.4, "radius": 0.5}]},
        "drones": {"count": drones, "heading_deg": 0.0, "frame_yaw_deg": "random"},
        "mission": {
            "targets": [[_LEG * (n % 2 == 0), 0.0, 2.0] for n in range(turns)],
            "home": False,
            "time_limit": seconds,
        },
        "sensing": {"neighbours": "truth", "obstacles": "map", "width": 64, "height": 64},
        "faults": faults,
    }
    return Scenario.model_validate(data), grounded


def _transient(rng: np.random.Generator, drones: int, seconds: float) -> dict[str, Any]:
    lasts = float(rng.uniform(0.3, 1.2))
    return _fault(rng, TRANSIENT, int(rng.integers(drones)), rng.uniform(0.0, seconds), lasts)


def _fault(
    rng: np.random.Generator,
    kinds: dict[str, tuple[float, float] | None],
    drone: int,
    at: float,
    lasts: float | None,
) -> dict[str, Any]:
    kind = sorted(kinds)[int(rng.integers(len(kinds)))]
    amount = kinds[kind]
    fault: dict[str, Any] = {"kind": kind, "drone": f"drone{drone + 1}", "at": float(at)}
    if lasts is not None:
        fault["for"] = lasts
    if amount is not None:
        fault["amount"] = float(rng.uniform(*amount))
    FaultConfig.model_validate(fault)
    return fault


def _collisions(
    truth: dict[str, Any], grounded: set[int], radius: float, world: dict[str, Any]
) -> int:
    """Count pairs of healthy drones that collided, and those that hit an obstacle or the ground."""
    p = truth["position"].astype(float)
    healthy = [i for i in range(p.shape[1]) if i not in grounded]
    pairs = [(a, b) for a in healthy for b in healthy if b < a]
    up = p[..., 2] > AIRBORNE
    together = sum(
        bool(((np.linalg.norm(p[:, a] - p[:, b], axis=1) < 2 * radius) & up[:, a] & up[:, b]).any())
        for a, b in pairs
    )
    struck = up & (surface_distance(p, world) < radius)
    fallen = ground_strikes(p[..., 2], truth["velocity"].astype(float), np.array(radius))
    return together + sum(bool(struck[:, i].any()) + bool(fallen[i]) for i in healthy)


def _rss() -> float:
    """Return the resident memory of this process [MB]."""
    text = Path("/proc/self/status").read_text()
    return int(text.split("VmRSS:")[1].split()[0]) / 1e3


def _files() -> int:
    """Return the number of open files of this process."""
    return len(list(Path("/proc/self/fd").iterdir()))
