"""A line of sight chosen by what it would tell, with the random sweep of eq. (7) as its prior.

Each swing goes where most may be learnt: what has not been looked at for long, and neighbours, the
more the worse they threaten and the longer they are unseen. Those in view count, too: looking away
from them loses them. A drone that flies swings within the sweep's `limit`, as it must see its way;
the slower it is, the farther it may look round, but every radian beyond that limit has its price.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from companion.guidance.gaze import Gaze, GazeConfig, Near, wrap
from mavlink_bridge.shared.arrays import Vector

_SECTORS = 36
_AZIMUTHS: Vector = np.linspace(0.0, 2.0 * np.pi, _SECTORS, endpoint=False)
_RIM = 0.1  # rad beyond `half_view` that a look still shows
_STEP = 0.25  # rad between the swings that are weighed
_ARRIVALS = 0.35  # 1/s, rate at which a sector that is not looked at may change
_FRESH, _STALE = 0.5, 8.0  # s since a look, from which that counts, and up to which it grows
_SLOW, _FAST = 0.3, 0.8  # m/s: looks all round; swings within `limit`
_TURN = 4.0  # sectors' worth of a radian beyond `limit`, and half a sector's of any
_PRIOR = 0.5  # the same, of a radian squared off the random swing
_THREAT, _MOST = 12.0, 2.0  # sectors' worth of 1 m/s of threat seen again after 1 s; m/s
_IN_VIEW = 0.1  # s unseen as which one in view counts: a swing without it loses that much
_FORGOTTEN = 3.0  # s unseen, from which it is no more worth
_SETTLES = 0.15  # s after a turn until the next swing


class InformedGaze(Gaze):
    """Decides the yaw reference ψ(t) by expected information."""

    def __init__(self, config: GazeConfig) -> None:
        super().__init__(config)
        self._looked: Vector = np.full(_SECTORS, -math.inf)  # s, when each sector was in view
        self._near: Sequence[Near] = ()
        self._now = self._speed = 0.0

    def mind(self, near: Sequence[Near]) -> None:
        """Take in the neighbours of this tick, the worst threat first."""
        self._near = near

    def update(
        self,
        time: float,
        v: Vector,
        to_goal: Vector,
        yaw_now: float,
        lost: Sequence[float] = (),
        close: float | None = None,
    ) -> float:
        """Return ψ [rad] at `time` [s], as `Gaze` does."""
        self._looked[_off(_AZIMUTHS, yaw_now) < self._config.half_view + _RIM] = time
        self._now, self._speed = time, math.hypot(v[0], v[1])
        return super().update(time, v, to_goal, yaw_now, lost, close)

    def _swing(self, lost: Sequence[float]) -> float:
        """Return ε [rad] of the next swing: of those it may make, the one that tells most."""
        c, prior = self._config, super()._swing(lost)
        if c.sigma == 0.0:
            return prior
        now = self._now
        reach = c.limit + (math.pi - c.limit) * min(
            max((_FAST - self._speed) / (_FAST - _SLOW), 0.0), 1.0
        )
        swings = np.array([prior, *np.arange(-reach, reach + 1e-9, _STEP)])
        unlooked = np.clip(now - self._looked - _FRESH, 0.0, _STALE)
        news = 1.0 - np.exp(-_ARRIVALS * unlooked)
        told = (_off(_AZIMUTHS, self._base + swings[:, None]) < c.half_view) @ news
        for n in self._near[:5]:
            seen = _off(n.bearing, self._base + swings) < c.half_view
            unseen = min(n.unseen, _FORGOTTEN) + _IN_VIEW
            told = told + seen * (_THREAT * min(n.threat, _MOST) * unseen)
        beyond = np.maximum(np.abs(swings) - c.limit, 0.0)
        price = _TURN * beyond + np.where(beyond > 0.0, 0.5, _PRIOR * (swings - prior) ** 2)
        epsilon = float(swings[np.argmax(told - price)])
        turn = abs(wrap(self._base + epsilon - (self._yaw or 0.0)))
        self._swing_ends = now + max(c.half_period, turn / c.slew + _SETTLES)
        return epsilon


def _off(azimuths: Vector | float, yaw: Vector | float) -> Vector:
    """Return how far [rad] azimuths are off a line of sight, 0…π."""
    off: Vector = np.abs((azimuths - yaw + np.pi) % (2.0 * np.pi) - np.pi)
    return off
