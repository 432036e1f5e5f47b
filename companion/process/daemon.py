"""The daemon: it reads, lets the companion decide, sends, and keeps time."""

from __future__ import annotations

import contextlib
import logging
import os
import secrets
import signal
import time
from dataclasses import replace
from pathlib import Path
from types import FrameType

from companion.flightlog.recorder import Recorder
from companion.pipeline import Companion
from companion.process.directories import ControlMark, StateFile, log_path
from companion.process.events import Events
from companion.process.frame_source import FrameSource, open_source
from companion.process.journal import event
from companion.process.liveness import Liveness
from companion.process.pace import ClockPace, FramePace, Pace
from companion.process.presence import Presence
from companion.process.rest import Rest
from companion.process.service_manager import ServiceManager
from companion.process.session import Session
from companion.process.signing_keys import Timestamps, open_signing
from companion.process.vehicle_lock import VehicleLock
from companion.settings.config import CompanionConfig
from companion.settings.sections import LinkConfig
from companion.stage_clock import described
from companion.supervision.phases import COMPANION_HEARTBEAT
from companion.tick import Tick, TickInputs
from companion.types import Phase
from mavlink_bridge.autopilots.registry import adapter
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.ids import ComponentId
from mavlink_bridge.wire.link import Link, open_endpoint
from mavlink_bridge.wire.messages import Source

_LEAVE_WITHIN = 1.5  # s to wait for the autopilot to hold, of the two that SIGTERM allows
_LAST_REQUESTS = 3  # times that hold is requested where the ticks end by an error
# A terminal that is closed, and a user's signal, end the daemon as SIGTERM does: none kills it.
_ENDING = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGUSR1, signal.SIGUSR2)
_FED_AT_REST = 0.25  # s between feeds of the watchdog while ticks are left out
_STATUS_PERIOD = 5.0  # s between notices to the service manager during start-up


class Daemon:
    """Runs one drone's flight application; built completely before the first tick.

    Raises:
        VehicleTaken, EndpointError, VideoError, OSError: something cannot be had; it is named.
    """

    def __init__(self, config: CompanionConfig) -> None:
        self._mark = ControlMark(os.environ)
        if self._mark.left_behind and config.mission.auto:
            config = _without_auto(config)
        link = config.link
        self._config = config
        self._stop = False
        self._started = time.monotonic()
        self._leave_until: float | None = None
        self._streaming = False
        self._status_sent = -_STATUS_PERIOD
        self._ready = False
        self._duplicate = False  # another companion flies this vehicle
        self._failed = False  # an error ended the ticks
        self._lock = VehicleLock(f"{link.endpoint}#{link.system_id}")
        signing = link.signing
        self._timestamps = (
            open_signing(config.name, signing.key, signing.link_id) if signing else None
        )
        self._link = _open_link(link, self._timestamps)
        self._frames = open_source(config.camera)
        me = Source(link.system_id, link.component_id)
        self._presence = Presence(me, 1 + secrets.randbelow((1 << 32) - 1))
        self._rest = Rest(
            config.timing.period,
            Source(link.system_id, ComponentId.AUTOPILOT1),
            config.mission.auto,
        )
        self._fed = self._started
        self._pace = _make_pace(config, self._link, self._frames, self._presence, self._rest)
        companion = Companion(config, time.perf_counter)
        self._session = Session(
            companion,
            self._link,
            lambda: self._pace.misses,
            self._presence,
        )
        if config.log.path:
            self._open_log(log_path(config.log.path, os.environ))
        self._service_manager = ServiceManager(os.environ)
        self._state = StateFile(os.environ)
        self._liveness = Liveness(config.timing.period)
        self._events = Events()
        event(
            "start",
            drone=config.name,
            system=link.system_id,
            endpoint=link.endpoint,
            camera=config.camera.source,
            log=self._session.recorder and self._session.recorder.path,
            solver=companion.solver,
        )
        if companion.solver == "piqp":
            event("slow solver", logging.WARNING, why="no compiled kernel; see companion doctor")

    def run(self) -> bool:
        """Tick until a signal stops the daemon, or the sender of the frames hangs up.

        Return False where another companion flies this vehicle, or an error ended the daemon.
        """
        for number in _ENDING:
            signal.signal(number, self._on_signal)
        try:
            self._tick_to_the_end()
        except Exception as error:
            self._failed = True
            event("failed", logging.ERROR, what=described(error))
            self._give_back()
        finally:
            self._close()
        return not (self._duplicate or self._failed)

    def _tick_to_the_end(self) -> None:
        while (inputs := self._pace.next(self._over)) is not None:
            self._look_for_duplicate(inputs)
            self._tick(replace(inputs, leave=self._stop))

    def _give_back(self) -> None:
        """Request hold where setpoints streamed: an error ended the ticks themselves."""
        if not self._streaming:
            return
        with contextlib.suppress(Exception):
            link = self._config.link
            for _ in range(_LAST_REQUESTS):
                self._link.send(adapter(link.autopilot, link.system_id).hold())

    def _close(self) -> None:
        """Close everything, each part even where another cannot be closed."""
        event("stopped", **self._session.counters())
        with contextlib.ExitStack() as stack:
            stack.callback(self._service_manager.close)
            for part in (self._lock, self._frames):
                stack.callback(part.close)
            if self._timestamps:
                stack.callback(self._timestamps.save)
            if not (self._duplicate or self._failed):
                stack.callback(self._mark.clear)
            stack.callback(self._link.close)
            stack.callback(self._session.close_log)
            stack.callback(self._service_manager.stopping)

    def _look_for_duplicate(self, inputs: TickInputs) -> None:
        """End where another companion of this vehicle is heard; control goes to the autopilot.

        The lock keeps a second companion off this machine; one on another machine is heard where
        the autopilot passes its messages on.
        """
        if not self._duplicate and self._presence.another(inputs.received):
            self._duplicate = self._stop = True
            link = self._config.link
            ids = {"system": link.system_id, "component": link.component_id}
            event("another companion", logging.ERROR, **ids)

    def _tick(self, inputs: TickInputs) -> None:
        """Decide, send, then do everything that can wait."""
        if self._timestamps:
            self._timestamps.tick(time.perf_counter())
        tick, sent = self._session.tick(inputs)
        self._pace.done(inputs, tick.supervised.phase is Phase.DONE)
        if self._ready:
            self._rest.follow(tick)
        self._streaming = tick.supervised.verdict is not None
        self._mark.note(self._streaming)
        try:
            self._report(inputs, tick, sent)
        except Exception as error:  # a line in a journal is worth no flight
            event("report failed", logging.ERROR, what=described(error))
        if problem := self._session.log(inputs, tick):
            event("log", logging.WARNING, text=problem)

    def _report(self, inputs: TickInputs, tick: Tick, sent: bool) -> None:
        """Report the tick to the service manager, the state file and the journal."""
        phase, inhibited = tick.supervised.phase.value, tick.supervised.inhibit_reason
        if self._liveness.judge(tick, sent) and self._ready:
            self._service_manager.alive()
        armed = tick.vehicle.heartbeat is not None and tick.vehicle.heartbeat.armed
        if not self._ready and self._liveness.ready:
            self._ready = True
            self._service_manager.ready(phase)
            event("ready", seconds=time.monotonic() - self._started)
        state = {"phase": phase, "armed": armed, "ready": self._ready}
        if self._state.write(**state, inhibit_reason=inhibited) and self._ready:
            self._service_manager.status(inhibited or phase + ", armed" * armed)
        self._events.tick(inputs, tick)
        self._events.link(self._link.problem)
        self._events.address(self._link.address)
        self._events.refused(self._link.codec.statistics, time.monotonic())

    def _over(self) -> bool:
        """Return whether to stop waiting for a tick; report a start that takes long.

        At rest it feeds the watchdog, too: the daemon reads what comes, and no tick is due.
        """
        now = time.monotonic()
        if not self._ready and now - self._status_sent >= _STATUS_PERIOD:
            self._status_sent = now
            self._service_manager.starting(self._liveness.missing)
            event(self._liveness.missing)
        if self._rest.on and now - self._fed >= _FED_AT_REST:
            self._fed = now
            self._service_manager.alive()
        if not self._stop:
            return False
        if self._leave_until is None:
            self._leave_until = now + _LEAVE_WITHIN
            self._service_manager.stopping()
            event("stopping", streaming=self._streaming)
        return not self._streaming or now >= self._leave_until

    def _open_log(self, path: Path) -> None:
        """Begin the flight log; fly without one where it cannot be made."""
        try:
            self._session.open_log(Recorder(self._config, path))
        except OSError as error:
            event("log", logging.WARNING, text=f"no flight log: {error}")

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self._stop = True


def _without_auto(config: CompanionConfig) -> CompanionConfig:
    """Return the configuration of a daemon that arms nothing by itself.

    The one before was cut off in control: its vehicle may lie among people who look what happened.
    """
    event(
        "cut off in control",
        logging.WARNING,
        text="the daemon before this one ended in flight: mission.auto is off until this one is "
        "stopped, or has flown",
    )
    mission = config.mission.model_copy(update={"auto": False})
    return config.model_copy(update={"mission": mission})


def _open_link(link: LinkConfig, timestamps: Timestamps | None) -> Link:
    codec = Codec(
        link.system_id,
        link.component_id,
        allow=link.heard(),
        signing=timestamps.signing if timestamps else None,
    )
    return Link(open_endpoint(link.endpoint), codec, Source(link.system_id, ComponentId.AUTOPILOT1))


def _make_pace(
    config: CompanionConfig, link: Link, frames: FrameSource, presence: Presence, rest: Rest
) -> Pace:
    if config.timing.pace == "frames":
        return FramePace(link, frames)
    system = config.link.system_id
    vehicle = Source(system, ComponentId.AUTOPILOT1)
    greeting = [
        *presence.marked([COMPANION_HEARTBEAT]),
        *adapter(config.link.autopilot, system).request_streams(),
    ]
    return ClockPace(link, frames, config.timing.period, vehicle, greeting, rest)
