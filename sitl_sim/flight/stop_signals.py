"""SIGINT and SIGTERM end a flight between two instants, not in the middle of a tick.

A KeyboardInterrupt inside a companion's solver would count as a failed solve, or be swallowed by
CasADi. So the signal only sets a flag, which the flight reads where it can stop.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Protocol

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stoppable(Protocol):
    """A flight, or a window."""

    def stop(self, number: int) -> None:
        """Stop at the next instant, for the signal of this number."""


@contextmanager
def stop_on_signals(flight: Stoppable) -> Iterator[None]:
    """Let the first SIGINT or SIGTERM stop the flight; a second one raises KeyboardInterrupt.

    Outside the main thread, which alone may handle signals, nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        flight.stop(number)
        for each in _SIGNALS:
            signal.signal(each, signal.default_int_handler)

    before = {number: signal.signal(number, stop) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
