"""Where camera frames come from: `KIND:ADDRESS`, the simulator or anything OpenCV opens.

A source is a file descriptor for select() that gives frames with the time they were taken at.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Protocol

from mavlink_bridge.video import Answer, Frame, FrameClient

if TYPE_CHECKING:
    from companion.config import CameraConfig

SOURCE_FORMS = (
    "sim:HOST:PORT, device:N, device:/dev/NAME, rtsp://ADDRESS, gst:PIPELINE or file:PATH"
)


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
    from companion.videosource import VideoSource

    return VideoSource(kind, address, (camera.width, camera.height), camera.latency)


def check_source(source: str) -> str:
    """The source itself where it is well formed.

    Raises:
        ValueError: naming the valid forms.
    """
    if not any(re.fullmatch(form, source) for form in _FORMS):
        raise ValueError(f"must be {SOURCE_FORMS}")
    kind, _, address = source.partition(":")
    if kind == "sim" and not 0 < int(address.rpartition(":")[2]) < 65536:
        raise ValueError(f"must be {SOURCE_FORMS}; a port is 1 to 65535")
    return source


_FORMS = (r"sim:[^:]+:[0-9]{1,5}", r"device:([0-9]+|/.+)", r"rtsp://.+", r"gst:.+", r"file:.+")
