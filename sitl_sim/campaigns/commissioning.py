"""Commissioning of many drones: each is mis-mounted at random, calibrated, and flown.

The companions and `companion calibrate` get the flight's log alone; what a drone truly is is
compared afterwards. Drone s has the seed s: the same seed draws the same drone in both flights.
"""

from __future__ import annotations

import json
import resource
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mavlink_bridge.shared.frames import conjugate, multiply, quaternion_from_euler, rotation_vector
from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.campaigns.run import Job, fly, metrics_of
from sitl_sim.flight.autopilots import true_airframes
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.scenario import Scenario

DRAWN = (
    "sensing.actual={roll_deg: [-10, 10], pitch_deg: [-10, 10], yaw_deg: [-10, 10], "
    "focal: [0.9, 1.1], stamp: [-0.1, 0.1]}",
    "drones.actual.thrust=[0.8, 1.2]",
    "drones.count=1",
)
_FELL_SHORT = (0, 1)  # exit statuses of `companion calibrate` that come with findings


@dataclass(frozen=True)
class Commissioned:
    """One drone: errors by name (None: refused), reasons of refusals, and how it flew then.

    mount: °, the whole rotation. lag: s. focal, hover: shares. drag: 1/s. seconds: processor time
    of the calibration. flown: whether the flight with the written configuration succeeded; None: it
    was not flown.
    """

    seed: int
    errors: dict[str, float | None]
    refused: dict[str, str]
    seconds: float
    flown: bool | None

    @property
    def whole(self) -> bool:
        """Whether nothing was refused."""
        return not self.refused


def commission(seed: int, folder: Path, overrides: Sequence[str], then: str | None) -> Commissioned:
    """Commission drone `seed` in `folder`; what is there already is not flown again.

    overrides: of both flights. then: scenario to fly with the configuration; None: none.

    Raises:
        SettingsError: bad input, or a flight that `companion calibrate` cannot read.
    """
    folder.mkdir(parents=True, exist_ok=True)
    wanted = (*DRAWN, *overrides)
    first = folder / "commission"
    if metrics_of(first) is None:
        fly(Job("commission", wanted, seed, str(first), in_process=True))
    drone = first / "drones" / "drone1"
    written = folder / "config.yaml"
    shutil.copy(drone / "config.yaml", written)
    told, seconds = _calibrated(drone / "flight.mcap", written)
    errors = _errors(scenarios.load("commission", [*wanted, f"seed={seed}"]), told["findings"])
    refused = {k: v["refused"] for k, v in told["findings"].items() if "refused" in v}
    flown = None
    if then is not None:
        second = folder / then
        if metrics_of(second) is None:
            made = _as_overrides(told["configuration"])
            fly(Job(then, (*wanted, *made), seed, str(second), in_process=True))
        flown = bool((metrics_of(second) or {})["ok"])
    result = Commissioned(seed, errors, refused, seconds, flown)
    (folder / "result.json").write_text(json.dumps(asdict(result), indent=1), encoding="utf-8")
    return result


def table(drones: Sequence[Commissioned]) -> str:
    """Return median and worst errors as a table in Markdown."""
    rows = ["| error of | told | median | worst |", "|---|---|---|---|"]
    for name, (unit, factor, _, _) in GOALS.items():
        known = [abs(e) * factor for d in drones if (e := d.errors[name]) is not None]
        told = f"{len(known)} of {len(drones)}"
        best = f"{np.median(known):.2f} {unit} | {max(known):.2f} {unit}" if known else "– | –"
        rows.append(f"| {name} | {told} | {best} |")
    seconds = [d.seconds for d in drones]
    rows.append(f"| processor time | | {np.median(seconds):.1f} s | {max(seconds):.1f} s |")
    return "\n".join(rows) + "\n"


# Unit as it is printed, factor to it, and the most that median and worst may be, in that unit.
GOALS: dict[str, tuple[str, float, float, float]] = {
    "mount": ("°", 1.0, 1.0, 4.0),
    "lag": ("ms", 1e3, 10.0, 20.0),
    "focal": ("%", 1e2, 1.0, 2.0),
    "hover": ("%", 1e2, 3.0, 6.0),
    "drag": ("1/s", 1.0, np.inf, np.inf),
}
_SECONDS = 60.0  # of one core


def reached(drones: Sequence[Commissioned]) -> bool:
    """Return whether the errors are within the goals, and all that were flown succeeded."""
    for name, (_, factor, median, worst) in GOALS.items():
        known = [abs(e) * factor for d in drones if (e := d.errors[name]) is not None]
        if not known or np.median(known) > median or max(known) > worst:
            return False
    return all(d.flown is not False and d.seconds <= _SECONDS for d in drones)


def _calibrated(log: Path, config: Path) -> tuple[dict[str, Any], float]:
    """Run `companion calibrate` on a log; return what it tells, and its processor time [s]."""
    command = [sys.executable, "-m", "companion", "calibrate", str(log), "--write", str(config)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([*command, "--json"], capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in _FELL_SHORT or not done.stdout:
        raise SettingsError([f"companion calibrate {log}: {done.stderr.strip()}"])
    spent = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return json.loads(done.stdout), spent


def _errors(scenario: Scenario, findings: dict[str, Any]) -> dict[str, float | None]:
    """Return by how much the findings are wrong; None where one was refused."""
    camera = scenario.sensing.actual.drawn(1, scenario.seed)[0]
    airframe = true_airframes(scenario)[0]
    value = {name: f.get("value") for name, f in findings.items()}
    roll, pitch, yaw = (value[f"mount {name}"] for name in ("roll", "pitch", "yaw"))
    mount = None
    if None not in (roll, pitch, yaw):
        found = quaternion_from_euler(*np.radians([roll, -pitch, yaw]).tolist())
        off = rotation_vector(multiply(conjugate(camera.turn), found))
        mount = float(np.degrees(np.linalg.norm(off)))
    drag = airframe.drag_linear[0] / airframe.mass
    return {
        "mount": mount,
        "lag": _less(value["picture lag"], camera.stamp),
        "focal": _share(value["focal scale"], camera.focal),
        "hover": _share(value["hover thrust"], airframe.hover_thrust),
        "drag": _less(value["drag"], drag),
    }


def _less(found: float | None, true: float) -> float | None:
    return None if found is None else found - true


def _share(found: float | None, true: float) -> float | None:
    return None if found is None else found / true - 1.0


def _as_overrides(configuration: dict[str, dict[str, Any]]) -> list[str]:
    """Return a configuration as overrides of the companion."""
    return [
        f"companion.{section}.{key}={json.dumps(value)}"
        for section, keys in configuration.items()
        for key, value in keys.items()
    ]
