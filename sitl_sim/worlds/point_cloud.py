"""Points from a PCD or PLY file, as laser scanners and mapping programs write them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import SettingsError

SUFFIXES = (".pcd", ".ply")
_KEY = "world.obstacles"
_HEAD = 10_000  # bytes: more than a header has
_FAR = 10_000.0  # m: coordinates beyond this are a map's, not a world's


def read_points(path: Path) -> Vector:
    """Return the points (n,3) m of a file, .pcd or .ply, text or binary; ENU as the file has them.

    Points that are not finite (a scanner's rays that met nothing) are left out.

    Raises:
        SettingsError: the file cannot be read, or holds no points; one line with its name.
        ModuleNotFoundError: the extra `clouds` is not installed.
    """
    read = _pcd if path.suffix.lower() == ".pcd" else _ply
    try:
        points = np.asarray(read(path), np.float64)
    except OSError as error:
        raise _refused(path, f"cannot be read: {error.strerror or error}") from error
    except (ModuleNotFoundError, SettingsError):
        raise
    except Exception as error:  # the libraries raise what their parsing comes upon
        lines = str(error).split("\n")
        why = f"{type(error).__name__}: {' '.join(lines[:3])}"
        kind = path.suffix[1:].upper()
        raise _refused(path, f"cut off, or not a {kind} file: {why}") from error
    points = points.reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        raise _refused(path, "holds no points")
    farthest = float(np.abs(points).max())
    if farthest > _FAR:
        raise _refused(
            path,
            f"points count up to {farthest:.0f} m: must be within {_FAR:.0f} m of the world's "
            "origin; move the cloud",
        )
    return points


def _pcd(path: Path) -> Vector:
    from pypcd4.pypcd4 import PointCloud

    cloud = PointCloud.from_path(path)
    missing = [field for field in "xyz" if field not in cloud.fields]
    if missing:
        raise _refused(path, f"has no field {missing[0]}; fields: {', '.join(cloud.fields)}")
    found: Vector = cloud.numpy(("x", "y", "z"))
    if len(found) != cloud.metadata.points:
        raise _refused(path, f"cut off: {len(found)} of {cloud.metadata.points} points")
    return found


def _ply(path: Path) -> Vector:
    from trimesh.exchange.ply import load_ply

    with path.open("rb") as file:
        loaded = load_ply(file)
        file.seek(0)
        stated = re.search(rb"element vertex (\d+)", file.read(_HEAD))
    found: Vector = loaded["vertices"]
    if stated is None or len(found) != int(stated[1]):
        raise _refused(path, f"cut off: {len(found)} of {stated and int(stated[1])} points")
    return found


def _refused(path: Path, why: str) -> SettingsError:
    return SettingsError([f"{_KEY}: {path}: {why}"])
