"""One companion on one link with its flight log, as the daemon and in-process flights share it."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from companion.flightlog.recorder import Recorder
from companion.pipeline import Companion
from companion.process.journal import event
from companion.process.presence import Presence
from companion.stage_clock import described
from companion.tick import Tick, TickInputs
from mavlink_bridge.wire.link import Link


class Session:
    """Ticks the companion, sends its messages, and logs the tick."""

    def __init__(
        self,
        companion: Companion,
        link: Link,
        misses: Callable[[], int],
        presence: Presence | None = None,
        stopwatch: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Start without a log.

        misses: returns the deadlines missed so far. presence: marks this companion's heartbeat;
        None: it goes out as it is. stopwatch: s, for the cost of a tick and of its log.
        """
        self._stopwatch = stopwatch
        self.recorder: Recorder | None = None
        self._companion = companion
        self._link = link
        self._misses = misses
        self._presence = presence
        self._packets: list[tuple[bool, bytes]] = []
        self._failure = ""
        self._tick_cost = self._log_cost = 0.0

    def open_log(self, recorder: Recorder) -> None:
        """Log every tick from now on."""
        self.recorder = recorder
        self._link.tap = lambda sent, data: self._packets.append((sent, data))

    def close_log(self) -> None:
        """End the log; the flight goes on without one."""
        self._link.tap = None
        self._packets.clear()
        if self.recorder is not None:
            self.recorder.close()
            self.recorder = None

    def tick(self, inputs: TickInputs) -> tuple[Tick, bool]:
        """Tick and send; return the tick, and whether a packet left the process."""
        started, packets = self._stopwatch(), self._link.packets_out
        tick = self._companion.tick(inputs)
        self._tell(tick.failure)
        for packet in tick.packets:
            self._link.send(self._presence.marked(packet) if self._presence else packet)
        self._tick_cost = self._stopwatch() - started
        return tick, self._link.packets_out > packets

    def _tell(self, failure: str) -> None:
        """Log a stage that fails, once for as long as it goes on."""
        if failure and failure != self._failure:
            event("stage failed", logging.ERROR, what=failure)
        self._failure = failure

    def log(self, inputs: TickInputs, tick: Tick) -> str | None:
        """Log the tick, once everything is sent; the cost of logging shows in the next record.

        Return why the log has ended, once; None while it goes on, and without a log.
        """
        if self.recorder is None:
            return None
        costs = {"tick": self._tick_cost, "log": self._log_cost}
        started = self._stopwatch()
        try:
            self.recorder.write(inputs, tick, self._packets, self.counters(), costs)
            problem = self.recorder.failed
        except Exception as error:  # no log is worth a flight
            problem = described(error)
        self._packets.clear()
        self._log_cost = self._stopwatch() - started
        if problem is not None:
            self.close_log()
        return problem

    def counters(self) -> dict[str, int]:
        """Return the deadlines missed and what the codec counted, so far."""
        return {"deadline_misses": self._misses()} | vars(self._link.codec.statistics)
