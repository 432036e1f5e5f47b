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
from companion.pipeline import Pipeline
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
        self._recorder = Recorder(Path(config.log.path), config.name) if config.log.path else None

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
                if self._recorder is not None:
                    out.stages["tick"] = time.perf_counter() - started
                    self._recorder.write(out, self._counters())
        finally:
            if self._recorder is not None:
                self._recorder.close()
            self._link.close()
            self._frames.close()

    def _counters(self) -> dict[str, int]:
        return {"deadline_misses": self._pace.misses} | asdict(self._link.codec.statistics)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self._stop = True
