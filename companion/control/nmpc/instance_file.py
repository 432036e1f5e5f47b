"""Sets of instances as files: one npz of arrays, so that any user's instances can be measured.

There are n instances, with sizes as in `Instance`. Fewer neighbours, cylinders or planes than
configured are padded; more are cut, as the most critical and the nearest come first:

    sequence (n,)             instances of one number follow each other at dt; the first of each
                              starts cold, the rest warm
    x0 (n,10)                 p, v [m, m/s; world ENU], q_wb (w,x,y,z)
    u_last (n,4)              the last input sent: c [m/s²], body rates [rad/s; FLU]
    goal (n,3)  speed (n,)    [m], [m/s]
    v_max (n,)                optional, else the config's: bound of (32) [m/s]
    yaw (n,)                  line of sight [rad; world ENU]
    neighbour_p, neighbour_v (n,J,3)   neighbour_sigma (n,J,2)
    neighbour_cohesion, neighbour_active (n,J)
    cylinders (n,K,3)  cylinder_active (n,K)      x, y, radius
    planes (n,H,4)     plane_active (n,H)         n, b; free where n·p <= b
    disturbance (n,3)         [m/s²]
    flight, kind (n,)         optional names of the flight and of the situation, for the tables
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from companion.control.nmpc.config import NmpcConfig
from companion.control.nmpc.instance import Instance
from mavlink_bridge.shared.arrays import Vector

# Arrays with a second axis of any length: prefix of their names, key of the config.
PADDED = {"neighbour": "neighbours", "cylinder": "cylinders", "plane": "planes"}
# Further axes of each array.
AXES: dict[str, tuple[int, ...]] = {
    "x0": (10,),
    "u_last": (4,),
    "goal": (3,),
    "disturbance": (3,),
    "speed": (),
    "v_max": (),
    "yaw": (),
    "neighbour_p": (3,),
    "neighbour_v": (3,),
    "neighbour_sigma": (2,),
    "neighbour_cohesion": (),
    "neighbour_active": (),
    "cylinders": (3,),
    "cylinder_active": (),
    "planes": (4,),
    "plane_active": (),
}


class InstancesError(Exception):
    """A file that is not a set of instances; the message names the file and the array."""


@dataclass(frozen=True)
class Run:
    """Instances that follow each other, the name of their flight and their kind of situation."""

    flight: str
    kind: str
    instances: tuple[Instance, ...]


def stored() -> Path:
    """Return the packaged set, recorded in simulated flights."""
    return Path(str(resources.files("companion.control.nmpc").joinpath("instances.npz")))


def save(path: Path, runs: Sequence[Run]) -> None:
    """Write a set of instances."""
    every = [i for run in runs for i in run.instances]
    arrays: dict[str, Any] = {
        f.name: np.array([getattr(i, f.name) for i in every]) for f in fields(Instance)
    }
    counts = [len(run.instances) for run in runs]
    arrays["sequence"] = np.repeat(np.arange(len(runs)), counts)
    for name in ("flight", "kind"):
        arrays[name] = np.repeat([getattr(run, name) for run in runs], counts)
    np.savez_compressed(path, **arrays)


def load(path: Path, config: NmpcConfig) -> list[Run]:
    """Return a set of instances in the sizes of `config`.

    Raises:
        InstancesError: a missing file, not an npz, or an array that is missing or does not fit.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as data:
            given = {name: data[name] for name in data.files}
    except Exception as error:  # a damaged file raises any error in numpy
        raise InstancesError(f"{path}: not an npz of arrays: {error}") from error
    given.setdefault("v_max", np.full(np.shape(given.get("speed", ())), config.v_max))
    missing = [name for name in ("sequence", *AXES) if name not in given]
    if missing:
        raise InstancesError(f"{path}: no array {missing[0]!r}; needed: sequence, {_list(AXES)}")
    sequence = given["sequence"]
    if np.ndim(sequence) != 1 or not len(sequence) or not np.isfinite(sequence).all():
        raise InstancesError(
            f"{path}: sequence is {sequence.dtype} {np.shape(sequence)}, wanted a number for each "
            "instance, at least one"
        )
    rows = {name: _fitted(path, name, given[name], len(sequence), config) for name in AXES}
    names = {n: given.get(n, np.full(len(sequence), "all")) for n in ("flight", "kind")}
    for name, given_names in names.items():
        if np.shape(given_names) != np.shape(sequence):
            raise InstancesError(
                f"{path}: {name} is {np.shape(given_names)}, wanted {np.shape(sequence)}"
            )
    found = []
    for number in np.unique(sequence):
        which = np.flatnonzero(sequence == number)
        instances = tuple(_instance({n: rows[n][r] for n in rows}) for r in which)
        first = which[0]
        found.append(Run(str(names["flight"][first]), str(names["kind"][first]), instances))
    return found


def _list(names: Sequence[str] | dict[str, Any]) -> str:
    return ", ".join(names)


def _fitted(path: Path, name: str, given: Any, count: int, config: NmpcConfig) -> Vector:
    """Return an array as numbers, its second axis padded or cut where it may have any length."""
    key = next((k for prefix, k in PADDED.items() if name.startswith(prefix)), None)
    many = 0 if key is None else 1
    shape = np.shape(given)
    wanted = (count, *(["any length"] * many), *AXES[name])
    fits = len(shape) == len(wanted) and shape[:1] == (count,)
    if not (fits and shape[1 + many :] == AXES[name] and np.issubdtype(given.dtype, np.number)):
        raise InstancesError(f"{path}: {name} is {given.dtype} {shape}, wanted numbers {wanted}")
    array: Vector = np.asarray(given, dtype=float)
    if key is None:
        return array
    size = int(getattr(config, key))
    array = array[:, :size]
    return np.pad(array, [(0, 0), (0, size - array.shape[1])] + [(0, 0)] * (array.ndim - 2))


def _instance(row: dict[str, Vector]) -> Instance:
    """Return the instance of one row of all arrays."""
    numbers: dict[str, Any] = dict(row)
    for name in ("speed", "v_max", "yaw"):
        numbers[name] = float(numbers[name])
    return Instance(**numbers)
