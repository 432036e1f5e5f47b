"""Obstacles from a file: CSV or GeoJSON, as surveys and geographic information systems write them.

Point clouds are read by `point_cloud`, and become obstacles in `cloud_obstacles`.

CSV: a header with x, y, radius [m] and perhaps height [m]; a row for each trunk. GeoJSON: Points
with the property radius, perhaps height; longitude and latitude count from the mean of all points,
which becomes the world's origin, or from `origin: [longitude, latitude]` of the collection.
"""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from mavlink_bridge.shared.explain import Key
from mavlink_bridge.shared.settings import Document, SettingsError, validate
from sitl_sim.worlds.geodesy import GeoReference
from sitl_sim.worlds.point_cloud import SUFFIXES, read_points
from sitl_sim.worlds.world import Cylinder, WorldConfig

_KEY = "world.obstacles"
_NEEDED, _ALLOWED = ("x", "y", "radius"), ("x", "y", "radius", "height")


def with_file(world: WorldConfig) -> WorldConfig:
    """Return the world with the obstacles of its file beside its own, and without the file.

    Raises:
        SettingsError: the file cannot be read, or holds mistakes; the message names each.
    """
    if world.obstacles is None:
        return world
    path = Path(world.obstacles)
    if path.suffix.lower() not in SUFFIXES:
        trunks = [*world.cylinders, *read_obstacles(path)]
        return world.model_copy(update={"obstacles": None, "cylinders": trunks})
    points = read_points(path)
    from sitl_sim.worlds.cloud_obstacles import obstacles_of  # scipy: not for every flight

    found, boxes = obstacles_of(points, world)
    return world.model_copy(
        update={
            "obstacles": None,
            "cylinders": [*world.cylinders, *found],
            "boxes": [*world.boxes, *boxes],
        }
    )


def read_obstacles(path: Path) -> list[Cylinder]:
    """Return the trunks of a file, .csv or .geojson.

    Raises:
        SettingsError: every mistake, with file and row, or file and feature.
    """
    try:
        text = path.read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise SettingsError([f"{_KEY}: {path}: cannot be read: {why}"]) from error
    readers = {".csv": _from_csv, ".geojson": _from_geojson, ".json": _from_geojson}
    if path.suffix.lower() not in readers:
        raise SettingsError([f"{_KEY}: {path}: must end in .csv, .geojson, .pcd or .ply"])
    found, problems = [], []
    for where, row in readers[path.suffix.lower()](path, text):
        try:
            found.append(_cylinder(where, row))
        except SettingsError as error:
            problems += error.problems
    if problems:
        raise SettingsError(problems)
    if not found:
        raise SettingsError([f"{_KEY}: {path}: holds no obstacle"])
    return found


def _cylinder(where: str, row: dict[str, Any]) -> Cylinder:
    """Return a trunk; values are numbers or their text."""
    try:
        numbers = {k: float(v) for k, v in row.items() if v not in (None, "")}
    except (ValueError, TypeError) as error:
        raise SettingsError([f"{where}: {error}"]) from error
    places: dict[Key, str] = {(key,): where for key in (*_ALLOWED, *numbers)}
    return validate(Cylinder, Document(dict(numbers), places), where)


def _from_csv(path: Path, text: str) -> list[tuple[str, dict[str, Any]]]:
    table = csv.DictReader(text.splitlines())
    columns = [c.strip() for c in table.fieldnames or ()]
    if not set(_NEEDED) <= set(columns):
        raise SettingsError([f"{path}:1: needs the columns x, y, radius, has {', '.join(columns)}"])
    table.fieldnames = columns
    rows = []
    for row in table:
        where = f"{path}:{table.line_num}"
        rows.append((where, {k: v for k, v in row.items() if k in _ALLOWED}))
    return rows


def _from_geojson(path: Path, text: str) -> list[tuple[str, dict[str, Any]]]:
    try:
        data = json.loads(text)
        features = data["features"]
        shapes = [f["geometry"]["type"] for f in features]
        if wrong := [i for i, shape in enumerate(shapes) if shape != "Point"]:
            at = wrong[0]
            raise SettingsError([f"{path}: features.{at}: must be a Point, got {shapes[at]}"])
        degrees = np.array([f["geometry"]["coordinates"][:2] for f in features], float)
        if not len(degrees):
            return []
        origin = np.array(data.get("origin") or degrees.mean(axis=0), float)
        if not np.isfinite(degrees).all() or (np.abs(degrees) > (180.0, 90.0)).any():
            raise ValueError("coordinates must be longitude, latitude [degrees]")
        reference = GeoReference(float(origin[1]), float(origin[0]))
        rows = []
        for i, (feature, (longitude, latitude)) in enumerate(zip(features, degrees, strict=True)):
            x, y = reference.to_metres(float(latitude), float(longitude))
            given = {k: v for k, v in (feature["properties"] or {}).items() if k in _ALLOWED[2:]}
            rows.append((f"{path}: features.{i}", {"x": round(x, 4), "y": round(y, 4), **given}))
    except SettingsError:
        raise
    except (ValueError, TypeError, LookupError, AttributeError) as error:
        why = f"not GeoJSON: {type(error).__name__}: {' '.join(str(error).split())}"
        raise SettingsError([f"{_KEY}: {path}: {why}"]) from error
    return rows
