"""A flight as tables: the truth, and what each companion decided; CSV and Parquet."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sitl_sim.recording.run_folder import Run, own_frames

Columns = Mapping[str, NDArray[Any]]
_LONGEST_VECTOR = 4  # longer lists are left out: plans, tracks, detections
_DIGITS = 6


def truth_columns(truth: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the truth as columns of T·N rows: t, drone, x, y, z, vx, …, qw, …, armed.

    World frame (ENU), SI, time [s] since the flight began; q turns body → world.
    """
    names, t = truth["names"], truth["t"]
    n, steps = len(names), len(t)
    rows: dict[str, NDArray[Any]] = {"t": np.repeat(t, n), "drone": np.tile(names, steps)}
    for array, keys in (
        ("position", ("x", "y", "z")),
        ("velocity", ("vx", "vy", "vz")),
        ("attitude", ("qw", "qx", "qy", "qz")),
    ):
        flat = truth[array].reshape(steps * n, -1)
        rows.update({key: flat[:, i] for i, key in enumerate(keys)})
    if "armed" in truth:
        rows["armed"] = truth["armed"].reshape(-1)
    return rows


def tick_columns(run: Run) -> dict[str, NDArray[Any]]:
    """Return every tick of every drone as a row: t, drone, and each number of the tick record.

    t: s since the flight began, by the vehicle's clock. Nested keys have dots, items of short
    vectors a number; everything else is in the drone's own frame, as in the log.
    """
    rows: list[dict[str, Any]] = []
    frames = dict(zip(run.names, own_frames(run.scenario, run.world), strict=True))
    for name, ticks in run.logs.items():
        boot = frames[name].boot
        rows += [
            {"t": round(tick["time"] - boot, _DIGITS), "drone": name, **dict(_flat("", tick))}
            for tick in ticks
        ]
    keys = dict.fromkeys(key for row in rows for key in row)
    return {key: _column([row.get(key) for row in rows]) for key in keys}


def write_csv(path: Path, columns: Columns) -> None:
    """Write a CSV file with a header; what is missing is empty."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(columns)
        for row in zip(*(c.tolist() for c in columns.values()), strict=True):
            table.writerow(["" if v is None or v != v else v for v in row])


def write_parquet(path: Path, columns: Columns) -> None:
    """Write a Parquet file; needs pyarrow."""
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table(dict(columns)), path)


WRITERS: dict[str, Callable[[Path, Columns], None]] = {"csv": write_csv, "parquet": write_parquet}


def write_tables(run: Run, kind: str, folder: Path) -> list[Path]:
    """Write the tables `truth` and `ticks` of a flight as `kind`; return their files."""
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    for name, columns in (("truth", truth_columns(run.truth)), ("ticks", tick_columns(run))):
        made.append(folder / f"{name}.{kind}")
        WRITERS[kind](made[-1], columns)
    return made


def _flat(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield every number and text with its dotted path."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(f"{path}.{key}" if path else key, inner)
    elif isinstance(value, list):
        if 0 < len(value) <= _LONGEST_VECTOR and all(isinstance(v, int | float) for v in value):
            for i, item in enumerate(value):
                yield f"{path}.{i}", item
    elif value is not None:
        yield path, value


def _column(values: list[Any]) -> NDArray[Any]:
    """Return the values as numbers, NaN where one is missing, or as text."""
    if any(isinstance(v, str) for v in values):
        return np.array(["" if v is None else str(v) for v in values])
    return np.array([np.nan if v is None else v for v in values], float)
