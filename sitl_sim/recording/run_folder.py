"""Reading a run folder: scenario, world, truth, and each drone's log with its own frame."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.mcap_file import LogError, read_messages, salvage
from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.scenarios import placement
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.scenario import Scenario

Truth = dict[str, NDArray[Any]]
_TOLERANCE = 1.5  # m, of targets where a world has none
_OF_A_FLIGHT = ("truth.npz", "metrics.json", "drones/*/flight.*")
_ARRAYS = {"t", "position", "velocity", "attitude", "names"}


class RunError(ValueError):
    """A folder holds no whole flight; the message names the file and the mistake."""


@dataclass(frozen=True)
class OwnFrame:
    """One drone's own frame and clock, which it shares with no other drone.

    origin: (3,) m and yaw [rad] in the world. Its clock shows world time + boot [s].
    """

    origin: Vector
    yaw: float
    boot: float

    def as_data(self) -> dict[str, Any]:
        """Return the frame as `frames` of `world.json` has it, by drone name."""
        return {"origin": [float(a) for a in self.origin], "yaw": self.yaw, "boot": self.boot}

    def vectors(self, v: Any) -> Vector:
        """Return vectors (...,3) of the own frame in the world's frame."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        turned: Vector = np.asarray(v, float) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        return turned

    def points(self, p: Any) -> Vector:
        """Return points (...,3) of the own frame in the world's frame."""
        return self.vectors(p) + self.origin


@dataclass(frozen=True)
class Run:
    """One flight. truth: arrays of `truth.npz`. logs: each drone's tick records, in its frame.

    A foreign drone without a companion has an empty log.
    """

    folder: Path
    scenario: Scenario
    world: dict[str, Any]
    truth: Truth
    logs: dict[str, list[dict[str, Any]]]

    @property
    def names(self) -> list[str]:
        """Names of the drones, in the order of the truth."""
        return [str(n) for n in self.truth["names"]]

    @property
    def metrics(self) -> dict[str, Any]:
        """Contents of `metrics.json`; empty where there is none.

        Raises:
            RunError: the file is not the metrics of a flight.
        """
        path = self.folder / "metrics.json"
        try:
            return dict(json.loads(path.read_text("utf-8"))) if path.exists() else {}
        except (ValueError, TypeError) as error:
            raise RunError(f"{path}: no metrics of a flight: {error}") from error


def own_frames(scenario: Scenario, world: Mapping[str, Any]) -> list[OwnFrame]:
    """Return the own frame of each drone: `frames` of `world.json`, else as the scenario says."""
    if told := world.get("frames"):
        frames = [told[name] for name in scenarios.drone_names(scenario)]
        return [OwnFrame(np.array(f["origin"]), f["yaw"], f["boot"]) for f in frames]
    start, yaws = placement.starts(scenario), placement.frame_yaws(scenario)
    boots = placement.boot_ms(scenario)
    return [OwnFrame(o, float(y), b / 1e3) for o, y, b in zip(start, yaws, boots, strict=True)]


def log_path(folder: Path, name: str) -> Path:
    """Return the path of a drone's flight log."""
    return folder / "drones" / name / "flight.mcap"


def holds_flight(folder: Path) -> bool:
    """Return whether a flight has left its truth, metrics or logs in the folder."""
    return any(next(folder.glob(pattern), None) is not None for pattern in _OF_A_FLIGHT)


def read_ticks(path: Path) -> list[dict[str, Any]]:
    """Return every tick of a whole log, oldest first.

    Raises:
        LogError: the log is missing, empty, foreign, or cut off.
    """
    ticks = [orjson.loads(m.data) for _, m in read_messages(path, ["/tick"])]
    if not ticks:
        raise LogError(f"{path}: not a flight log of a companion: it has no ticks")
    return ticks


def salvage_ticks(path: Path) -> list[dict[str, Any]]:
    """Return the ticks that a log holds, also of a killed companion; none without a log."""
    return [orjson.loads(m.data) for m in salvage(path, "/tick")]


def load_run(folder: Path) -> Run:
    """Read a whole run folder.

    Raises:
        RunError: a file is missing, empty, foreign or cut off; the message names it.
    """
    if not folder.is_dir():
        raise RunError(f"{folder}: no such run folder")
    world = _world(folder / "world.json")
    truth = _truth(folder / "truth.npz")
    try:
        scenario = scenarios.load(str(folder / "scenario.yaml"), [])
        flown = scenarios.companion_names(scenario)
        logs = {
            str(n): read_ticks(log_path(folder, str(n))) if str(n) in flown else []
            for n in truth["names"]
        }
    except (SettingsError, LogError) as error:
        raise RunError(str(error)) from error
    shared = world["targets"].get("*", [])
    world["targets"] = {
        n: world["targets"].get(n, shared) for n in logs if n not in world.get("foreign", [])
    }
    if scenario.drones.count != len(logs):
        raise RunError(
            f"{folder}: scenario.yaml has {scenario.drones.count} drones, truth.npz {len(logs)}"
        )
    if world["frames"] and (missing := set(logs) - set(world["frames"])):
        raise RunError(f"{folder / 'world.json'}: no frame of {', '.join(sorted(missing))}")
    return Run(folder, scenario, world, truth, logs)


def _world(path: Path) -> dict[str, Any]:
    """Read `world.json`, with defaults where values may be left out."""
    try:
        world = json.loads(path.read_text("utf-8"))
        if not {"drone_radius", "cylinders", "boxes", "targets"} <= set(world):
            raise ValueError("no world of a flight")
        size = world["drone_radius"]
        if isinstance(size, dict):
            world["drone_radii"] = {str(n): float(r) for n, r in size.items()}
            size = max(world["drone_radii"].values())
        return {
            **world,
            "drone_radius": float(size),
            "cylinders": [_cylinder(c) for c in world["cylinders"]],
            "boxes": [b | {k: _point(b[k]) for k in ("min", "max")} for b in world["boxes"]],
            "targets": {n: [_point(t) for t in ts] for n, ts in world["targets"].items()},
            **({"foreign": [str(n) for n in world["foreign"]]} if "foreign" in world else {}),
            "target_tolerance": float(world.get("target_tolerance", _TOLERANCE)),
            "frames": {n: _frame(f) for n, f in world.get("frames", {}).items()},
        }
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error
    except KeyError as error:
        raise RunError(f"{path}: not a world: an obstacle or a frame lacks {error}") from error
    except (ValueError, TypeError, AttributeError) as error:
        raise RunError(f"{path}: not a world: {error}") from error


def radii(world: dict[str, Any], names: Sequence[str]) -> Vector:
    """Return the radius (n,) m of each drone."""
    own = world.get("drone_radii", {})
    return np.array([own.get(n, world["drone_radius"]) for n in names], float)


def ours(world: dict[str, Any], names: Sequence[str]) -> NDArray[np.bool_]:
    """Return (n,) which drones are ours, not foreign."""
    return np.array([n not in world.get("foreign", []) for n in names], bool)


def _cylinder(c: dict[str, Any]) -> dict[str, float]:
    """Return a cylinder with numbers; without a height it is infinitely high."""
    height = c.get("height")
    place = {k: float(c[k]) for k in ("x", "y", "radius")}
    return {**c, **place, "height": np.inf if height is None else float(height)}


def _frame(f: dict[str, Any]) -> dict[str, Any]:
    return {"origin": _point(f["origin"]), "yaw": float(f["yaw"]), "boot": float(f["boot"])}


def _point(p: Any) -> list[float]:
    x, y, z = map(float, p)
    return [x, y, z]


def _truth(path: Path) -> Truth:
    try:
        with path.open("rb") as file, np.load(file) as data:
            truth = dict(data)
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (ValueError, EOFError, zipfile.BadZipFile, KeyError) as error:
        raise RunError(f"{path}: empty, foreign or cut off: {error}") from error
    if missing := _ARRAYS - set(truth):
        raise RunError(f"{path}: lacks {', '.join(sorted(missing))}")
    if not len(truth["t"]):
        raise RunError(f"{path}: holds no instant")
    return truth
