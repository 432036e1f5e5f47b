"""How hard a world is to fly through, before anybody does: Yu et al., "FlightBench", 2024.

For each drone a guide path, the shortest one through the world at the height of its goals, is
drawn. Along it follow spheres of free room, each as large as it can be:

- traversability obstruction: how narrow the narrower half of the spheres is, s / 2 · mean(1 / r)
  with s = 4 m; 0.5 where there is nothing for 4 m around;
- angle over length: how sharply the path turns, Σ (e^(2θ/π) − 1) over its length [1/m], at goals
  e^(6θ/π);
- trunks per hectare, of the rectangle round all paths, half the widest sphere wider.

Unlike there, spheres lie where there is most room across the path, instead of at the best of forty
random places.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from mavlink_bridge.shared.arrays import Vector, norm
from sitl_sim.worlds.world import surface_distance

SENSED = 4.0  # m, largest radius of a sphere
_CELL, _AROUND = 0.25, 6.0  # m: grid of the guide path, and how far round starts and goals it lies
_STEP = 0.05  # m between the places of a straight way at which it is checked
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))  # to half of the eight cells around
_LEAST = 0.05  # m, of a sphere
_HECTARE = 1e4  # m²


class NoWay(ValueError):
    """A goal that cannot be reached; the message names the leg."""


@dataclass(frozen=True)
class Difficulty:
    """Of one world: the means over its paths; length: m of one."""

    obstruction: float
    angle_over_length: float
    length: float
    trunks_per_hectare: float


def difficulty(
    world: dict[str, Any], starts: Vector, goals: Sequence[Vector], radius: float
) -> Difficulty:
    """Return how hard a world is; starts (n,2 or 3) m, goals: (k,3) m of each. radius: m, a drone.

    Raises:
        NoWay: a goal that no path reaches.
    """
    paths = [
        guide_path(world, np.append(start[:2], own[0, 2]), own, radius)
        for start, own in zip(starts, goals, strict=True)
    ]
    rooms = [_room(world, legs, radius) for legs in paths]
    lengths = [sum(norm(d) for leg in legs for d in np.diff(leg, axis=0)) for legs in paths]
    turns = [
        _turning(legs) / max(length, _CELL) for legs, length in zip(paths, lengths, strict=True)
    ]
    narrow = [np.sort(radii)[: max(1, len(radii) // 2)] for radii in rooms]
    return Difficulty(
        float(np.mean([SENSED / 2 * (1 / radii).mean() for radii in narrow])),
        float(np.mean(turns)),
        float(np.mean(lengths)),
        _density(world, np.vstack([leg for legs in paths for leg in legs])),
    )


def guide_path(world: dict[str, Any], start: Vector, goals: Vector, radius: float) -> list[Vector]:
    """Return the shortest way from start (3,) m by goals (k,3) m, each leg as corners (m,3).

    Raises:
        NoWay: a goal that cannot be reached.
    """
    points = np.vstack([start, goals])
    low = points[:, :2].min(axis=0) - _AROUND
    shape = np.ceil((points[:, :2].max(axis=0) + _AROUND - low) / _CELL).astype(int) + 1
    legs = []
    for number, (here, there) in enumerate(pairwise(points), 1):
        x, y = np.meshgrid(*(low[k] + _CELL * np.arange(shape[k]) for k in (0, 1)), indexing="ij")
        places = np.stack([x, y, np.full_like(x, there[2])], axis=-1)
        free = surface_distance(places, world) > radius
        ends = [tuple(np.round((p[:2] - low) / _CELL).astype(int)) for p in (here, there)]
        cells = _shortest(free, *ends)
        if not len(cells):
            raise NoWay(f"leg {number}: no way to {np.round(there, 2).tolist()}")
        corners = [np.array([*here[:2], there[2]]), *places[cells[1:-1, 0], cells[1:-1, 1]], there]
        legs.append(_pulled(world, np.array(corners), radius))
    return legs


def _shortest(free: Any, start: Any, end: Any) -> Any:
    """Return the cells (m,2) of the shortest way between two free ones; none where there is none.

    The ends count as free.
    """
    free = free.copy()
    free[start] = free[end] = True
    index = np.arange(free.size).reshape(free.shape)
    rows, columns, costs = [], [], []
    for dx, dy in _STEPS:
        a = (slice(None, -dx or None), slice(max(0, -dy), -dy if dy > 0 else None))
        b = (slice(dx, None), slice(max(0, dy), dy if dy < 0 else None))
        open_ = free[a] & free[b]
        rows.append(index[a][open_])
        columns.append(index[b][open_])
        costs.append(np.full(len(rows[-1]), np.hypot(dx, dy)))
    ends = (np.concatenate(rows), np.concatenate(columns))
    graph = coo_matrix((np.concatenate(costs), ends), shape=(free.size, free.size))
    source, cell = int(index[end]), int(index[start])
    _, towards = dijkstra(graph.tocsr(), False, source, return_predecessors=True)
    found = [cell]
    while cell != source:
        cell = int(towards[cell])
        if cell < 0:
            return np.zeros((0, 2), int)
        found.append(cell)
    return np.column_stack(np.unravel_index(found, free.shape))


def _pulled(world: dict[str, Any], corners: Vector, radius: float) -> Vector:
    """Return the corners (m,3) that are left where the way is pulled tight."""
    left, at = [corners[0]], 0
    while at < len(corners) - 1:
        ends = range(len(corners) - 1, at + 1, -1)
        at = next((k for k in ends if _straight(world, corners[at], corners[k], radius)), at + 1)
        left.append(corners[at])
    return np.array(left)


def _straight(world: dict[str, Any], a: Vector, b: Vector, radius: float) -> bool:
    share = np.linspace(0.0, 1.0, int(norm(b - a) / _STEP) + 2)[:, None]
    return bool((surface_distance(a + share * (b - a), world) > radius).all())


def _room(world: dict[str, Any], legs: list[Vector], radius: float) -> Vector:
    """Return the radii (m,) of the spheres along a path, each centred where the last one ends."""
    corners = np.vstack([legs[0][:1], *(leg[1:] for leg in legs)])
    pieces = np.diff(corners, axis=0)
    sizes = np.sqrt((pieces**2).sum(axis=1))
    ends, radii = np.cumsum(sizes), []
    done = 0.0
    while True:
        k = min(int(np.searchsorted(ends, done, "right")), len(pieces) - 1)
        ahead = pieces[k] / max(sizes[k], 1e-9)
        place = corners[k] + (done - (ends[k] - sizes[k])) * ahead
        aside = np.linspace(-1.0, 1.0, 41)[:, None] * np.array([-ahead[1], ahead[0], 0.0])
        free = surface_distance(place + aside, world) - radius
        radii.append(float(np.clip(free.max(), _LEAST, SENSED)))
        done += radii[-1]
        if done >= ends[-1]:
            return np.array(radii)


def _turning(legs: list[Vector]) -> float:
    """Return the sum of what turns cost."""
    total, before = 0.0, None
    for leg in legs:
        for piece, d in enumerate(np.diff(leg, axis=0)):
            ahead = d / max(norm(d), 1e-9)
            if before is not None:
                angle = float(np.arccos(np.clip(ahead @ before, -1.0, 1.0)))
                total += float(np.expm1((6.0 if piece == 0 else 2.0) * angle / np.pi))
            before = ahead
    return total


def _density(world: dict[str, Any], corners: Vector) -> float:
    """Return the trunks per hectare of the rectangle round paths with these corners (n,3)."""
    low, high = (
        f(corners[:, :2], axis=0) + d for f, d in ((np.min, -SENSED / 2), (np.max, SENSED / 2))
    )
    standing = [(c["x"], c["y"]) for c in world.get("cylinders", [])]
    standing += [tuple(c["a"][:2]) for c in world.get("capsules", [])]
    places = np.reshape(standing, (-1, 2))
    inside = ((places >= low) & (places <= high)).all(axis=1)
    return float(inside.sum() / np.prod(high - low) * _HECTARE)
