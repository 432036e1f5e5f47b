"""Surprises: neighbours first seen close by, where pictures should have shown them before.

Eyes that see well show a neighbour from afar, or as it comes into view. One that is new, near, and
whose place has been in plain view for half a second, has been missed, or is none. So how often that
happens tells how far the eyes can be trusted, whatever the detector says of itself. One whose track
ended lately, since it was missed in a few pictures, or was behind another, is no new one. Nor is
one that comes up where another is known: no two drones are so near; after a small step of the own
position all that is known comes up beside its tracks.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from companion.estimation.known_obstacles import KnownObstacles
from companion.perception.view import View
from companion.types import Track
from mavlink_bridge.shared.arrays import norm
from mavlink_bridge.wire.messages import VehicleState

_NEAR = 3.0  # m
# s before, in all searched pictures of which its place was in plain view: at most, and at least.
_SHOWN = (0.55, 0.35)
_FEWEST = 2  # such pictures
_BESIDE = 0.5  # m beside a trunk within which a neighbour may have been behind it
_LATELY = 20.0  # s for which a surprise counts
_LOST = 2.0  # s for which a neighbour whose track ended is still known to be about
_AGAIN = 1.0  # m from where it would have flown to that it may come up
_SAME = 0.4  # m: between the centres of two drones that touch


class Surprises:
    """Counts the surprises of the last 20 s."""

    def __init__(self, view: View) -> None:
        self._view = view
        self.reset()

    def reset(self) -> None:
        """Forget all neighbours and all surprises."""
        self._known: dict[int, Track] = {}
        self._lost: list[tuple[float, Track]] = []
        self._past: deque[tuple[float, VehicleState]] = deque()
        self._times: deque[float] = deque()

    def update(
        self,
        time: float,
        own: VehicleState,
        tracks: Sequence[Track],
        obstacles: KnownObstacles,
        *,
        counting: bool = True,
    ) -> None:
        """Take in the tracks after a picture, searched, that was taken at `time` [s] from `own`.

        counting: whether surprises count. While drones take off, those beside come up close by.
        """
        while self._past and time - self._past[0][0] > _SHOWN[0]:
            self._past.popleft()
        fresh = [t for t in tracks if t.id not in self._known]
        known = {t.id: t for t in tracks}
        self._lost += [(time, t) for t in self._known.values() if t.id not in known]
        self._lost = [(then, t) for then, t in self._lost if time - then < _LOST]
        old = [t for t in tracks if t.id in self._known]
        for t in fresh:
            again = self._is_back(time, t) or any(norm(t.p - o.p) < _SAME for o in old)
            if counting and not again and self._surprises(time, own, t, obstacles):
                self._times.append(time)
        self._known = known
        self._past.append((time, own))

    def lately(self, time: float) -> int:
        """Return the number of surprises within the last 20 s before `time` [s]."""
        while self._times and time - self._times[0] > _LATELY:
            self._times.popleft()
        return len(self._times)

    def _is_back(self, time: float, t: Track) -> bool:
        """Return whether a new neighbour is one that was lost; each comes back once."""
        for n, (then, lost) in enumerate(self._lost):
            if norm(t.p - lost.p - (time - then) * lost.v) < _AGAIN:
                del self._lost[n]
                return True
        return False

    def _surprises(
        self, time: float, own: VehicleState, t: Track, obstacles: KnownObstacles
    ) -> bool:
        """Return whether a new neighbour is near and should have been seen before."""
        if norm(t.p - own.p) >= _NEAR:
            return False
        if len(self._past) < _FEWEST or time - self._past[0][0] < _SHOWN[1]:
            return False
        doubt = np.sqrt(t.variances[:1])
        for then, before in self._past:
            place = (t.p - (time - then) * t.v)[None]
            if not self._view.shows(before, place, doubts=doubt)[0]:
                return False
            if obstacles.hidden(before.p, place, _BESIDE)[0]:
                return False
        return True
