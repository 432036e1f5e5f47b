"""What goes out where supervision itself fails: hold is requested, and the frame is levelled.

It depends on nothing but the last heartbeat and the last phase.
"""

from __future__ import annotations

import numpy as np

from companion.supervision.guard import AutopilotRequest, Reason, Verdict
from companion.supervision.supervision import Supervised
from companion.types import Phase
from mavlink_bridge.autopilots.registry import Autopilot
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.wire.messages import Heartbeat, RateCommand

_REPEAT = 0.3  # s between two requests


class LastResort:
    """Gives the vehicle back to its autopilot."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._requested_at = -np.inf

    def decide(
        self, time: float, phase: Phase, heartbeat: Heartbeat | None, failure: str
    ) -> Supervised:
        """Return the decision at `time` [s].

        phase: of the last tick that supervision decided. heartbeat: the last one. Setpoints go out
        until it shows that the autopilot has taken over.
        """
        followed = heartbeat is None or self._autopilot.mode(heartbeat) == "offboard"
        if not (phase.flying and followed):
            return Supervised(Phase.PASSIVE, inhibit_reason=failure)
        requests = []
        if time - self._requested_at >= _REPEAT:
            self._requested_at = time
            requests = self._autopilot.hold()
        level = RateCommand(np.zeros(3), GRAVITY)
        verdict = Verdict(level, Reason.FAILURE, 0, AutopilotRequest.HOLD)
        return Supervised(phase, requests, verdict, inhibit_reason=failure)
