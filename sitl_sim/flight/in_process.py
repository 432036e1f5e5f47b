"""Companions inside the simulator's own process: no sockets, nobody waits.

The simulator knows a companion only by what crosses the wire. So also here: MAVLink bytes over a
memory endpoint, frames in, answers out; the class is found by name, as a process's module is.
"""

from __future__ import annotations

import traceback
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any, Protocol

from mavlink_bridge.wire.memory import MemoryEndpoint
from mavlink_bridge.wire.video import Answer, Frame
from sitl_sim.scenarios.companion_door import companion_class


class Mind(Protocol):
    """A companion: ticks when it is shown a frame."""

    def answer(self, frame: Frame) -> Answer:
        """Tick."""
        ...

    def close(self) -> None:
        """Finish its log."""
        ...


class LocalFrames:
    """The simulator's end of the frame channel of one vehicle, without a channel."""

    def __init__(self) -> None:
        self._mind: Mind | None = None
        self._answers: deque[Answer] = deque()
        self._said = Path()
        self.failed = False

    def board(self, config: Path, endpoint: MemoryEndpoint) -> None:
        """Let a companion of this configuration hear `endpoint`'s peer and see the frames."""
        self._said = config.with_name("stderr.log")
        self._mind = companion_class("in_process")(config, endpoint)

    @property
    def connected(self) -> bool:
        """Whether a companion is on board."""
        return self._mind is not None

    def send(self, frame: Frame) -> bool:
        """Let the companion tick on a frame; times are rounded as they are on the wire.

        One that raises is gone, as its process would be: its vehicle flies on without it.
        """
        if self._mind is None:
            return False
        due = None if frame.due is None else _wired(frame.due)
        shown = Frame(_wired(frame.time), frame.arrays, frame.packets, due)
        try:
            self._answers.append(self._mind.answer(shown))
        except Exception:
            self._said.write_text(traceback.format_exc(), encoding="utf-8")
            self.failed = True
            self.close()
        return not self.failed

    def answer(self, timeout: float) -> Answer | None:
        """The next answer; there is nothing to wait for."""
        return self._answers.popleft() if self._answers else None

    def close(self) -> None:
        """End the companion."""
        if self._mind is not None:
            self._mind.close()
        self._mind = None

    hang_up = close


def _wired(time: float) -> float:
    return round(time * 1e6) / 1e6


class AtOnce(Executor):
    """Does what it is given before it returns: one thread, one order."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """The finished work; what went wrong is raised here and now."""
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future
