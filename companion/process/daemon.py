"""Start, tick, stop: reads, lets the companion decide, publishes, keeps time."""

from __future__ import annotations

import logging
import os
import signal
import time
from dataclasses import replace
from pathlib import Path
from types import FrameType

from companion.flightlog.recorder import Recorder
from companion.pipeline import Companion
from companion.process.directories import StateFile, log_path
from companion.process.events import Events
from companion.process.frame_source import open_source
from companion.process.journal import event
from companion.process.liveness import Liveness
from companion.process.pace import ClockPace, FramePace, Pace
from companion.process.session import Session
from companion.process.signing_keys import open_signing
from companion.process.supervisor import Supervisor
from companion.process.vehicle_lock import VehicleLock
from companion.settings.config import CompanionConfig
from companion.supervision.phases import COMPANION_HEARTBEAT
from companion.tick import Tick, TickInputs
from companion.types import Phase
from mavlink_bridge.autopilots.registry import adapter
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link, open_endpoint
from mavlink_bridge.wire.messages import Heartbeat, Source

_LEAVE_WITHIN = 1.5  # s to wait for the autopilot to hold, of the two that SIGTERM allows
_STATUS_PERIOD = 5.0  # s between lines to the supervisor while waiting


class Daemon:
    """One drone's flight application. Built completely before the first tick.

    Raises:
        VehicleTaken, EndpointError, VideoError, OSError: what cannot be had, named.
    """

    def __init__(self, config: CompanionConfig) -> None:
        self._config = config
        self._stop = False
        self._started = time.monotonic()
        self._leave_until: float | None = None
        self._streaming = False
        self._said = -_STATUS_PERIOD
        self._ready = False
        self._twin = False
        self._lock = VehicleLock(f"{config.link.endpoint}#{config.link.system_id}")
        link = config.link
        self._timestamps = link.signing and open_signing(
            config.name, link.signing.key, link.signing.link_id
        )
        self._link = Link(
            open_endpoint(link.endpoint),
            Codec(
                link.system_id,
                link.component_id,
                allow=link.heard(),
                signing=self._timestamps.signing if self._timestamps else None,
            ),
        )
        self._frames = open_source(config.camera)
        self._pace: Pace = (
            FramePace(self._link, self._frames)
            if config.timing.pace == "frames"
            else ClockPace(
                self._link,
                self._frames,
                config.timing.period,
                Source(link.system_id, 1),
                [COMPANION_HEARTBEAT, *adapter(link.autopilot, link.system_id).request_streams()],
            )
        )
        self._session = Session(
            Companion(config, time.perf_counter), self._link, lambda: self._pace.misses
        )
        path = log_path(config.log.path, os.environ) if config.log.path else None
        if path is not None:
            self._open_log(path)
        self._supervisor = Supervisor(os.environ)
        self._state = StateFile(os.environ)
        self._liveness = Liveness(config.timing.period)
        self._events = Events()
        event(
            "start",
            drone=config.name,
            system=config.link.system_id,
            endpoint=config.link.endpoint,
            camera=config.camera.source,
            log=self._session.recorder and self._session.recorder.path,
        )

    def run(self) -> bool:
        """Tick until told to stop or until there is nobody left to fly for.

        False where another companion turned out to fly this vehicle.
        """
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_signal)
        try:
            while (inputs := self._pace.next(self._over)) is not None:
                self._look_for_twin(inputs)
                self._tick(replace(inputs, leave=self._stop))
        finally:
            self._supervisor.stopping()
            self._session.close_log()
            self._link.close()
            if self._timestamps:
                self._timestamps.save()
            self._frames.close()
            self._lock.close()
            self._supervisor.close()
            event("stopped", **self._session.counters())
        return not self._twin

    def _look_for_twin(self, inputs: TickInputs) -> None:
        """Two companions on one vehicle: whoever hears the other gives control back and ends.

        The lock keeps a second one off this machine; another machine's is heard where the
        autopilot passes it on.
        """
        me = Source(self._config.link.system_id, self._config.link.component_id)
        if not self._twin and any(
            r.source == me and isinstance(r.message, Heartbeat) for r in inputs.received
        ):
            self._twin = self._stop = True
            event("another companion", logging.ERROR, system=me.system, component=me.component)

    def _tick(self, inputs: TickInputs) -> None:
        """Decide, publish, then do everything that can wait."""
        if self._timestamps:
            self._timestamps.tick(time.perf_counter())
        tick, sent = self._session.tick(inputs)
        self._pace.done(inputs, tick.supervised.phase is Phase.DONE)
        self._streaming = tick.supervised.verdict is not None
        self._report(inputs, tick, sent)
        if problem := self._session.log(inputs, tick):
            event("log", logging.WARNING, text=problem)

    def _report(self, inputs: TickInputs, tick: Tick, sent: bool) -> None:
        """Tell the supervisor and the journal what came of the tick."""
        phase, inhibited = tick.supervised.phase.value, tick.supervised.inhibit_reason
        if self._liveness.judge(tick, sent) and self._ready:
            self._supervisor.alive()
        armed = tick.vehicle.heartbeat is not None and tick.vehicle.heartbeat.armed
        if not self._ready and self._liveness.ready:
            self._ready = True
            self._supervisor.ready(phase)
            event("ready", seconds=time.monotonic() - self._started)
        state = {"phase": phase, "armed": armed, "ready": self._ready}
        if self._state.write(**state, inhibit_reason=inhibited) and self._ready:
            self._supervisor.status(inhibited or phase + ", armed" * armed)
        self._events.tick(inputs, tick)
        self._events.link(self._link.problem)
        self._events.refused(self._link.codec.statistics, time.monotonic())

    def _over(self) -> bool:
        """Whether to stop waiting for a tick; also looks after a start that takes its time."""
        now = time.monotonic()
        if not self._ready and now - self._said >= _STATUS_PERIOD:
            self._said = now
            self._supervisor.starting(self._liveness.missing)
            event(self._liveness.missing)
        if not self._stop:
            return False
        if self._leave_until is None:
            self._leave_until = now + _LEAVE_WITHIN
            self._supervisor.stopping()
            event("stopping", streaming=self._streaming)
        return not self._streaming or now >= self._leave_until

    def _open_log(self, path: Path) -> None:
        """Begin the flight log; where that cannot be, fly without."""
        try:
            self._session.open_log(Recorder(self._config, path))
        except OSError as error:
            event("log", logging.WARNING, text=f"no flight log: {error}")

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self._stop = True
