"""Start, tick, stop: reads, lets the pipeline compute, publishes, keeps time."""

from __future__ import annotations

import signal
import time
from dataclasses import asdict
from pathlib import Path
from types import FrameType

from companion.config import CompanionConfig
from companion.framesource import open_source
from companion.pace import ClockPace, FramePace, Pace
from companion.phases import Phase
from companion.pipeline import Pipeline, TickInputs, TickOutputs
from companion.recorder import Recorder
from mavlink_bridge.codec import Codec
from mavlink_bridge.link import Link, open_endpoint


class Daemon:
    """One drone's flight application. Built completely before the first tick.

    Raises:
        EndpointError, VideoError, OSError: what cannot be opened, named.
    """

    def __init__(self, config: CompanionConfig) -> None:
        self._config = config
        self._stop = False
        self._pipeline = Pipeline(config, time.perf_counter)
        self._link = Link(
            open_endpoint(config.link.endpoint),
            Codec(config.link.system_id, config.link.component_id),
        )
        self._frames = open_source(config.camera.source)
        self._pace: Pace = (
            FramePace(self._link, self._frames)
            if config.timing.pace == "frames"
            else ClockPace(self._link, self._frames, config.timing.period)
        )
        self._packets: list[tuple[bool, bytes]] = []
        self._recorder: Recorder | None = None
        self._log_cost = 0.0
        if config.log.path:
            self._recorder = Recorder(config, Path(config.log.path))
            self._link.tap = lambda sent, data: self._packets.append((sent, data))

    def run(self) -> None:
        """Tick until told to stop or until there is nobody left to fly for."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_signal)
        try:
            while (inputs := self._pace.next(lambda: self._stop)) is not None:
                started = time.perf_counter()
                out = self._pipeline.tick(inputs)
                self._link.send(out.messages)
                self._pace.done(inputs, out.phase is Phase.DONE)
                self._record(inputs, out, time.perf_counter() - started)
        finally:
            if self._recorder is not None:
                self._recorder.close()
            self._link.close()
            self._frames.close()

    def _record(self, inputs: TickInputs, out: TickOutputs, taken: float) -> None:
        """Log the tick, once everything has been sent; its own cost shows in the next record."""
        if self._recorder is None:
            return
        out.stages |= {"tick": taken, "log": self._log_cost}
        started = time.perf_counter()
        self._recorder.write(inputs, out, self._packets, self._counters())
        self._packets.clear()
        self._log_cost = time.perf_counter() - started

    def _counters(self) -> dict[str, int]:
        return {"deadline_misses": self._pace.misses} | asdict(self._link.codec.statistics)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self._stop = True
