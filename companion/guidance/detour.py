"""Detour: the way round trunks that stand too close to each other to pass between.

The NMPC itself passes a single trunk. Two trunks with too little room between them are a wall with
a pocket before it; the plan, which reaches a few metres, would wait in the pocket for ever. The
shortest way round is found on a visibility graph (Lozano-Pérez and Wesley, "An algorithm for
planning collision-free paths among polyhedral obstacles", 1979), its nodes around those trunks.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector, lengths, norm
from mavlink_bridge.shared.distance import to_ways

_NODES = 8  # around a trunk
_OUT = 1.02 / math.cos(math.pi / _NODES)  # so far out that the way between two nodes is free
_NEAREST = 40  # trunks taken into account: 10 ms in a hedge of as many
_INSIDE = 0.99  # share of the present distance to an axis that is kept where the room is not
_SAME = 0.5  # m; a goal that moved by less is the same
_ENDLESS = 1e3  # m


class Detour:
    """Finds ways round, and keeps the side of the present one."""

    def __init__(self, fence: Vector) -> None:
        """fence: (H,4) upright half-spaces n·p <= b, own ENU frame, within which to stay."""
        self._fence = fence
        self._goal: Vector | None = None
        self._side = 0.0  # 1: left of the straight way, -1: right, 0: no detour

    def aim(self, p: Vector, goal: Vector, cylinders: Vector, room: float) -> Vector:
        """Return where to fly (3,) m from p (3,) m: the goal (3,) m, or along the way round.

        cylinders: (K,3) x, y, radius [m], nearest first. room: m, between a trunk's surface and the
        drone. The aim on the way round is as far off as that way is long. The goal is returned
        itself where the straight way leads between no trunks that are too close to each other, and
        where there is no way round.

        The side once taken is kept until the straight way is free: of a hedge longer than the known
        part of it, the nearer end would always be the one behind.
        """
        if self._goal is None or norm(goal - self._goal) > _SAME:
            self._side = 0.0
        self._goal = goal
        leg = self._leg(p[:2], goal[:2], cylinders[:_NEAREST], room)
        return goal if leg is None else np.array([*(p[:2] + leg), goal[2]])

    def _leg(self, p: Vector, goal: Vector, cylinders: Vector, room: float) -> Vector | None:
        """Return the first leg (2,) of the way round, scaled to its whole length; None: no detour.

        p, goal: (2,) m.
        """
        axes, reach = cylinders[:, :2], cylinders[:, 2] + room
        apart = lengths(axes[:, None] - axes)
        one, other = (apart < reach[:, None] + reach).nonzero()
        once = one < other  # of a pair and its reverse
        if not once.any():
            self._side = 0.0
            return None
        closed = np.column_stack([one[once], other[once]])
        ends = np.stack([p, goal])
        doors, wall = axes[closed], np.unique(closed)
        # Where the drone or its goal is nearer to a trunk than `room`, that distance is allowed.
        own = np.linalg.norm(ends[:, None] - axes[None], axis=2).min(axis=0)
        allowed = np.minimum(reach, _INSIDE * own)
        if _free(ends[0], ends[1:], axes[wall], allowed[wall], doors)[0]:
            self._side = 0.0
            return None
        nodes = _around(axes, reach, wall)
        inside = nodes @ self._fence[:, :2].T <= self._fence[:, 3] - room
        nodes = np.vstack([ends, nodes[inside.all(axis=1)]])
        way = ends[1] - ends[0]
        left = np.array([-way[1], way[0]]) / norm(way)
        passed: list[int] = []
        if self._side:  # close the other side, from its outermost trunk outwards
            last = axes[wall[np.argmin(self._side * (axes[wall] @ left))]]
            endless = np.stack([last, last - self._side * _ENDLESS * left])[None]
            passed = _shortest(nodes, axes, allowed, np.concatenate([doors, endless]))
        passed = passed or _shortest(nodes, axes, allowed, doors)
        if not passed:
            return None
        legs = np.diff(nodes[passed], axis=0)
        # Where it is farthest off the straight way: out of a pocket its first leg leads backwards.
        off = (nodes[passed] - ends[0]) @ left
        self._side = math.copysign(1.0, float(off[np.argmax(np.abs(off))]))
        scaled: Vector = legs[0] * (lengths(legs).sum() / norm(legs[0]))
        return scaled


def _around(axes: Vector, reach: Vector, which: NDArray[np.int64]) -> Vector:
    """Return the places (n,2) m around the trunks `which` that keep `reach` (K,) m to all axes."""
    angles = np.arange(_NODES) * (2.0 * math.pi / _NODES)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    nodes: Vector = (axes[which, None] + _OUT * reach[which, None, None] * ring).reshape(-1, 2)
    far = np.linalg.norm(nodes[:, None] - axes[None], axis=2)
    free: Vector = nodes[(far > reach).all(axis=1)]
    return free


def _free(
    start: Vector, ends: Vector, axes: Vector, reach: Vector, doors: Vector
) -> NDArray[np.bool_]:
    """Return whether the ways from start (2,) to each of ends (n,2) are free, as (n,).

    A free way keeps `reach` (K,) m to all axes (K,2) and crosses none of the doors (m,2,2), the
    gaps between two axes that are too narrow.
    """
    first, second, to = doors[None, :, 0], doors[None, :, 1], ends[:, None]
    crossed = (_side(start, to, first) * _side(start, to, second) < 0.0) & (
        _side(first, second, start) * _side(first, second, to) < 0.0
    )
    free: NDArray[np.bool_] = np.all(to_ways(axes, start, ends) >= reach, axis=1)
    free &= ~np.any(crossed, axis=1)
    return free


def _side(start: Vector, end: Vector, point: Vector) -> Vector:
    """Return values (…) > 0 where points lie left of the line from start to end, all (…,2)."""
    along, to = end - start, point - start
    side: Vector = along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0]
    return side


def _shortest(nodes: Vector, axes: Vector, reach: Vector, doors: Vector) -> list[int]:
    """Return the shortest way from node 0 to node 1 of (n,2), all nodes on it; none: no way.

    The search is A*.
    """
    n = len(nodes)
    before = np.zeros(n, dtype=int)
    left = np.linalg.norm(nodes - nodes[1], axis=1)
    far, open_ = np.full(n, math.inf), np.ones(n, dtype=bool)
    far[0] = 0.0
    while True:
        node = int(np.argmin(np.where(open_, far + left, math.inf)))
        if not open_[node] or not math.isfinite(far[node]):
            return []
        if node == 1:
            break
        open_[node] = False
        to = np.flatnonzero(open_)
        to = to[_free(nodes[node], nodes[to], axes, reach, doors)]
        length = far[node] + np.linalg.norm(nodes[to] - nodes[node], axis=1)
        nearer = length < far[to]
        to, length = to[nearer], length[nearer]
        far[to] = length
        before[to] = node
    way = [1]
    while way[-1] != 0:
        way.append(int(before[way[-1]]))
    return way[::-1]
