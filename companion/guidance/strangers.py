"""Strangers: neighbours that give no way, told by how fast they come.

One of ours that comes at another, and sees it, is slowed down by its headway (`headway_speed`). Who
is faster, picture after picture, either has not seen this drone or does not care.
"""

from __future__ import annotations

from collections.abc import Sequence

from companion.guidance.gaze import nearest_within
from companion.guidance.speed_limits import SpeedLimitConfig, followed
from companion.types import Track
from mavlink_bridge.shared.arrays import Vector, norm

_TICKS = 5  # in a row
_FASTER = 0.2  # m/s, than one of ours
_PASSES = 0.6  # m: who passes farther off needs not slow down
_AHEAD = 2.5  # s, in which it passes
_KEPT = 20.0  # s that it is taken for one, and that there may be more


class Strangers:
    """Those of the neighbours that have come too fast lately."""

    def __init__(self, config: SpeedLimitConfig, cruise: float) -> None:
        """cruise: m/s, of all of ours."""
        self._config, self._least = config, config.headway_least * cruise
        self._ticks: dict[int, int] = {}
        self._met: dict[int, float] = {}

    def update(self, time: float, p: Vector, v: Vector, tracks: Sequence[Track]) -> frozenset[int]:
        """Return the ids of all that came too fast in the last 20 s; they may be gone.

        time: s. p, v: (3,) m, m/s, the own. Without headway nobody is expected to slow down.
        """
        before, self._ticks = self._ticks, {}
        for t in tracks:
            if not t.lost and self._too_fast(t, p, v):
                self._ticks[t.id] = before.get(t.id, 0) + 1
                if self._ticks[t.id] >= _TICKS:
                    self._met[t.id] = time
        self._met = {n: at for n, at in self._met.items() if 0.0 <= time - at <= _KEPT}
        return frozenset(self._met)

    def _too_fast(self, track: Track, p: Vector, v: Vector) -> bool:
        """Return whether a neighbour comes faster than one of ours would at its distance."""
        if self._config.headway == 0.0:
            return False
        offset, speed = track.p - p, max(norm(track.v), 1e-9)
        apart = max(norm(offset), 1e-9)
        flees = max(float(v @ track.v) / speed, 0.0)  # m/s, of the own drone, the same way
        allowed = max(followed(flees, apart, self._config), self._least)
        closes = -float(offset @ track.v) / apart
        return closes > allowed + _FASTER and nearest_within(offset, track.v, _AHEAD) < _PASSES
