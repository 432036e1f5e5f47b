"""The way round trunks that stand too close to each other to pass between.

One trunk is passed by the NMPC itself. Two with too little room between them are a wall with a
pocket before it, in which the plan, which sees a few metres, would wait for ever. The shortest way
round is found on a visibility graph (Lozano-Pérez and Wesley, "An algorithm for planning
collision-free paths among polyhedral obstacles", 1979), its nodes around the trunks concerned.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from companion.types import Vector

_NODES = 8  # around a trunk
_OUT = 1.02 / math.cos(math.pi / _NODES)  # so far out that the way from one to the next is free
_NEAREST = 12  # trunks; farther ones are for later
_INSIDE = 0.99  # of the distance to an axis, for who is nearer to it than its room


def way_round(p: Vector, goal: Vector, cylinders: Vector, room: float, fence: Vector) -> Vector:
    """(3,) m: the goal, or in the direction of the way round, as far off as that way is long.

    From p (3,) m, where the straight way to the goal (3,) m leads between two of cylinders (K,3)
    x, y, radius [m], nearest first, that stand too close to keep `room` [m] to both. fence: (H,4)
    upright half-spaces n·p <= b within which to keep it too. Where there is no way, the goal.
    """
    cylinders = cylinders[:_NEAREST]
    axes, reach = cylinders[:, :2], cylinders[:, 2] + room
    between = np.linalg.norm(axes[:, None] - axes[None], axis=2)
    closed = np.argwhere(np.triu(between < reach[:, None] + reach[None], k=1))
    if not len(closed):
        return goal
    doors, wall = axes[closed], np.unique(closed)
    ends = np.stack([p[:2], goal[:2]])
    # Who is there already is not to be told that he has no room.
    reach = np.minimum(
        reach, _INSIDE * np.linalg.norm(ends[:, None] - axes[None], axis=2).min(axis=0)
    )
    if _free(ends[:1], ends[1:], axes[wall], reach[wall], doors)[0]:
        return goal
    nodes = _around(axes, cylinders[:, 2] + room, wall)
    inside = nodes @ fence[:, :2].T <= fence[:, 3] - room
    nodes = np.vstack([ends, nodes[inside.all(axis=1)]])
    i, j = np.triu_indices(len(nodes), k=1)
    free = _free(nodes[i], nodes[j], axes, reach, doors)
    lengths = np.full((len(nodes), len(nodes)), math.inf)
    lengths[i, j] = np.where(free, np.linalg.norm(nodes[j] - nodes[i], axis=1), math.inf)
    first, length = _shortest(np.minimum(lengths, lengths.T))
    if not math.isfinite(length):
        return goal
    way = nodes[first] - p[:2]
    return np.array([*(p[:2] + way * (length / np.linalg.norm(way))), goal[2]])


def _around(axes: Vector, reach: Vector, which: NDArray[np.int64]) -> Vector:
    """(n,2) places around the trunks `which` that have room to all."""
    angles = np.arange(_NODES) * (2.0 * math.pi / _NODES)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    nodes: Vector = (axes[which, None] + _OUT * reach[which, None, None] * ring).reshape(-1, 2)
    far = np.linalg.norm(nodes[:, None] - axes[None], axis=2)
    free: Vector = nodes[(far > reach).all(axis=1)]
    return free


def _free(
    start: Vector, end: Vector, axes: Vector, reach: Vector, doors: Vector
) -> NDArray[np.bool_]:
    """(n,) whether the ways from start (n,2) to end (n,2) keep `reach` (K,) m to all axes (K,2).

    And lead through none of doors (m,2,2), from axis to axis.
    """
    way = end - start
    square = np.maximum((way**2).sum(axis=1), 1e-12)
    offsets = axes[None] - start[:, None]
    along = np.clip((offsets * way[:, None]).sum(axis=2) / square[:, None], 0.0, 1.0)
    gap = np.linalg.norm(offsets - along[..., None] * way[:, None], axis=2)
    first, second = doors[None, :, 0], doors[None, :, 1]
    start, end = start[:, None], end[:, None]
    crossed = (_side(start, end, first) * _side(start, end, second) < 0.0) & (
        _side(first, second, start) * _side(first, second, end) < 0.0
    )
    free: NDArray[np.bool_] = (gap >= reach).all(axis=1) & ~crossed.any(axis=1)
    return free


def _side(start: Vector, end: Vector, point: Vector) -> Vector:
    """Positive where points are to the left of the line from start to end, all (…,2)."""
    along, to = end - start, point - start
    side: Vector = along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0]
    return side


def _shortest(lengths: Vector) -> tuple[int, float]:
    """First node of the shortest way from node 0 to node 1, and its length (Dijkstra)."""
    n = len(lengths)
    first = np.arange(n)
    far, done = lengths[0].copy(), np.zeros(n, dtype=bool)
    done[0] = True
    while not done[1]:
        node = int(np.argmin(np.where(done, math.inf, far)))
        if done[node] or not math.isfinite(far[node]):
            return 1, math.inf
        done[node] = True
        nearer = far[node] + lengths[node] < far
        far = np.where(nearer, far[node] + lengths[node], far)
        first = np.where(nearer, first[node], first)
    return int(first[1]), float(far[1])
