"""A companion inside the process that sends it frames: for studies of many flights.

It is the daemon's tick without its process, sockets and watchdog: the same companion reads the same
MAVLink bytes from an endpoint that is handed in, and logs the same. Never for a real drone.
"""

from __future__ import annotations

import time
from pathlib import Path

from companion.flightlog.recorder import Recorder
from companion.pipeline import Companion
from companion.process.session import Session
from companion.process.signing_keys import open_signing
from companion.settings.config import load_config
from companion.tick import TickInputs
from companion.types import Phase
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Endpoint, Link
from mavlink_bridge.wire.video import Answer, Frame


class InProcessCompanion:
    """One drone's companion; each frame is one tick and is answered at once."""

    def __init__(self, config_file: Path, endpoint: Endpoint) -> None:
        """Build the companion of a drone's file, whose link and camera source are not opened.

        Raises:
            SettingsError: every mistake of the configuration.
            OSError: the log cannot be made, or the signing key cannot be used.
        """
        config = load_config(config_file)
        link = config.link
        self._timestamps = (
            open_signing(config.name, link.signing.key, link.signing.link_id)
            if link.signing
            else None
        )
        signing = self._timestamps.signing if self._timestamps else None
        self._link = Link(endpoint, Codec(link.system_id, link.component_id, link.heard(), signing))
        # Processor time: what else the machine does, other flights included, does not count.
        stopwatch = time.thread_time
        companion = Companion(config, stopwatch)
        self._session = Session(companion, self._link, lambda: 0, stopwatch=stopwatch)
        if config.log.path is not None:
            self._session.open_log(Recorder(config, Path(config.log.path)))

    def answer(self, frame: Frame) -> Answer:
        """Tick on a frame and all messages before it; return the answer to the frame's sender."""
        now = frame.time if frame.due is None else frame.due
        if self._timestamps:
            self._timestamps.tick(time.perf_counter())
        inputs = TickInputs(now, self._link.receive(), frame)
        tick, _ = self._session.tick(inputs)
        self._session.log(inputs, tick)
        done = tick.supervised.phase is Phase.DONE
        return Answer(inputs.time, self._link.packets_out, done)

    def close(self) -> None:
        """Finish the log."""
        self._session.close_log()
