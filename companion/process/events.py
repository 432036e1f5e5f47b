"""Lines of the journal: changes from tick to tick, and the vehicle's own words."""

from __future__ import annotations

import logging

from companion.perception.camera_health import CameraFault
from companion.process.journal import event
from companion.supervision.guard import Reason
from companion.tick import Tick, TickInputs
from companion.types import Phase
from mavlink_bridge.wire.codec import CodecStatistics
from mavlink_bridge.wire.messages import StatusText

_WARNING = 4  # MAV_SEVERITY up to this is a warning


class Events:
    """Follows the ticks of one daemon and logs what changes."""

    def __init__(self) -> None:
        self._phase: Phase | None = None
        self._reason: Reason | None = None
        self._armed: bool | None = None
        self._fault: CameraFault | None = None
        self._inhibit_reason = ""
        self._problem = ""
        self._refused, self._refused_at = 0, -1e9

    def link(self, problem: str) -> None:
        """Log why the link to the vehicle is down, and that it is back."""
        if problem != self._problem:
            event("link", logging.WARNING, text=problem or "back")
        self._problem = problem

    def refused(self, counts: CodecStatistics, now: float) -> None:
        """Log that foreign or unsigned messages were refused: at most one line a second."""
        refused = counts.foreign + counts.unsigned
        if refused > self._refused and now - self._refused_at >= 1.0:
            new = refused - self._refused
            event(
                "refused",
                logging.WARNING,
                frames=new,
                foreign=counts.foreign,
                unsigned=counts.unsigned,
            )
            self._refused, self._refused_at = refused, now

    def tick(self, inputs: TickInputs, tick: Tick) -> None:
        """Log what changed since the tick before."""
        supervised, fault = tick.supervised, tick.seen.fault
        for received in inputs.received:
            if isinstance(received.message, StatusText):
                text = received.message
                level = logging.WARNING if text.severity <= _WARNING else logging.INFO
                event("vehicle says", level, text=text.text, severity=text.severity)
        if supervised.phase is not self._phase:
            event("phase", phase=supervised.phase.value, time=tick.time)
            self._phase = supervised.phase
        armed = tick.vehicle.heartbeat.armed if tick.vehicle.heartbeat else None
        if armed is not self._armed:
            event("armed" if armed else "disarmed", time=tick.time)
            self._armed = armed
        if fault is not self._fault:
            level = logging.INFO if fault is CameraFault.NONE else logging.WARNING
            told = {"reason": tick.seen.inhibit_reason} if tick.seen.inhibit_reason else {}
            event("camera", level, fault=fault.value, time=tick.time, **told)
        self._fault = fault
        if supervised.inhibit_reason != self._inhibit_reason and supervised.inhibit_reason:
            event("inhibited", logging.WARNING, reason=supervised.inhibit_reason)
        self._inhibit_reason = supervised.inhibit_reason
        reason = supervised.verdict.reason if supervised.verdict else None
        if reason is not self._reason and Reason.PLAN is not reason is not None:
            event("guard", logging.WARNING, reason=reason.value, time=tick.time)
        self._reason = reason
