"""Where camera frames come from: `KIND:ADDRESS`, the simulator or anything OpenCV opens.

A source is a file descriptor for select() that gives frames with the time they were taken at.
"""

from __future__ import annotations

from typing import Protocol

from companion.perception.config import CameraConfig
from mavlink_bridge.wire.video import Answer, Frame, FrameClient


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


def open_source(camera: CameraConfig) -> FrameSource:
    """Open the source of a camera.

    Raises:
        VideoError: it cannot be reached.
    """
    kind, _, address = camera.source.partition(":")
    if kind == "sim":
        host, _, port = address.rpartition(":")
        return FrameClient(host, int(port))
    from companion.process.video_source import VideoSource

    return VideoSource(kind, address, (camera.width, camera.height), camera.latency)
