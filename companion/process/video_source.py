"""Cameras that `cv2.VideoCapture` opens, as a frame source: device, RTSP, GStreamer, file.

A thread reads each picture as it comes and keeps the newest; a pipe makes select() notice it. A
camera that breaks off is opened again each second. Until then no pictures come, which the camera
health of perception reports.
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
_STAMP_MAX = 0.5  # s; an older time stamp of a driver is of another clock
_REOPEN_PERIOD = 1.0  # s between attempts to open a camera that broke off
_DEFAULT_FPS = 10.0  # of a file that does not tell its rate


class VideoSource:
    """One camera; frames are stamped with CLOCK_MONOTONIC (`Frame.local`).

    Raises:
        VideoError: the camera cannot be opened; the message says what to look at.
    """

    def __init__(self, kind: str, address: str, size: tuple[int, int], latency: float) -> None:
        """Open a camera.

        kind: device, rtsp, gst or file. size: width and height to ask of a device [px]. latency: s
        from exposure to arrival at the driver, for drivers that do not tell.
        """
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
        """Return the file descriptor for select(); readable when a frame waits, or at the end."""
        return self._read_end

    def waits(self, timeout: float = 0.0) -> bool:
        """Return whether a frame waits within `timeout` [s]."""
        return bool(select.select([self._read_end], [], [], timeout)[0])

    def receive(self) -> Frame:
        """Return the newest frame; blocks. Raises VideoError at the end of a file."""
        os.read(self._read_end, 1)
        with self._lock:
            frame, self._newest = self._newest, None
        if frame is None:
            raise VideoError(f"{self._name} gives no more pictures")
        return frame

    def answer(self, answer: Answer) -> None:
        """Do nothing: cameras do not listen."""

    def close(self) -> None:
        """Release the camera."""
        self._over.set()
        self._thread.join(_READ_TIMEOUT / 1e3 + 1.0)
        if not self._thread.is_alive():  # else the thread hangs in the driver
            self._capture.release()
            os.close(self._read_end)
            os.close(self._write_end)

    def _run(self) -> None:
        """Read pictures until there are no more."""
        self._film()
        while self._kind != "file" and not self._over.is_set():
            self._capture.release()
            if self._over.wait(_REOPEN_PERIOD):
                return
            self._capture = self._open()
            self._film()
        self._put(None)

    def _film(self) -> None:
        """Read pictures until the camera gives none."""
        due = time.monotonic()
        while not self._over.is_set() and self._capture.grab():
            taken = self._taken(time.monotonic())
            fine, image = self._capture.retrieve()
            if not fine:
                return
            if self._period:  # a file plays at its own rate
                due += self._period
                self._over.wait(max(due - time.monotonic(), 0.0))
                taken = time.monotonic()
            self._put(Frame(taken, {"image": image}, local=True))

    def _taken(self, now: float) -> float:
        """Return the time of capture: the driver's, else `latency` before `now` [s]."""
        if self._kind == "device":
            stamp = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
            if 0.0 <= now - stamp < _STAMP_MAX:
                return stamp
        return now - self._latency

    def _put(self, frame: Frame | None) -> None:
        """Keep the newest frame; None: there will be no more."""
        with self._lock:
            noticed = self._newest is not None
            self._newest = frame if frame is not None else self._newest
        if not noticed or frame is None:
            os.write(self._write_end, b"f")


_HINTS = {
    "device": "is it plugged in, and free of other programs?",
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
