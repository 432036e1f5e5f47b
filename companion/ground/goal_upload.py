"""The ground station's end of the mission protocol: new goals for one companion.

Source: mavlink.io/en/services/mission.html. `companion.services.goals` is the other end.
"""

from __future__ import annotations

import math

from companion.ground.drone_view import DroneView
from companion.services.goals import Frame, Result
from mavlink_bridge.wire.messages import (
    Message,
    MissionAck,
    MissionCount,
    MissionItem,
    MissionRequest,
    Received,
)

_REPEAT, _TRIES = 0.7, 4
_SILENCE = 3.0  # s without a request, once some came
_WAYPOINT = 16  # MAV_CMD_NAV_WAYPOINT
_METRES = 1e3  # the wire's unit of a local item is 1e-4 m: its field is read as degrees
_REASONS = {
    Result.DENIED: "its companion takes no goals in phase {phase}",
    Result.INVALID: "goal {goal}, {place}, is outside its fence",
    Result.NO_SPACE: "too many goals",
    Result.CANCELLED: "the companion heard no more of it",
}


class GoalUpload:
    """Sends goals (3,) m, in the drone's own ENU frame; result: why not; empty: they are taken."""

    def __init__(self, drone: DroneView, goals: list[list[float]]) -> None:
        self.goals = goals
        self.result: str | None = None
        self._drone = drone
        self._to = (drone.system, drone.config.link.component_id)
        self._answers: list[Message] = []
        self._tries, self._sent_at = 0, -1e9
        self._asked = -1  # the item asked for last

    def due(self, now: float) -> list[Message]:
        """Return the messages to send now."""
        if self.result is not None:
            return []
        if self._answers:
            out, self._answers, self._sent_at = self._answers, [], now
            return out
        if self._asked >= 0:
            if now - self._sent_at > _SILENCE:
                self.result = f"no answer after goal {self._asked + 1}"
            return []
        if now - self._sent_at < _REPEAT:
            return []
        if self._tries >= _TRIES:
            allowed = "does link.allow name this ground station?"
            self.result = f"its companion does not answer: {allowed}"
            return []
        self._tries, self._sent_at = self._tries + 1, now
        return [MissionCount(*self._to, len(self.goals))]

    def hear(self, now: float, r: Received) -> None:
        """Take the companion's requests and its last word."""
        m = r.message
        if (r.source.system, r.source.component) != self._to or self.result is not None:
            return
        if isinstance(m, MissionRequest) and 0 <= m.seq < len(self.goals):
            self._asked = m.seq
            self._answers = [self._item(m.seq)]
        elif isinstance(m, MissionAck):
            self.result = self._reason(m.result)

    def _item(self, n: int) -> MissionItem:
        x, y, z = self.goals[n]
        where = (x / _METRES, y / _METRES, z)
        params = (0.0, 0.0, 0.0, math.nan)
        return MissionItem(*self._to, n, Frame.LOCAL_ENU, _WAYPOINT, 0, 1, params, *where)

    def _reason(self, result: int) -> str:
        if result == Result.ACCEPTED:
            return ""
        known = result in {r.value for r in Result}
        words = _REASONS.get(Result(result), Result(result).name.lower()) if known else str(result)
        n = max(self._asked, 0)
        place = ", ".join(f"{v:g}" for v in self.goals[n]) if self.goals else ""
        phase = self._drone.phase
        return words.format(goal=n + 1, place=place, phase=phase.value if phase else "unknown")
