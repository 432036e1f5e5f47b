"""A companion inside the process of whoever shows it frames: for studies of many flights.

The daemon's tick without its process, sockets and supervision: the same pipeline reads the same
MAVLink bytes from an endpoint that is handed in, and logs the same. Never for a real drone.
"""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path

from companion.flightlog.recorder import Recorder
from companion.pipeline import Pipeline, TickInputs
from companion.settings.config import load_config
from companion.supervision.phases import Phase
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Endpoint, Link
from mavlink_bridge.wire.video import Answer, Frame


class Resident:
    """One drone's companion; each frame is one tick, answered at once."""

    def __init__(self, config_file: Path, endpoint: Endpoint) -> None:
        """config_file: the drone's; its link and camera source are not opened.

        Raises:
            SettingsError: the configuration, with every mistake.
            OSError: the log cannot be made.
        """
        config = load_config(config_file)
        self._link = Link(
            endpoint, Codec(config.link.system_id, config.link.component_id, config.link.heard())
        )
        self._pipeline = Pipeline(config, time.perf_counter)
        self._packets: list[tuple[bool, bytes]] = []
        self._recorder: Recorder | None = None
        if config.log.path is not None:
            self._recorder = Recorder(config, Path(config.log.path))
            self._link.tap = lambda sent, data: self._packets.append((sent, data))

    def answer(self, frame: Frame) -> Answer:
        """Tick when the frame comes, on all that came in before it."""
        now = frame.time if frame.due is None else frame.due
        inputs = TickInputs(now, self._link.receive(), frame)
        started = time.perf_counter()
        out = self._pipeline.tick(inputs)
        for packet in out.packets:
            self._link.send(packet)
        out.stages["tick"] = time.perf_counter() - started
        if self._recorder is not None:
            counters = {"deadline_misses": 0} | asdict(self._link.codec.statistics)
            self._recorder.write(inputs, out, self._packets, counters)
            self._packets.clear()
        return Answer(inputs.time, self._link.packets_out, out.phase is Phase.DONE)

    def close(self) -> None:
        """Finish the log."""
        if self._recorder is not None:
            self._recorder.close()
