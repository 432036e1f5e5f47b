"""The simulator from Python: load a scenario, fly it, fly it many times.

    from sitl_sim import campaign, fly, load, load_flight

    flight = fly("tunnel", seed=7)
    print(flight.ok, flight.metrics["min_agent_distance_m"])
    p = flight.position                      # (T, N, 3) m, world frame (ENU)
    again = load_flight(flight.folder)
    many = campaign("tunnel", runs=30)
    print(many.success_rate, many.interval)

The same flights as `sitl-sim run --in-process` and `sitl-sim campaign --in-process`: the same seed
gives the same truth. A script that calls `campaign` needs `if __name__ == "__main__":`, as all
scripts that start processes.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.commands.extras import require, require_controllers
from sitl_sim.recording.run_folder import Run, load_run, salvage_ticks
from sitl_sim.recording.run_folder import log_path as _log_path
from sitl_sim.recording.tables import truth_columns
from sitl_sim.scenarios import scenario as scenarios
from sitl_sim.scenarios.scenario import Scenario

if TYPE_CHECKING:
    import pandas

Changes = Mapping[str, Any]
"""Dotted key → value, as `--set` takes them: {"companion.nmpc.speed": 1.2}."""


@dataclass(frozen=True)
class FlightResult:
    """What one flight left. folder: its run folder. metrics: contents of `metrics.json`."""

    folder: Path
    metrics: dict[str, Any]

    @property
    def ok(self) -> bool:
        """Whether all targets were reached and nothing was touched."""
        return bool(self.metrics["ok"])

    @cached_property
    def truth(self) -> dict[str, NDArray[Any]]:
        """Arrays of `truth.npz` by name, 50 Hz, world frame (ENU)."""
        with np.load(self.folder / "truth.npz") as data:
            return dict(data)

    @property
    def names(self) -> list[str]:
        """Names of the N drones, in the order of the arrays."""
        return [str(n) for n in self.truth["names"]]

    @property
    def t(self) -> Vector:
        """Times (T,) s since the flight began."""
        return self.truth["t"]

    @property
    def position(self) -> Vector:
        """True positions (T,N,3) m."""
        return self.truth["position"]

    @property
    def velocity(self) -> Vector:
        """True velocities (T,N,3) m/s."""
        return self.truth["velocity"]

    @property
    def attitude(self) -> Vector:
        """True attitudes (T,N,4), quaternions w, x, y, z, body → world."""
        return self.truth["attitude"]

    def ticks(self, name: str) -> list[dict[str, Any]]:
        """Return what a drone's companion decided, a record for each tick, in its own frame.

        Raises:
            SettingsError: no drone has this name.
        """
        if name not in self.names:
            raise SettingsError([f"no drone {name!r}; valid: {', '.join(self.names)}"])
        return salvage_ticks(_log_path(self.folder, name))

    def run(self) -> Run:
        """Return scenario, world, truth and all logs.

        Raises:
            RunError: a companion died, so its log is cut off.
        """
        return load_run(self.folder)

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the truth as columns of T·N rows: t, drone, x, y, z, vx, …, qw, …, armed."""
        return truth_columns(self.truth)

    def to_pandas(self) -> pandas.DataFrame:
        """Return `columns` as a data frame; needs pandas."""
        return _data_frame(self.columns())


@dataclass(frozen=True)
class CampaignResult:
    """What many flights left. folder: of the campaign. summary: contents of `summary.json`.

    flights: those that were flown, by seed.
    """

    folder: Path
    summary: dict[str, Any]
    flights: dict[int, FlightResult]

    @property
    def success_rate(self) -> float:
        """Share of the flights that reached all targets and touched nothing; NaN without any."""
        share = self.summary["success"]
        return float("nan") if share is None else float(share)

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of `success_rate` (Wilson)."""
        low, high = self.summary["wilson_95"]
        return float(low), float(high)

    def array(self, metric: str) -> Vector:
        """Return a number of `metrics.json` of each flight, (K,), by seed; NaN where it has none.

        Raises:
            SettingsError: the flights have no such number; lists what they have.
        """
        columns = self.columns()
        if metric not in columns:
            raise SettingsError([f"no metric {metric!r}; valid: {', '.join(columns)}"])
        return columns[metric]

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return `seed` and every number of `metrics.json`, (K,) each, nested keys with dots."""
        flat = {seed: dict(_numbers("", f.metrics)) for seed, f in sorted(self.flights.items())}
        keys = dict.fromkeys(k for row in flat.values() for k in row)
        rows = {k: np.array([row.get(k, np.nan) for row in flat.values()], float) for k in keys}
        return {**rows, "seed": np.array(list(flat), int)}

    def to_pandas(self) -> pandas.DataFrame:
        """Return `columns` as a data frame, a row for each flight; needs pandas."""
        return _data_frame(self.columns())


def load(
    scenario: str | Path,
    *,
    seed: int | None = None,
    drones: int | None = None,
    controller: str | None = None,
    changes: Changes | None = None,
) -> Scenario:
    """Return a scenario, ready to fly: a packaged name or a YAML file, with changes.

    Raises:
        SettingsError: every mistake with its place, or the valid names.
    """
    return scenarios.load(str(scenario), _overrides(seed, drones, controller, changes))


def load_flight(folder: str | Path) -> FlightResult:
    """Return a recorded flight: a run folder, from Python or from the command line.

    Raises:
        RunError: the folder holds no whole flight.
    """
    run = load_run(Path(folder))
    return FlightResult(run.folder, run.metrics)


def fly(
    scenario: str | Path | Scenario,
    *,
    seed: int | None = None,
    drones: int | None = None,
    controller: str | None = None,
    changes: Changes | None = None,
    out: str | Path | None = None,
    processes: bool = False,
    progress: Callable[[float], None] = lambda t: None,
) -> FlightResult:
    """Fly once and return what the flight left.

    scenario: a name, a YAML file, or what `load` returned; then seed, drones, controller and
    changes are left out. out: run folder; else runs/NAME-SEED, or the next free one. processes: a
    process for each companion, as on drones. progress: called with the simulated time [s].

    Raises:
        SettingsError: bad input, or a module is not installed.
        RuntimeError: a companion did not start.
    """
    require("numba", "plotly")
    from sitl_sim.flight.results import finish
    from sitl_sim.flight.runner import flight
    from sitl_sim.recording.code_version import commit
    from sitl_sim.recording.new_run_folder import new_run_folder

    asked = (seed, drones, controller, changes)
    if not isinstance(scenario, Scenario):
        scenario = load(scenario, seed=seed, drones=drones, controller=controller, changes=changes)
    elif any(a is not None for a in asked):
        raise SettingsError(["seed, drones, controller and changes belong into load(…)"])
    require_controllers(scenarios.controllers(scenario))
    commit()  # looked up now: a commit made during the flight did not fly
    started = time.monotonic()
    default = Path("runs") / f"{scenario.name}-{scenario.seed}"
    with (
        _one_thread(),
        new_run_folder(None if out is None else Path(out), default) as folder,
        flight(scenario, folder, in_process=not processes) as f,
    ):
        f.write_inputs()
        f.launch()
        f.wait_for_companions()
        ready = time.monotonic() - started
        f.run(progress)
    return FlightResult(folder, finish(f, ready))


def campaign(
    scenario: str | Path,
    *,
    runs: int = 10,
    seed: int = 0,
    drones: int | None = None,
    controller: str | None = None,
    changes: Changes | None = None,
    out: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    processes: bool = False,
    table: bool = False,
    progress: Callable[[int, str], None] = lambda seed, result: None,
) -> CampaignResult:
    """Fly `runs` seeds from `seed` on; flights that exist in the folder are not flown again.

    out: folder of the campaign; else runs/campaign-NAME. workers: flights at a time; else one for
    each core. scheduler: tcp://HOST:PORT of a Dask cluster. table: keep `flights.parquet` in the
    folder. progress: called with each finished seed and its result.

    Raises:
        SettingsError: bad input, a module is not installed, or the folder holds another campaign.
    """
    optional = {"distributed": scheduler, "pyarrow": table}
    require("numba", "plotly", *(module for module, asked in optional.items() if asked))
    from sitl_sim.campaigns.campaign import Campaign
    from sitl_sim.campaigns.fly import fly as fly_campaign

    if runs < 1:
        raise SettingsError([f"runs: must be ≥ 1, got {runs}"])
    parts = ["campaign", Path(scenario).stem, *([controller] if controller else [])]
    folder = Path("runs") / "-".join(parts) if out is None else Path(out)
    overrides = _overrides(None, drones, controller, changes)
    wanted = Campaign(str(scenario), overrides, runs, seed, folder, not processes)
    require_controllers(wanted.controllers)

    @contextmanager
    def told(total: int, done: int) -> Iterator[Callable[[int, str], None]]:
        yield progress

    summary = fly_campaign(wanted, workers or os.cpu_count() or 1, scheduler, told, table)
    places = {s: wanted.run_folder(s) for s in wanted.seeds}
    flights = {
        s: FlightResult(place, json.loads((place / "metrics.json").read_text("utf-8")))
        for s, place in places.items()
        if (place / "metrics.json").exists()
    }
    return CampaignResult(folder, summary, flights)


def _overrides(
    seed: int | None, drones: int | None, controller: str | None, changes: Changes | None
) -> list[str]:
    """Return the changes as path.to.key=value; JSON is YAML."""
    named = {"seed": seed, "drones.count": drones, "companion.controller": controller}
    every = {**(changes or {}), **{k: v for k, v in named.items() if v is not None}}
    return [f"{key}={_as_yaml(key, value)}" for key, value in every.items()]


def _as_yaml(key: str, value: Any) -> str:
    try:
        return json.dumps(value, ensure_ascii=False, default=_plain)
    except TypeError as error:
        raise SettingsError([f"changes: {key}: {error}"]) from error


def _plain(value: Any) -> Any:
    """Return an array, a number of numpy or a path as JSON has it."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"no number, text, list or mapping: {value!r}")


def _numbers(path: str, value: Any) -> Iterator[tuple[str, float]]:
    """Yield every number with its dotted path; `per_drone` and lists are left out."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if key not in ("per_drone", "seed"):
                yield from _numbers(f"{path}.{key}" if path else key, inner)
    elif isinstance(value, bool | int | float):
        yield path, float(value)


def _data_frame(columns: Mapping[str, NDArray[Any]]) -> pandas.DataFrame:
    try:
        import pandas
    except ModuleNotFoundError:
        raise SettingsError(["not installed: pandas; pip install pandas"]) from None
    return pandas.DataFrame(dict(columns))


@contextmanager
def _one_thread() -> Iterator[None]:
    """Keep OpenCV to one thread meanwhile: companions would fight for the cores."""
    import cv2

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
