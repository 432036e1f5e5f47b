"""When to land: a drone that comes down does not see what is below it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from companion.guidance.mission import MissionConfig
from companion.types import Track
from mavlink_bridge.wire.messages import VehicleState


@dataclass(frozen=True)
class LandingStep:
    """What follows at the last goal: whether to land now, and whether to begin a look round."""

    land: bool
    look_round: bool


class Landing:
    """Looks round at the last goal, and waits while a known neighbour is below.

    The camera looks ahead: a neighbour close below is in no picture, but most of those that are
    about to be there, or were a moment ago, are found by one turn on the spot.
    """

    def __init__(self, config: MissionConfig, apart: float, turns: bool) -> None:
        """apart: m; a neighbour below is nearer than this, seen from above.

        turns: whether a look round takes a turn on the spot, or is over at once.
        """
        self._wait, self._apart = config.land_wait if config.land else 0.0, apart
        self._turns = turns
        self._since: float | None = None

    def update(self, own: VehicleState, tracks: Sequence[Track], surveyed: bool) -> LandingStep:
        """Return the step at the last goal, from the own state there.

        surveyed: whether the look round that was asked for is over.
        """
        if self._wait == 0.0:
            return LandingStep(land=True, look_round=False)
        begins = self._since is None
        if self._since is None:
            self._since = own.time
        # A vehicle's clock that begins anew, after a reboot, must not make the wait endless.
        if not 0.0 <= own.time - self._since < self._wait:
            return LandingStep(land=True, look_round=begins)
        looked = not self._turns if begins else surveyed
        clear = looked and not any(self._below(own, t) for t in tracks)
        return LandingStep(land=clear, look_round=begins)

    def _below(self, own: VehicleState, track: Track) -> bool:
        aside = math.hypot(track.p[0] - own.p[0], track.p[1] - own.p[1])
        return aside < self._apart and bool(track.p[2] < own.p[2])
