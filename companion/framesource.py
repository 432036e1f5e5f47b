"""Where camera frames come from: `KIND:ADDRESS`, one entry a kind.

A source is a file descriptor for select() that gives frames stamped in the vehicle's clock.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from mavlink_bridge.video import Answer, Frame, FrameClient


class FrameSource(Protocol):
    """One camera; every method but `close` raises VideoError once it is gone."""

    def fileno(self) -> int:
        """For select(): readable when a frame waits."""
        ...

    def waits(self, timeout: float = 0.0) -> bool:
        """True where a frame waits within `timeout` [s]."""
        ...

    def receive(self) -> Frame:
        """The next frame; blocks."""
        ...

    def answer(self, answer: Answer) -> None:
        """The tick of a frame is done; only a simulator listens."""
        ...

    def close(self) -> None:
        """Let go of the camera."""
        ...


def open_source(source: str) -> FrameSource:
    """Open a source that `check_source` let pass.

    Raises:
        VideoError: it cannot be reached.
    """
    kind, _, address = source.partition(":")
    return _KINDS[kind](address)


def check_source(source: str) -> str:
    """The source itself where it is well formed.

    Raises:
        ValueError: naming the valid forms.
    """
    kind, _, address = source.partition(":")
    host, _, port = address.rpartition(":")
    if kind not in _KINDS or not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise ValueError("must be sim:HOST:PORT")
    return source


def _simulator(address: str) -> FrameSource:
    host, _, port = address.rpartition(":")
    return FrameClient(host, int(port))


_KINDS: dict[str, Callable[[str], FrameSource]] = {"sim": _simulator}
