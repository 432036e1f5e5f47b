"""Cameras that `cv2.VideoCapture` opens, as a frame source: device, RTSP, GStreamer, file.

A thread takes each picture as it comes and keeps the newest; a pipe tells select() about it. A
camera that breaks off is opened again each second: until then there are no pictures, which `eye`
notices.
"""

from __future__ import annotations

import os
import select
import threading
import time
from functools import partial

import cv2

from mavlink_bridge.wire.video import Answer, Frame, VideoError

_OPEN_TIMEOUT, _READ_TIMEOUT = 5000, 2000  # ms, of network streams
_STAMP_MAX = 0.5  # s; a driver's time stamp older than this is of another clock
_AGAIN = 1.0  # s between attempts to open a camera that broke off
_DEFAULT_FPS = 10.0  # of a file that does not say


class VideoSource:
    """One camera; frames are stamped with CLOCK_MONOTONIC (`Frame.local`).

    Raises:
        VideoError: it cannot be opened, with what to look at.
    """

    def __init__(self, kind: str, address: str, size: tuple[int, int], latency: float) -> None:
        """kind: device, rtsp, gst or file. size: width and height asked of a device [px].
        latency: s from exposure to the driver's hands, where the driver does not say.
        """  # noqa: D205
        self._name, self._kind, self._latency = f"camera {kind}:{address}", kind, latency
        self._open = partial(_open, kind, address, size)
        self._capture = self._open()
        if not self._capture.isOpened():
            raise VideoError(f"{self._name} cannot be opened; {_HINTS[kind]}")
        self._period = 0.0
        if kind == "file":
            self._period = 1.0 / (self._capture.get(cv2.CAP_PROP_FPS) or _DEFAULT_FPS)
        self._lock = threading.Lock()
        self._newest: Frame | None = None
        self._over = threading.Event()
        self._read_end, self._write_end = os.pipe()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    def fileno(self) -> int:
        """For select(): readable when a frame waits, or the film is over."""
        return self._read_end

    def waits(self, timeout: float = 0.0) -> bool:
        """True where a frame waits within `timeout` [s]."""
        return bool(select.select([self._read_end], [], [], timeout)[0])

    def receive(self) -> Frame:
        """The newest frame; blocks. Raises VideoError once a file is at its end."""
        os.read(self._read_end, 1)
        with self._lock:
            frame, self._newest = self._newest, None
        if frame is None:
            raise VideoError(f"{self._name} gives no more pictures")
        return frame

    def answer(self, answer: Answer) -> None:
        """Cameras do not listen."""

    def close(self) -> None:
        """Let go of the camera."""
        self._over.set()
        self._thread.join(_READ_TIMEOUT / 1e3 + 1.0)
        if not self._thread.is_alive():  # else it still hangs in the driver
            self._capture.release()
            os.close(self._read_end)
            os.close(self._write_end)

    def _run(self) -> None:
        """Take pictures until there are no more."""
        self._film()
        while self._kind != "file" and not self._over.is_set():
            self._capture.release()
            if self._over.wait(_AGAIN):
                return
            self._capture = self._open()
            self._film()
        self._put(None)

    def _film(self) -> None:
        """Take pictures until the camera gives none."""
        due = time.monotonic()
        while not self._over.is_set() and self._capture.grab():
            taken = self._taken(time.monotonic())
            fine, image = self._capture.retrieve()
            if not fine:
                return
            if self._period:  # a file is shown at the rate it was taken at
                due += self._period
                self._over.wait(max(due - time.monotonic(), 0.0))
                taken = time.monotonic()
            self._put(Frame(taken, {"image": image}, local=True))

    def _taken(self, now: float) -> float:
        """When the picture was taken: as the driver of a device says, else some time ago."""
        if self._kind == "device":
            stamp = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
            if 0.0 <= now - stamp < _STAMP_MAX:
                return stamp
        return now - self._latency

    def _put(self, frame: Frame | None) -> None:
        """Keep the newest; None: there is no more."""
        with self._lock:
            told = self._newest is not None
            self._newest = frame if frame is not None else self._newest
        if not told or frame is None:
            os.write(self._write_end, b"f")


_HINTS = {
    "device": "is it plugged in, and used by nobody else?",
    "rtsp": "does the address answer?",
    "gst": "does the pipeline end in appsink, and is this OpenCV built with GStreamer?",
    "file": "is it there, and a video?",
}


def _open(kind: str, address: str, size: tuple[int, int]) -> cv2.VideoCapture:
    if kind == "device":
        capture = cv2.VideoCapture(int(address) if address.isdigit() else address, cv2.CAP_V4L2)
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        return capture
    if kind == "rtsp":
        limits = [
            cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
            _OPEN_TIMEOUT,
            cv2.CAP_PROP_READ_TIMEOUT_MSEC,
            _READ_TIMEOUT,
        ]
        return cv2.VideoCapture(f"rtsp:{address}", cv2.CAP_FFMPEG, limits)
    return cv2.VideoCapture(address, cv2.CAP_GSTREAMER if kind == "gst" else cv2.CAP_ANY)
