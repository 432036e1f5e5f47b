"""When to land: who comes down sees nobody below."""

from __future__ import annotations

import math
from collections.abc import Sequence

from companion.guidance.line_of_sight import Gaze
from companion.guidance.waypoints import MissionConfig
from companion.types import Track
from mavlink_bridge.wire.messages import VehicleState


class Landing:
    """Looks round at the last goal, and waits while somebody known is below.

    The camera looks ahead: whoever flies close below is in no picture, but most of those who are
    going to, or were a moment ago, are found by one turn on the spot.
    """

    def __init__(self, config: MissionConfig, apart: float) -> None:
        """apart: m, who is below is nearer than this, seen from above."""
        self._wait, self._apart = config.land_wait if config.land else 0.0, apart
        self._since: float | None = None

    def may(self, own: VehicleState, tracks: Sequence[Track], gaze: Gaze) -> bool:
        """Whether to land from `own`, at the last goal; the first call turns the look round."""
        if self._wait == 0.0:
            return True
        if self._since is None:
            self._since = own.time
            gaze.look_round()
        # A vehicle's clock that begins anew, after a reboot, must not make the wait endless.
        if not 0.0 <= own.time - self._since < self._wait:
            return True
        return gaze.surveyed and not any(self._below(own, t) for t in tracks)

    def _below(self, own: VehicleState, track: Track) -> bool:
        aside = math.hypot(track.p[0] - own.p[0], track.p[1] - own.p[1])
        return aside < self._apart and bool(track.p[2] < own.p[2])
