"""Obstacles from a point cloud: upright trunks where points lie on one, boxes for all else.

1. The ground: the lowest points of each square metre, opened morphologically (what is narrower
   than 5 m stands on the ground, slopes stay); or z = 0. The world is flat: heights count
   from there.
2. Points between `world.cloud_heights` above the ground count. Those within a cell
   (`world.cloud_cell`) of each other in plan are one cluster.
3. A cluster whose points lie on a circle in plan, over a quarter of it and a metre of height, is a
   trunk. Its height is where points above it end.
4. The remaining points fill cells, which are joined to boxes. Boxes at the lower edge reach the
   ground.

Lost are: points outside these heights, single points, the lean of trunks (one that leans
much becomes boxes), and all finer than a cell. Every other point lies in an obstacle, or
within a tenth of a metre or 15 % of a radius of a trunk's surface.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import SettingsError
from sitl_sim.worlds.cells import boxes_of
from sitl_sim.worlds.world import Box, Cylinder, WorldConfig

_GROUND_CELL = 1.0  # m: holds ground points between undergrowth
_GROUND_SHARE = 0.05  # of a cell's points lie below its ground: reflections
_GROUND_OPEN = 5  # cells: wider is a hill
_LEAST_POINTS = 8  # of a cluster: fewer are noise
_RADII = (0.03, 1.5)  # m, of trunks
_SPREAD = (0.05, 0.15)  # m and share of the radius that points of a trunk may lie off its surface
_FITTED = 2000  # points of a cluster that a circle is fitted to
_CONCENTRATIONS = 10
_ON_TRUNK = 0.8  # of the points of a cluster that is a trunk
_ARC = 3  # of 12 parts of the circle that hold points
_TALL = 1.0  # m, or half of the heights that count: a lower thing is no trunk
_STEP = 0.5  # m without points ends a trunk
_MOST_CELLS = 50_000_000
_MOST_BOXES = 1000  # rendering a picture takes time for each


def obstacles_of(points: Vector, config: WorldConfig) -> tuple[list[Cylinder], list[Box]]:
    """Return the trunks and boxes that a cloud (n,3) m becomes.

    Raises:
        SettingsError: no points between the heights, or more cells or boxes than can be flown in.
    """
    low, high = config.cloud_heights
    at = points - np.array([0.0, 0.0, 1.0]) * _ground(points, config)[:, None]
    band = (at[:, 2] >= low) & (at[:, 2] <= high)
    if not band.any():
        raise _refused(config, f"holds no points from {low:g} to {high:g} m above the ground")
    taken = at[band]
    trunks: list[Cylinder] = []
    rest = np.zeros(len(taken), bool)
    plan = cKDTree(at[:, :2], balanced_tree=False)
    for members in _clusters(taken, config):
        trunk, on_it = _trunk(taken[members], at, plan, config)
        if trunk is not None:
            trunks.append(trunk)
        rest[members[~on_it]] = True
    boxes = boxes_of(taken[rest], config.cloud_cell, _LEAST_POINTS, _MOST_CELLS, low)
    if boxes is None:
        raise _refused(
            config, f"covers more than {_MOST_CELLS} cells: crop it, or enlarge cloud_cell"
        )
    if len(boxes) > _MOST_BOXES:
        raise _refused(
            config,
            f"becomes {len(boxes)} boxes, more than {_MOST_BOXES}: crop it, narrow "
            f"cloud_heights, or enlarge cloud_cell ({config.cloud_cell:g} m)",
        )
    return trunks, [Box(min=list(lowest), max=list(highest)) for lowest, highest in boxes]


def _refused(config: WorldConfig, why: str) -> SettingsError:
    return SettingsError([f"world.obstacles: {config.obstacles}: {why}"])


def _ground(points: Vector, config: WorldConfig) -> Vector:
    """Return the height (n,) m of the ground below each point."""
    if config.cloud_ground == "zero":
        return np.zeros(len(points))
    cell = np.floor(points[:, :2] / _GROUND_CELL).astype(int)
    cell -= cell.min(axis=0)
    shape = cell.max(axis=0) + 1
    if shape.prod() > _MOST_CELLS:
        raise _refused(config, f"covers {shape[0]} m by {shape[1]} m: crop it")
    flat = np.ravel_multi_index((cell[:, 0], cell[:, 1]), tuple(shape))
    order = np.lexsort((points[:, 2], flat))
    cells, first, count = np.unique(flat[order], return_index=True, return_counts=True)
    surface = np.full(int(shape.prod()), np.nan)
    surface[cells] = points[order[first + (count * _GROUND_SHARE).astype(int)], 2]
    surface = surface.reshape(shape)
    nearest = ndimage.distance_transform_edt(
        np.isnan(surface), return_distances=False, return_indices=True
    )
    wide = np.pad(surface[tuple(nearest)], _GROUND_OPEN, mode="reflect", reflect_type="odd")
    opened = ndimage.grey_opening(wide, _GROUND_OPEN)  # padded, so that slopes go on at the edge
    opened = opened[_GROUND_OPEN:-_GROUND_OPEN, _GROUND_OPEN:-_GROUND_OPEN]
    corner = np.floor(points[:, :2].min(axis=0) / _GROUND_CELL)
    where = (points[:, :2] / _GROUND_CELL - corner - 0.5).T  # from the first cell's middle
    height: Vector = ndimage.map_coordinates(opened, where, order=1, mode="nearest")
    return height


def _clusters(points: Vector, config: WorldConfig) -> list[NDArray[np.int_]]:
    """Return the members of each cluster: indices of points (n,3) that hang together in plan."""
    at = np.floor(points[:, :2] / config.cloud_cell).astype(int)
    at -= at.min(axis=0)
    shape = at.max(axis=0) + 1
    if shape.prod() > _MOST_CELLS:
        raise _refused(
            config, f"covers more than {_MOST_CELLS} cells: crop it, or enlarge cloud_cell"
        )
    full = np.zeros(shape, bool)
    full[at[:, 0], at[:, 1]] = True
    labels, number = ndimage.label(full, np.ones((3, 3)))
    label = labels[at[:, 0], at[:, 1]]
    order = np.argsort(label, kind="stable")
    bounds = np.searchsorted(label[order], np.arange(1, number + 2))
    groups = [order[a:b] for a, b in pairwise(bounds)]
    return [g for g in groups if len(g) >= _LEAST_POINTS]


def _trunk(
    members: Vector, cloud: Vector, plan: cKDTree, config: WorldConfig
) -> tuple[Cylinder | None, NDArray[np.bool_]]:
    """Return the trunk that a cluster is, if it is one, and which of its points lie on it.

    members: (m,3) m of the cluster; cloud: (n,3) m, all points, which tell how high it is; plan:
    these by x and y.
    """
    none = np.zeros(len(members), bool)
    x, y, radius = _trimmed_circle(members[:: len(members) // _FITTED + 1, :2])
    if not _RADII[0] <= radius <= _RADII[1]:
        return None, none
    on_it = np.abs(_off(members, x, y, radius)) <= max(_SPREAD[0], _SPREAD[1] * radius)
    if on_it.mean() < _ON_TRUNK:
        return None, none
    around = np.arctan2(members[on_it, 1] - y, members[on_it, 0] - x)
    parts = len(np.unique(np.floor(around / (np.pi / 6))))
    low, high = config.cloud_heights
    if parts < _ARC or np.ptp(members[on_it, 2]) < min(_TALL, (high - low) / 2):
        return None, none
    near = cloud[plan.query_ball_point((x, y), radius + config.cloud_cell), 2]
    heights = np.sort(near[near >= members[on_it, 2].max()])
    gaps = np.flatnonzero(np.diff(heights) > _STEP)
    top = float(heights[gaps[0]] if len(gaps) else heights[-1])
    return _cylinder(x, y, radius, top), on_it


def _off(points: Vector, x: float, y: float, radius: float) -> Vector:
    """Return how far (n,) m points lie outside a circle."""
    away: Vector = np.hypot(points[:, 0] - x, points[:, 1] - y) - radius
    return away


def _trimmed_circle(points: Vector) -> tuple[float, float, float]:
    """Return the circle that fits most of the points (n,2), by least trimmed squares.

    Points of branches are not on it, and would move a fit to all.
    """
    x, y, radius = circle(points)
    for _ in range(_CONCENTRATIONS):
        if not np.isfinite(radius):  # on a line, as of a wall
            break
        off = np.abs(_off(points, x, y, radius))
        x, y, radius = circle(points[off <= np.quantile(off, _ON_TRUNK)])
    return x, y, radius


def _cylinder(x: float, y: float, radius: float, height: float) -> Cylinder:
    x, y, radius, height = (round(float(v), 3) for v in (x, y, radius, height))
    return Cylinder(x=x, y=y, radius=radius, height=height)


def circle(points: Vector) -> tuple[float, float, float]:
    """Return x, y and radius [m] of the circle that fits points (n,2) best.

    Taubin's algebraic fit, which an arc of a circle biases little; the radius is infinite where
    the points lie on a line. Taubin, Estimation of planar curves, PAMI 13, 1991; Chernov's form.
    """
    middle = points.mean(axis=0)
    x, y = (points - middle).T
    z = x * x + y * y
    mean = float(z.mean())
    if mean < 1e-12:
        return float(middle[0]), float(middle[1]), 0.0
    rows = np.column_stack([(z - mean) / (2.0 * np.sqrt(mean)), x, y])
    a, b, c = np.linalg.svd(rows, full_matrices=False)[2][-1]
    a = a / (2.0 * np.sqrt(mean))
    if abs(a) < 1e-9:
        return float(middle[0]), float(middle[1]), np.inf
    d = -mean * a
    centre = middle - np.array([b, c]) / (2.0 * a)
    radius = float(np.sqrt(b * b + c * c - 4.0 * a * d) / (2.0 * abs(a)))
    return float(centre[0]), float(centre[1]), radius
