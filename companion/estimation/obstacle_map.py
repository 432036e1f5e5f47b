"""Obstacles seen, and remembered: the blind spot beside a 160° camera is where swarms crash.

Trunks do not move: each look refines a small map in the drone's own frame. A trunk that
should be in plain view and is not seen again and again is forgotten; what is behind the
drone is kept until it is far away.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from companion.types import Trunk
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.shared.settings import StrictModel
from mavlink_bridge.wire.messages import VehicleState


class ObstacleConfig(StrictModel):
    """Numbers of the obstacle memory."""

    associate: float = Field(
        1.2,
        gt=0,
        description="Looks farther apart [m] are of different trunks, however little they tell; "
        "surer ones need not be as far apart.",
    )
    overlap: float = Field(
        0.7, ge=0, description="So are two nearer than this part of the sum of their radii."
    )
    hits_to_confirm: int = Field(3, ge=1, description="Looks before a trunk counts.")
    hits_to_keep: int = Field(
        6, ge=1, description="Looks before it is remembered for good; ghosts do not last so long."
    )
    doubtful_unseen: float = Field(1.5, gt=0, description="Life [s] unseen of any other.")
    misses_to_forget: int = Field(4, ge=1, description="Looks at its place without seeing it.")
    keep_range: float = Field(20.0, gt=0, description="Farther than this [m] is forgotten.")
    view_range: float = Field(6.0, gt=0, description="Nearer than this [m] it must be seen.")
    sigma_floor: float = Field(0.03, gt=0, description="Least std [m] of a place.")


_Place = tuple[float, float]
_LIKELY, _SIGMAS = 0.3, 4.0  # m, and standard deviations: what looks at one trunk differ by
# This much wider than known, a trunk of which only the width shows is not that one. A thin one is a
# few columns wide, of which two at either edge are missed in one look and added in another.
_WIDER, _COLUMNS = 1.5, 0.04  # times, and rad: on either side


@dataclass
class _Known:
    """One trunk: axis (x, y) m, radius, variance, looks that saw it and that did not."""

    axis: _Place
    radius: float
    variance: float
    seen: float
    hits: int = 1
    misses: float = 0.0


class ObstacleMap:
    """Trunks known to this drone, in its own ENU frame."""

    def __init__(self, config: ObstacleConfig) -> None:
        self._config = config
        self._known: list[_Known] = []

    def update(
        self,
        trunks: Sequence[Trunk],
        own: VehicleState,
        q_bc: Vector,
        half_view: float,
        visibility: Callable[[Vector], Vector] = lambda places: np.ones(len(places)),
    ) -> None:
        """One frame's trunks, seen in state `own`; half_view: half the field of view [rad].

        visibility: how much of a look the frame is at each of places (n,3), (n,) 0…1; where the
        frame does not show a place, a trunk that is not seen there is not gone.

        So near that its foot is out of the picture, or cut by the picture's edge, a thin trunk
        looks like a thick one far off: one that is known to stand there stays where it is.
        """
        r_wc = rotation_matrix(own.q_wb) @ rotation_matrix(q_bc)
        seen: set[int] = set()
        for trunk in trunks:
            ray = r_wc @ trunk.direction
            along = (float(ray[0]), float(ray[1]))
            known = self._known_there(trunk, along, own) if trunk.assumed else None
            if known is not None:
                self._see_again(known, own.time)
                seen.add(known)
                continue
            scale = trunk.distance / max(math.hypot(*along), 1e-6)
            axis = (float(own.p[0]) + along[0] * scale, float(own.p[1]) + along[1] * scale)
            seen.add(self._merge(axis, trunk, own.time, seen))
        seen = self._unite(seen)
        forward = (float(r_wc[0, 2]), float(r_wc[1, 2]))
        missing = list(self._missing(seen, own, forward, half_view))
        if missing:
            places = np.array([[*self._known[n].axis, own.p[2]] for n in missing])
            for n, look in zip(missing, visibility(places).tolist(), strict=True):
                self._known[n].misses += look
        self._forget(own)

    def cylinders(self, p: Vector) -> Vector:
        """Return confirmed trunks (K,3) x, y, radius [m], nearest surface to p (3,) m first."""
        sure = [k for k in self._known if k.hits >= self._config.hits_to_confirm]
        here = (float(p[0]), float(p[1]))
        sure.sort(key=lambda k: math.dist(k.axis, here) - k.radius)
        return np.array([[*k.axis, k.radius] for k in sure]).reshape(-1, 3)

    def occluders(self) -> Vector:
        """Return all trunks (J,3) x, y, radius [m], unconfirmed ones too."""
        return np.array([[*k.axis, k.radius] for k in self._known]).reshape(-1, 3)

    def _known_there(self, trunk: Trunk, along: _Place, own: VehicleState) -> int | None:
        """The nearest confirmed trunk in the direction of one of which only the width shows.

        None too where it shows wider than the known one can from here: another stands before it.
        """
        best, nearest = None, math.inf
        half = math.asin(min(trunk.radius / trunk.distance, 1.0))
        for n, k in enumerate(self._known):
            offset = (k.axis[0] - float(own.p[0]), k.axis[1] - float(own.p[1]))
            distance = math.hypot(*offset)
            if k.hits < self._config.hits_to_confirm or not k.radius < distance < nearest:
                continue
            known_half = math.asin(k.radius / distance)
            widest = max(_WIDER * known_half, known_half + _COLUMNS)
            if _angle(along, offset) < max(half, known_half) and half < widest:
                best, nearest = n, distance
        return best

    def _merge(self, axis: _Place, trunk: Trunk, time: float, seen: set[int]) -> int:
        variance = trunk.sigma**2
        n = self._same(axis, trunk.radius, variance, seen)
        if n is None:
            self._known.append(_Known(axis, trunk.radius, variance, time))
            return len(self._known) - 1
        k = self._known[n]
        gain = k.variance / (k.variance + variance)
        (x, y), (to_x, to_y) = k.axis, axis
        k.axis = (x + gain * (to_x - x), y + gain * (to_y - y))
        k.radius += gain * (trunk.radius - k.radius)
        k.variance = max((1 - gain) * k.variance, self._config.sigma_floor**2)
        self._see_again(n, time)
        return n

    def _see_again(self, n: int, time: float) -> None:
        k = self._known[n]
        k.hits, k.misses, k.seen = k.hits + 1, 0.0, time

    def _same(
        self,
        axis: _Place,
        radius: float,
        variance: float,
        seen: set[int],
        but: int | None = None,
    ) -> int | None:
        """The known trunk that one seen at `axis` is: trunks do not grow into one another.

        One of `seen`, which the same frame shows too, is another, unless the two overlap.
        """
        c, best, nearest = self._config, None, math.inf
        for n, k in enumerate(self._known):
            apart = math.dist(k.axis, axis)
            if n == but or apart >= nearest:
                continue
            gate = c.overlap * (k.radius + radius)
            if n not in seen:
                doubt = _SIGMAS * math.sqrt(variance + k.variance)
                gate = max(gate, min(c.associate, _LIKELY + doubt))
            if apart < gate:
                best, nearest = n, apart
        return best

    def _unite(self, seen: set[int]) -> set[int]:
        """Of two that later looks have moved to one place the surer stays; what of it was seen."""
        gone: set[int] = set()
        for n in sorted(seen):
            k = self._known[n]
            m = self._same(k.axis, k.radius, k.variance, seen, but=n)
            if m is None or {n, m} & gone:
                continue
            stays, goes = sorted((n, m), key=lambda i: (self._known[i].variance, i))
            self._see_again(stays, k.seen)
            seen = seen | {stays}
            gone.add(goes)
        left = [n for n in range(len(self._known)) if n not in gone]
        self._known = [self._known[n] for n in left]
        return {new for new, old in enumerate(left) if old in seen}

    def _missing(
        self, seen: set[int], own: VehicleState, forward: _Place, half_view: float
    ) -> Iterator[int]:
        """Trunks that should be in plain view and were not seen."""
        p = (float(own.p[0]), float(own.p[1]))
        for n, k in enumerate(self._known):
            offset = (k.axis[0] - p[0], k.axis[1] - p[1])
            near = k.radius + 0.3 < math.hypot(*offset) < self._config.view_range
            in_view = near and _angle(forward, offset) < half_view - 0.2
            if n not in seen and in_view and not self._shadowed(n, p):
                yield n

    def _forget(self, own: VehicleState) -> None:
        c, p = self._config, (float(own.p[0]), float(own.p[1]))
        self._known = [
            k
            for k in self._known
            if k.misses < c.misses_to_forget
            and math.dist(k.axis, p) < c.keep_range
            and (k.hits >= c.hits_to_keep or own.time - k.seen <= c.doubtful_unseen)
        ]

    def _shadowed(self, n: int, p: _Place) -> bool:
        """Whether another, nearer trunk covers part of trunk n as seen from p."""
        target = self._known[n]
        offset = (target.axis[0] - p[0], target.axis[1] - p[1])
        distance = math.hypot(*offset)
        for m, k in enumerate(self._known):
            other = (k.axis[0] - p[0], k.axis[1] - p[1])
            d = math.hypot(*other)
            if m == n or d >= distance:
                continue
            covers = math.asin(min(k.radius / d, 1.0))
            if _angle(offset, other) < covers + math.asin(min(target.radius / distance, 1.0)):
                return True
        return False


def _angle(a: _Place, b: _Place) -> float:
    """Between two vectors (2,) [rad], 0…π."""
    return abs(math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]))
