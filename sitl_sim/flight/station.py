"""One vehicle's end of the wire, and the companion at the other: started, waited for, ended."""

from __future__ import annotations

import subprocess
import sys
import time
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.memory import MemoryEndpoint
from mavlink_bridge.wire.video import FrameServer
from sitl_sim.external.priority import COMPANION, hurry
from sitl_sim.faults.camera import FaultyCamera
from sitl_sim.faults.link import FaultyLine, FaultyTelemetry
from sitl_sim.flight.in_process import LocalFrames

Shot = tuple[float, dict[str, NDArray[Any]]]  # capture time [s, vehicle's clock], what it shows


@dataclass
class Station:
    """Everything of one vehicle that is on the wire."""

    name: str
    index: int
    boot_ms: int
    companion: Link
    ground: Link
    frames: FrameServer | LocalFrames
    line: FaultyLine
    telemetry: FaultyTelemetry
    camera: FaultyCamera
    process: subprocess.Popen[bytes] | None = None
    capture: Future[Shot] | None = None  # the picture taken for the next tick
    delivery: Future[bool] | None = None  # and on its way to the companion
    due_ms: int | None = None  # when the answer to the frame under way takes effect
    landed: bool = False
    deaf: bool = False  # its companion was there and is gone

    @property
    def process_id(self) -> int | None:
        """Of the companion's process, where there is one and it runs."""
        return self.process.pid if self.process is not None and self._runs() else None

    @property
    def exit_code(self) -> int | None:
        """How the companion ended; negative: by that signal. 1: raised, in this process."""
        if isinstance(self.frames, LocalFrames):
            return 1 if self.frames.failed else None
        return self.process.returncode if self.process is not None else None

    def launch(self, folder: Path, urgent: bool) -> None:
        """Start the companion of `folder`/config.yaml; urgent: its process is hurried."""
        config = folder / "config.yaml"
        if isinstance(self.frames, LocalFrames):
            end = self.companion.endpoint
            assert isinstance(end, MemoryEndpoint)
            self.frames.board(config, MemoryEndpoint(end))
            return
        with (folder / "stderr.log").open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "companion", "run", str(config)],
                stdin=subprocess.DEVNULL, stdout=log, stderr=log,
            )  # fmt: skip
        if urgent:
            hurry(COMPANION, self.process.pid)

    def wait(self, folder: Path, deadline: float) -> None:
        """Until the companion launched is on its frame channel; deadline: CLOCK_MONOTONIC [s].

        Raises:
            RuntimeError: it ended, with the end of what it printed; or time ran out.
        """
        while self.process is not None and not self.frames.connected:
            if not self._runs():
                log = folder / "stderr.log"
                tail = log.read_text(errors="replace").strip().splitlines()[-3:]
                raise RuntimeError(f"{self.name}: companion ended: " + " | ".join(tail))
            if time.monotonic() > deadline:
                raise RuntimeError(f"{self.name}: companion did not connect in time")
            time.sleep(0.01)

    def lost(self, deadline: float) -> bool:
        """Whether there is no answer to wait for any longer; deadline as for `wait`."""
        gone = self.process is not None and not self._runs()
        return gone or not self.frames.connected or time.monotonic() > deadline

    def lose(self) -> None:
        """Wait no more for a companion that does not answer; it is shown nothing any longer."""
        self.deaf = True
        self.frames.hang_up()

    def close(self) -> None:
        """Release the ports: the companion then ends."""
        self.frames.close()
        self.companion.close()
        self.ground.close()

    def end(self) -> None:
        """Let the companion finish its log; make it end where it does not."""
        if self.process is None:
            return
        try:
            self.process.wait(timeout=0.5)
        except subprocess.TimeoutExpired:
            self.process.terminate()
            try:
                self.process.wait(timeout=10.0)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()

    def _runs(self) -> bool:
        return self.process is not None and self.process.poll() is None
