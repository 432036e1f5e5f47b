"""Neighbour watch: do neighbours keep to the bounds that the certificate assumes?

Half a second of each track is remembered. What a track could have reached from there within the
bounds is known; a track that is elsewhere has broken them. Its mean speed over that time counts
where a track's own speed, which is limited, tells less. A track that ends, because looks missed it,
counts until it has not been seen for a second: no neighbour vanishes.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

from companion.types import Track
from mavlink_bridge.shared.arrays import Vector, norm

_WINDOW = 0.5  # s that are remembered
_LEAST = 0.25  # s over which speeds are compared: two looks are noise
_SIGMAS = 3.0  # of the places, beyond which a bound counts as broken
_LAG = 0.2  # s: what it did in the last two looks before, its track may not know yet
_LATELY = 0.15  # s; a neighbour unseen for longer is where memory puts it
_SURE = 0.5  # s that a track has lived before its end counts as no ghost's
_KEPT = 1.0  # s for which it counts after it was seen
_SAME = 1.0  # m; a new track this close to one that has ended is the same neighbour
_FASTER = 0.5  # m/s by which the mean speed must be above the track's to count


@dataclass(frozen=True)
class Watched:
    """tracks: with speeds that count; broken: the bounds that neighbours broke, in words."""

    tracks: list[Track]
    broken: tuple[str, ...] = ()


class NeighbourWatch:
    """Remembers where tracks were."""

    def __init__(self, acceleration: float, speed: float) -> None:
        """acceleration: m/s², speed: m/s, the bounds."""
        self._acceleration, self._speed = acceleration, speed
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._past: dict[int, deque[tuple[float, Track]]] = {}
        self._latest: dict[int, tuple[float, Track]] = {}  # with those that have ended lately

    def update(self, time: float, tracks: Sequence[Track]) -> Watched:
        """Return the tracks at the tick of `time` [s], and the bounds that they have broken."""
        self._past = {t.id: self._past.get(t.id, deque()) for t in tracks}
        watched, broken = [], []
        for t in tracks:
            past = self._past[t.id]
            if t.unseen > _LATELY:
                past.clear()
                watched.append(t)
                continue
            past.append((time, t))
            while time - past[0][0] > _WINDOW + 1e-6:
                past.popleft()
            then, before = past[0]
            watched.append(t)
            if time - then < _LEAST:
                continue
            mean, doubt = _mean_velocity(before, t, time - then)
            if found := self._finding(before, t, time - then, mean, doubt):
                broken.append(found)
            if norm(mean) - _SIGMAS * doubt > norm(t.v) + _FASTER:
                watched[-1] = replace(t, v=mean)
        return Watched(watched + self._ended(time, tracks), tuple(broken))

    def _ended(self, time: float, tracks: Sequence[Track]) -> list[Track]:
        """Return the tracks that have ended lately, where they would be now."""
        living = {t.id for t in tracks}
        ended = []
        for name, (then, t) in list(self._latest.items()):
            if name in living:
                continue
            now = replace(t, p=t.p + (time - then) * t.v, unseen=t.unseen + time - then)
            # Its new track may have begun while the old one was still being missed.
            young = [other for other in tracks if other.age <= time - then + _SURE]
            again = any(norm(other.p - now.p) < _SAME for other in young)
            # One that had long been out of view was looked for where it was remembered, in vain.
            if again or t.age < _SURE or now.unseen > _KEPT:
                del self._latest[name]
            else:
                ended.append(now)
        self._latest |= {t.id: (time, t) for t in tracks}
        return ended

    def _finding(self, before: Track, t: Track, dt: float, mean: Vector, doubt: float) -> str:
        """Return the bound that a track has broken within `dt` [s], in words; empty: none."""
        speed = norm(mean)
        if speed - _SIGMAS * doubt > self._speed:
            return f"neighbour {t.id}: {speed:.1f} m/s, {self._speed:g} m/s are assumed"
        off = norm(t.p - before.p - before.v * dt)
        spread = _SIGMAS * math.hypot(_sigma(before, dt), _sigma(t, 0.0))
        more = (off - spread) / (0.5 * dt * dt + _LAG * dt)
        if more > self._acceleration:
            bound = f"{self._acceleration:g} m/s² are assumed"
            return f"neighbour {t.id}: {more:.1f} m/s² off its course, {bound}"
        return ""


def _mean_velocity(before: Track, t: Track, dt: float) -> tuple[Vector, float]:
    """Return the mean velocity (3,) m/s over `dt` [s], and its doubt [m/s]."""
    return (t.p - before.p) / dt, math.hypot(_sigma(before, 0.0), _sigma(t, 0.0)) / dt


def _sigma(t: Track, later: float) -> float:
    """Return 1 σ [m] of a track's place along one axis, `later` [s] on."""
    a, b, d = t.variances
    return math.sqrt(max(a + 2.0 * later * b + later * later * d, 0.0))
