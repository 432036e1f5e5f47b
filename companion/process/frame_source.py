"""Sources of camera frames by `KIND:ADDRESS`: the simulator, or anything that OpenCV opens.

A source has a file descriptor for select(), and gives frames with the time of their capture.
"""

from __future__ import annotations

from typing import Protocol

from companion.perception.config import CameraConfig
from mavlink_bridge.wire.video import Answer, Frame, FrameClient


class FrameSource(Protocol):
    """One camera; every method but `close` raises VideoError once the camera is gone."""

    def fileno(self) -> int:
        """Return the file descriptor for select(); readable when a frame waits."""
        ...

    def waits(self, timeout: float = 0.0) -> bool:
        """Return whether a frame waits within `timeout` [s]."""
        ...

    def receive(self) -> Frame:
        """Return the next frame; blocks."""
        ...

    def answer(self, answer: Answer) -> None:
        """Tell that the tick of a frame is done; only a simulator listens."""
        ...

    def close(self) -> None:
        """Release the camera."""
        ...


def open_source(camera: CameraConfig) -> FrameSource:
    """Open the source of a camera.

    Raises:
        VideoError: the camera cannot be reached.
    """
    kind, _, address = camera.source.partition(":")
    if kind == "sim":
        host, _, port = address.rpartition(":")
        return FrameClient(host, int(port))
    from companion.process.video_source import VideoSource

    return VideoSource(kind, address, (camera.width, camera.height), camera.latency)
