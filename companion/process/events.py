"""Lines of the journal: changes from tick to tick, and the vehicle's own words."""

from __future__ import annotations

import logging
import math

from companion.estimation.vehicle_clock import ClockEstimate
from companion.perception.camera_health import CameraFault
from companion.process.journal import event
from companion.supervision.guard import Reason
from companion.tick import Tick, TickInputs
from companion.types import Phase
from mavlink_bridge.wire.codec import CodecStatistics
from mavlink_bridge.wire.messages import StatusText

_CAUSES = ("foreign", "unsigned", "replayed", "strange")  # why a frame is refused
_POOR_EYES = ("surprises", "clear finds")  # limits of the speed
_SILENT = 60.0  # s without a refusal, after which the next one is news; of surprises, too
_COUNTS_AFTER = 600.0  # s between lines while refusals go on
_RATE_OFF = 0.005  # by which a vehicle's clock may run faster or slower without a word
_MISMATCH = 0.1  # of the acceleration expected, as a share, that is worth a line
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
        self._address = ""
        self._refused: dict[str, tuple[int, float]] = {}  # count, and time of the last, by cause
        self._refused_told, self._refused_at = 0, -math.inf
        self._ahead, self._ahead_at = 0, -1e9
        self._weak = False  # the thrust gives another acceleration than expected
        self._surprised_at = -math.inf
        self._strangers: frozenset[int] = frozenset()
        self._clock: tuple[int, bool] = (0, False)  # jumps, whether the rate is off

    def link(self, problem: str) -> None:
        """Log why the link to the vehicle is down, and that it is back."""
        if problem != self._problem:
            event("link", logging.WARNING, text=problem or "back")
        self._problem = problem

    def address(self, address: str) -> None:
        """Log the vehicle's address over UDP where it is known, and each change of it."""
        if address != self._address:
            level = logging.WARNING if self._address else logging.INFO
            event("vehicle's address", level, address=address, before=self._address)
        self._address = address

    def refused(self, counts: CodecStatistics, now: float) -> None:
        """Log that messages were refused: each cause at once, then all counts at a low rate.

        A cause that has been silent is news again. now: s.
        """
        causes = {name: getattr(counts, name) for name in _CAUSES}
        news = False
        for name, count in causes.items():
            before, at = self._refused.get(name, (0, -math.inf))
            if count > before:
                news |= now - at >= _SILENT
                self._refused[name] = count, now
        due = sum(causes.values()) > self._refused_told and now - self._refused_at >= _COUNTS_AFTER
        if news or due:
            total = sum(causes.values())
            event("refused", logging.WARNING, frames=total - self._refused_told, **causes)
            self._refused_told, self._refused_at = total, now

    def tick(self, inputs: TickInputs, tick: Tick) -> None:
        """Log what changed since the tick before."""
        supervised, fault = tick.supervised, tick.seen.fault
        self._watch_clock(inputs.clock, tick.time)
        self._watch_stamps(tick)
        self._watch_thrust(tick)
        self._watch_poor_eyes(tick)
        self._watch_strangers(tick)
        for received in inputs.received:
            if isinstance(received.message, StatusText):
                text = received.message
                level = logging.WARNING if text.severity <= _WARNING else logging.INFO
                event("vehicle says", level, text=text.text, severity=text.severity)
        for words in tick.vehicle.refusals:
            event("vehicle refuses", logging.WARNING, text=words, time=tick.time)
        if supervised.phase is not self._phase:
            event("phase", phase=supervised.phase.value, time=tick.time)
            self._phase = supervised.phase
        armed = tick.vehicle.heartbeat.armed if tick.vehicle.heartbeat else None
        if armed is not self._armed:
            event("armed" if armed else "disarmed", time=tick.time)
            self._armed = armed
        if fault is not self._fault:
            level = logging.INFO if fault is CameraFault.NONE else logging.WARNING
            why = tick.seen.problem or tick.seen.inhibit_reason
            told = {"reason": why} if why else {}
            event("camera", level, fault=fault.value, time=tick.time, **told)
        self._fault = fault
        self._watch_inhibition(supervised.inhibit_reason)
        reason = supervised.verdict.reason if supervised.verdict else None
        if reason is not self._reason and Reason.PLAN is not reason is not None:
            why = tick.broken.finding if tick.broken else ""
            if reason is Reason.UNCERTIFIED and supervised.certified is not None:
                why = "; ".join([supervised.certified.cause, *tick.beyond])
            found = {"why": why} if why else {}
            event("guard", logging.WARNING, reason=reason.value, time=tick.time, **found)
        self._reason = reason

    def _watch_inhibition(self, reason: str) -> None:
        """Log why the vehicle is not to be flown, and that the reason has gone."""
        if reason and reason != self._inhibit_reason:
            event("inhibited", logging.WARNING, reason=reason)
        elif self._inhibit_reason and not reason:
            event("no longer inhibited", reason=self._inhibit_reason)
        self._inhibit_reason = reason

    def _watch_clock(self, clock: ClockEstimate | None, time: float) -> None:
        """Log that the vehicle's clock has jumped, or begins to run at another rate than ours."""
        if clock is None:
            return
        jumps, was_off = self._clock
        if clock.jumps > jumps:
            event("vehicle clock jumped", logging.WARNING, jumps=clock.jumps, time=time)
        by = abs(clock.rate - 1.0)
        off = by > _RATE_OFF / 2 if was_off else by > _RATE_OFF and clock.rate_doubt < by / 3
        if off and not was_off:
            rate, doubt = round(clock.rate, 4), round(clock.rate_doubt, 4)
            event("vehicle clock rate", logging.WARNING, rate=rate, doubt=doubt, time=time)
        self._clock = clock.jumps, off

    def _watch_thrust(self, tick: Tick) -> None:
        """Log that thrust gives another acceleration than commanded, until it is learnt."""
        by = tick.motion.hover.mismatch
        weak = abs(by) > (_MISMATCH / 2 if self._weak else _MISMATCH)
        if weak and not self._weak:
            event("thrust", logging.WARNING, acceleration=f"{by:+.0%}", time=tick.time)
        self._weak = weak

    def _watch_poor_eyes(self, tick: Tick) -> None:
        """Log that the drone flies slowly as its eyes miss neighbours or doubt; once a minute."""
        slow = tick.reference is not None and tick.reference.speed_limit in _POOR_EYES
        if slow and not 0.0 <= tick.time - self._surprised_at < _SILENT:
            speed = f"{tick.reference.speed:.2f}" if tick.reference else ""
            event("eyes miss neighbours", logging.WARNING, speed=speed, time=tick.time)
            self._surprised_at = tick.time

    def _watch_strangers(self, tick: Tick) -> None:
        """Log that a neighbour gives no way where none was known to."""
        strangers = tick.reference.strangers if tick.reference else frozenset()
        if strangers and not self._strangers:
            ids = ",".join(str(n) for n in sorted(strangers))
            event("gives no way", logging.WARNING, neighbours=ids, time=tick.time)
        self._strangers = strangers

    def _watch_stamps(self, tick: Tick) -> None:
        """Log that telemetry was stamped in the future and refused: at most one line a second."""
        ahead = tick.vehicle.ahead
        if ahead > self._ahead and not 0.0 <= tick.time - self._ahead_at < 1.0:
            event("stamps of the future", logging.WARNING, refused=ahead, time=tick.time)
            self._ahead, self._ahead_at = ahead, tick.time
