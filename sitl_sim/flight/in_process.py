"""Companions inside the simulator's own process: no sockets and no waiting.

Only what crosses the wire passes between simulator and companion, here too: MAVLink bytes over a
memory endpoint, frames in, answers out. The companion's class is found by its entry point.
"""

from __future__ import annotations

import os
import traceback
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, Protocol

from numpy.typing import NDArray

from mavlink_bridge.wire.memory import MemoryEndpoint
from mavlink_bridge.wire.video import Answer, Frame
from sitl_sim.scenarios.companion_entry_points import companion_class


class InProcessCompanion(Protocol):
    """A companion that ticks when it is given a frame."""

    def answer(self, frame: Frame) -> Answer:
        """Tick on the frame and return the answer."""
        ...

    def close(self) -> None:
        """Finish the flight log."""
        ...


class LocalFrames:
    """The simulator's end of one vehicle's frame channel, with the companion in this process."""

    def __init__(self) -> None:
        self._companion: InProcessCompanion | None = None
        self._answers: deque[Answer] = deque()
        self._error_log = Path()
        self.failed = False
        self.arrays: Mapping[str, NDArray[Any]] = {}  # of the last frame sent

    def start_companion(self, config: Path, endpoint: MemoryEndpoint) -> None:
        """Start a companion of this configuration; its MAVLink link is `endpoint`."""
        self._error_log = config.with_name("stderr.log")
        self._companion = companion_class("in_process")(config, endpoint)

    @property
    def connected(self) -> bool:
        """Whether a companion runs."""
        return self._companion is not None

    def send(self, frame: Frame) -> bool:
        """Let the companion tick on a frame; times are rounded as they are on the wire.

        A companion that raises is lost, as its process would be: its vehicle flies on without it.
        """
        if self._companion is None:
            return False
        due = None if frame.due is None else to_microseconds(frame.due)
        self.arrays = frame.arrays
        received = Frame(to_microseconds(frame.time), frame.arrays, frame.packets, due)
        try:
            self._answers.append(self._companion.answer(received))
        except Exception:
            self._lost()
        return not self.failed

    def _lost(self) -> None:
        """Give the companion up for the exception that is being handled, and write it down."""
        self._error_log.write_text(traceback.format_exc(), encoding="utf-8")
        self.failed = True
        self.close()

    def answer(self, timeout: float) -> Answer | None:
        """Return the next answer without waiting; None where there is none."""
        return self._answers.popleft() if self._answers else None

    def close(self) -> None:
        """End the companion."""
        if self._companion is not None:
            self._companion.close()
        self._companion = None

    hang_up = close


def to_microseconds(time: float) -> float:
    """Return the time [s] rounded to whole microseconds."""
    return round(time * 1e6) / 1e6


class SerialExecutor(Executor):
    """Runs each call before `submit` returns: one thread, one order."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call `fn` and return its finished future; an exception of `fn` is raised here."""
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def make_pools(ticks_here: bool, waits: bool) -> tuple[Executor, Executor]:
    """Return what renders, and what delivers frames.

    ticks_here: companions tick in this thread, in one order; pictures are rendered ahead in
    another. waits: there are pictures to render, or answers to wait for; else this thread does all.
    """
    if not waits:
        return SerialExecutor(), SerialExecutor()
    if ticks_here:
        return ThreadPoolExecutor(max_workers=1), SerialExecutor()
    # Deliveries wait for captures that were submitted before them, so not all can wait.
    pool = ThreadPoolExecutor(max_workers=2 * (os.cpu_count() or 1))
    return pool, pool
