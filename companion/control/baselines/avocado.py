"""AVOCADO: collision avoidance that learns in flight how far each neighbour cooperates.

Source: Martínez-Baselga et al., "AVOCADO: Adaptive Optimal Collision Avoidance driven by Opinion",
IEEE T-RO, 2025 (arXiv 2407.00507), from its equations, whose numbers stand in this file. The
velocity obstacles are those of van den Berg et al., "Reciprocal n-body collision avoidance", 2011,
where each drone does half of what avoids a collision. Here it does 1 - α. A neighbour's share α
follows an opinion, which rises while the neighbour is seen to do its part, and falls otherwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from companion.control.baselines.config import AvocadoConfig
from companion.control.baselines.half_planes import HalfPlanes, nearest_velocity
from companion.control.baselines.surroundings import Surroundings, turned_right
from mavlink_bridge.shared.arrays import Vector, lengths, norm

_STEP = 0.1  # s, the companion's tick
_GATE = 0.4  # m off its predicted place: two neighbours' centres cannot be nearer to each other
_NO_CHANGE = 1e-3  # m/s; a needed change smaller than this is none


@dataclass(frozen=True)
class Acquaintance:
    """What the drone knows of a neighbour.

    offset (2,) m, from the drone; velocity (2,) m/s; needed (2,) m/s: u, the change of relative
    velocity that avoids it; normal (2,): n, of its velocity obstacle; opinion: x, -1…1; attention:
    w, 0…1.
    """

    offset: Vector
    velocity: Vector
    needed: Vector
    normal: Vector
    opinion: float
    attention: float

    @property
    def share(self) -> float:
        """Its share α of the change, 0…1, eq. (9)."""
        return min(max(0.5 * (self.opinion + 1.0), 0.0), 1.0)


class Avocado:
    """The velocity nearest to the preferred one, if each neighbour does the share it has shown."""

    def __init__(self, config: AvocadoConfig) -> None:
        self._config = config
        self.reset()

    def reset(self) -> None:
        """Forget all neighbours."""
        self._known: list[Acquaintance] = []
        self._v = np.zeros(2)

    @property
    def known(self) -> tuple[Acquaintance, ...]:
        """What the drone knows of the neighbours within reach, as of the last velocity."""
        return tuple(self._known)

    def velocity(self, around: Surroundings) -> Vector:
        """Return the velocity (2,) m/s nearest to the preferred one, eq. (8)."""
        c = self._config
        # The paper breaks ties by noise of the opinion. It only changes how far a drone goes along
        # u, and so frees no two that brake head-on; a right turn does, and flies the same again.
        preferred = turned_right(around.migration, c.aside)
        self._known = self._meet(around, preferred)
        asked = []
        for other in self._known:
            edge = around.v + (1.0 - other.share) * other.needed  # (7)
            asked.append((other.normal, float(other.normal @ edge)))
        kept = self._obstacles(around)
        return nearest_velocity(preferred, around.fastest, kept, HalfPlanes.of(asked))

    def _meet(self, around: Surroundings, preferred: Vector) -> list[Acquaintance]:
        """Return what is known of the neighbours within reach, one tick on; remember the own v."""
        c = self._config
        near = lengths(around.neighbours) <= c.reach
        offsets, velocities = around.neighbours[near], around.velocities[near]
        before = self._matched(offsets, around.v)
        self._v = around.v.copy()
        met = []
        for offset, velocity, last in zip(offsets, velocities, before, strict=True):
            opinion, attention = c.b / c.d, 0.0
            if last is not None:
                left = time_to_collision(offset, preferred - velocity, 2.0 * c.radius)
                attention = self._attention(last.attention, left)
                opinion = self._opinion(last, attention, velocity)
            needed, normal = away(offset, around.v - velocity, 2.0 * c.radius, c.horizon)
            met.append(Acquaintance(offset, velocity, needed, normal, opinion, attention))
        return met

    def _matched(self, offsets: Vector, v: Vector) -> list[Acquaintance | None]:
        """Return who each of the offsets (k,2) m was at the last tick; v: own velocity (2,) m/s.

        Neighbours come without names. Each is the one that was predicted nearest to it.
        """
        before: list[Acquaintance | None] = [None] * len(offsets)
        if not self._known:
            return before
        own = 0.5 * (self._v + v)
        predicted = np.array([k.offset + _STEP * (k.velocity - own) for k in self._known])
        apart = lengths(offsets[:, None] - predicted)
        for flat in np.argsort(apart, axis=None, kind="stable"):
            now, then = np.unravel_index(flat, apart.shape)
            if apart[now, then] <= _GATE:
                before[now] = self._known[then]
                apart[now], apart[:, then] = np.inf, np.inf
        return before

    def _attention(self, last: float, left: float) -> float:
        """Return w, eq. (11) to (14); left: s to the collision by the preferred velocity."""
        c = self._config
        aim = math.tanh(c.kappa / left) if left > 0.0 else 1.0
        return (1.0 - c.delta) * last + c.delta * aim

    def _opinion(self, last: Acquaintance, attention: float, velocity: Vector) -> float:
        """Return x one tick on, eq. (10) by Euler's method; velocity: its present one (2,) m/s."""
        c, u = self._config, last.needed
        done = 0.0
        if norm(u) > _NO_CHANGE:
            done = abs(float((velocity - last.velocity) @ u)) / float(u @ u)
        seen = math.tanh(c.epsilon * (done - 0.5))  # (15)
        x = last.opinion
        drive = c.d * (attention * math.tanh(c.a * x + c.c * seen) - x) + c.b
        return min(max(x + _STEP * drive, -1.0), 1.0)

    def _obstacles(self, around: Surroundings) -> HalfPlanes:
        """Return the half-planes of trunks and walls; a drone at rest is in all of them.

        The paper avoids discs. A trunk is one at rest, α = 0; a wall is reached no sooner than the
        horizon. Inside the margin of either a drone must not come nearer.
        """
        c, each = self._config, []
        for x, y, r in around.trunks:
            place = np.array([x, y])
            if norm(place) > r + c.radius:
                needed, normal = away(place, around.v, r + c.radius, c.horizon_obstacle)
                each.append((normal, float(normal @ (around.v + needed))))
            else:
                each.append((-place / max(norm(place), 1e-6), 0.0))
        for nx, ny, room in around.walls:
            most = max(room - c.radius, 0.0) / c.horizon_obstacle
            each.append((np.array([-nx, -ny]), -most))
        return HalfPlanes.of(each)


def away(p: Vector, v: Vector, radius: float, horizon: float) -> tuple[Vector, Vector]:
    """Return the least change u (2,) m/s of v to the velocity obstacle's border, and its normal.

    p (2,): m, to a disc of `radius` [m], which is both bodies'. v (2,): m/s, relative to it. The
    obstacle is all v that touch the disc within `horizon` [s]; where they touch now, within a tick.
    The normal (2,) is of length 1 and points out of the obstacle, as u does where v is in it. It
    is as in van den Berg et al., section 4: a cone, cut off by a circle.
    """
    apart = norm(p)
    touch = apart <= radius
    soon = _STEP if touch else horizon
    w = v - p / soon
    along, size = float(w @ p), norm(w)
    if touch or along < -radius * size:
        ahead = p / apart if apart > 0.0 else np.array([1.0, 0.0])
        normal = w / size if size > 0.0 else -ahead
        return (radius / soon - size) * normal, normal
    # Beside the circle the border is the nearer leg; on the axis, a drone passes on the right.
    side = 1.0 if p[0] * v[1] - p[1] * v[0] > 0.0 else -1.0
    sine, cosine = side * radius / apart, math.sqrt(1.0 - (radius / apart) ** 2)
    x, y = p / apart
    leg = np.array([cosine * x - sine * y, sine * x + cosine * y])
    normal = side * np.array([-leg[1], leg[0]])
    return -float(v @ normal) * normal, normal


def time_to_collision(p: Vector, v: Vector, radius: float) -> float:
    """Return the time [s] until a point at v (2,) m/s is within `radius` [m] of p (2,) m, or inf.

    Eq. (12) to (14): the sooner root of |p - v t| = radius; 0 where it is within it already.
    """
    clear = float(p @ p) - radius**2
    if clear <= 0.0:
        return 0.0
    closing, square = float(p @ v), float(v @ v)
    inside = closing**2 - square * clear
    if closing <= 0.0 or inside < 0.0:
        return math.inf
    return clear / (closing + math.sqrt(inside))
