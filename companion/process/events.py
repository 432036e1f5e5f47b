"""What is worth a line in the journal: changes from tick to tick, and the vehicle's own words."""

from __future__ import annotations

import logging

from companion.perception.camera_health import Trouble
from companion.pipeline import TickInputs, TickOutputs
from companion.process.journal import event
from companion.supervision.guard import Reason
from companion.supervision.phases import Phase
from mavlink_bridge.wire.codec import CodecStatistics
from mavlink_bridge.wire.messages import StatusText

_WARNING = 4  # MAV_SEVERITY up to this is worth a warning


class Events:
    """Follows the ticks of one daemon."""

    def __init__(self) -> None:
        self._phase: Phase | None = None
        self._reason: Reason | None = None
        self._armed: bool | None = None
        self._trouble: Trouble | None = None
        self._objection = ""
        self._problem = ""
        self._refused, self._refused_at = 0, -1e9

    def link(self, problem: str) -> None:
        """Log why the line to the vehicle is down, and that it is back."""
        if problem != self._problem:
            event("link", logging.WARNING, text=problem or "back")
        self._problem = problem

    def refused(self, counts: CodecStatistics, now: float) -> None:
        """Log that somebody is there who is not heard: a line a second, however many they are."""
        refused = counts.foreign + counts.unsigned
        if refused > self._refused and now - self._refused_at >= 1.0:
            new = refused - self._refused
            event("refused", logging.WARNING, frames=new, foreign=counts.foreign,
                  unsigned=counts.unsigned)  # fmt: skip
            self._refused, self._refused_at = refused, now

    def tick(self, inputs: TickInputs, out: TickOutputs) -> None:
        """Log what changed."""
        for received in inputs.received:
            if isinstance(received.message, StatusText):
                text = received.message
                level = logging.WARNING if text.severity <= _WARNING else logging.INFO
                event("vehicle says", level, text=text.text, severity=text.severity)
        if out.phase is not self._phase:
            event("phase", phase=out.phase.value, time=out.time)
            self._phase = out.phase
        armed = out.heartbeat.armed if out.heartbeat else None
        if armed is not self._armed:
            event("armed" if armed else "disarmed", time=out.time)
            self._armed = armed
        if out.trouble is not self._trouble:
            level = logging.INFO if out.trouble is Trouble.NONE else logging.WARNING
            event("camera", level, trouble=out.trouble.value, time=out.time)
        self._trouble = out.trouble
        if out.objection != self._objection and out.objection:
            event("objection", logging.WARNING, text=out.objection)
        self._objection = out.objection
        reason = out.verdict.reason if out.verdict else None
        if reason is not self._reason and Reason.PLAN is not reason is not None:
            event("guard", logging.WARNING, reason=reason.value, time=out.time)
        self._reason = reason
