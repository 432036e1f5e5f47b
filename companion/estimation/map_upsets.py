"""Upsets of the obstacle map: trunks that were known for good, and moved or vanished.

Trunks do neither. A drone whose own state is right, and whose eyes tell one trunk from another,
refines its map by less and less. So each known trunk that is shifted by much more than its doubt,
or that is forgotten as looks at its place show none, tells that one of these is wrong, and that
the map is, whatever the doubts of its trunks say.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable

from companion.estimation.landmark_association import Landmark
from companion.estimation.landmark_places import Place

_LATELY = 20.0  # s for which an upset counts
_NEAR = 6.0  # m from the drone
_SIGMAS, _ROUNDING = 4.0, 0.05  # standard deviations and m by which a landmark is not shifted


class MapUpsets:
    """Counts the upsets of the last 20 s."""

    def __init__(self) -> None:
        self._known: list[tuple[Landmark, Place, float]] = []
        self._times: deque[float] = deque()

    def before(self, known: Iterable[Landmark], p: Place) -> None:
        """Remember the landmarks known for good, before a frame is taken in at p (x, y) m."""
        self._known = [
            (k, k.axis, _SIGMAS * math.sqrt(k.variance) + _ROUNDING)
            for k in known
            if math.dist(k.axis, p) < _NEAR
        ]

    def shifted(self, time: float) -> None:
        """Count the landmarks that the frame of `time` [s] has shifted beyond their doubt."""
        self._count(time, sum(math.dist(k.axis, was) > most for k, was, most in self._known))

    def vanished(self, time: float, gone: Iterable[Landmark]) -> None:
        """Count those of the remembered landmarks that the frame of `time` [s] says are gone."""
        self._count(time, sum(any(k is g for k, _, _ in self._known) for g in gone))

    def lately(self, time: float) -> int:
        """Return the number of upsets within the last 20 s before `time` [s]."""
        while self._times and time - self._times[0] > _LATELY:
            self._times.popleft()
        return len(self._times)

    def _count(self, time: float, upsets: int) -> None:
        self._times.extend([time] * upsets)
