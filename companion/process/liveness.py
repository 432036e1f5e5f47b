"""Liveness: whether a tick did its work, the condition on READY and on every WATCHDOG.

Ticks that end feed the watchdog, not time that passes. While setpoints stream, such a tick has sent
a solved plan; the guard's fallbacks count too, but only as long as they are meant to last. Without
a stream, every tick that ends counts: a companion that waits for a pilot is watched as well. While
it ticks but once a second (`rest.py`), what it reads between two ticks feeds the watchdog, too.
"""

from __future__ import annotations

from companion.supervision.guard_config import FALLBACK_MAX
from companion.tick import Tick


class Liveness:
    """Follows the ticks of one daemon; period: s, of the ticks."""

    def __init__(self, period: float) -> None:
        self._fallback_ticks = round(FALLBACK_MAX / period)
        self._heard = self._seen = self._solved = False

    def judge(self, tick: Tick, sent: bool) -> bool:
        """Return whether this tick did its work; sent: whether its messages left the process."""
        plan, verdict = tick.planned.plan, tick.supervised.verdict
        self._heard |= tick.vehicle.heartbeat is not None
        self._seen |= tick.seen.own is not None
        self._solved |= tick.planned.self_tested or (plan is not None and plan.usable)
        if verdict is None:
            return True
        return sent and verdict.bad_ticks <= self._fallback_ticks

    @property
    def ready(self) -> bool:
        """Whether a heartbeat, a frame and a solved plan have been there."""
        return self._heard and self._seen and self._solved

    @property
    def missing(self) -> str:
        """The inputs that start-up still waits for, in words."""
        steps = (
            ("heartbeat and telemetry of the autopilot", self._heard),
            ("camera frame", self._seen),
            ("solved plan", self._solved),
        )
        return "waiting for " + ", ".join(what for what, there in steps if not there)
