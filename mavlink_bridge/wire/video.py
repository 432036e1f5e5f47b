"""Timestamped raw frames between the simulator and a companion, over one TCP stream.

Each record is a JSON header and named raw arrays. The simulator sends frames (image, optional
depth, optional perfect detections) with the capture time in the vehicle's clock and the number
of MAVLink packets sent before. The companion answers each frame with the number of packets that
it sent before, so that a tick without a setpoint answers too.
"""

from __future__ import annotations

import json
import math
import select
import socket
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

_HEAD = struct.Struct("<4sI")
_MAGIC = b"SWF1"
_MAX_HEADER = 1 << 16
_MAX_PAYLOAD = 1 << 26
_MAX_PATIENCE = 3600.0  # s
_DTYPES = {"uint8", "uint16", "float32", "float64"}
# dtype and shape of a frame's arrays; -1: any length.
_FORMS = {
    "image": ("uint8", (-1, -1, 3)),
    "depth": ("float32", (-1, -1)),
    "ranges": ("float32", (-1, -1)),
    "neighbours": ("float64", (-1, 6)),
    "trunks": ("float64", (-1, 6)),
}
PATIENCE = 0.2
"""Wall seconds that a companion waits for the rest of a frame, or to send its answer.

A simulator in lockstep sets a longer time: a busy machine must not change the flight.
"""
_BAD_HEADER = (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError)


class VideoError(ConnectionError):
    """The other end is gone or sends something other than records."""


@dataclass(frozen=True)
class Frame:
    """Frame of one camera at `time` [s, vehicle's clock].

    arrays: `image` (H,W,3) uint8 BGR; `depth` (h,w) float32 m along the ray; `neighbours`
    (m,6), `trunks` (k,6) and `ranges` (h,w) float32 m to walls (camera frame) where the simulator
    replaces the detector.
    packets: MAVLink packets that the vehicle sent to the companion before this frame. due: time of
    sending [s], where it differs from the capture. local: `time` is CLOCK_MONOTONIC. lag: s, of the
    picture behind `time`, where a log tells it; None: it has to be measured.
    """

    time: float
    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)
    packets: int = 0
    due: float | None = None
    local: bool = False
    lag: float | None = None


@dataclass(frozen=True)
class Answer:
    """A companion's answer to the frame of `time`; packets: MAVLink packets sent before.

    done: the companion's mission is over (it has landed).
    """

    time: float
    packets: int
    done: bool = False


class RecordStream:
    """Records of a JSON header and named arrays over a connected stream socket.

    The socket's timeout limits the silence within a record.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def fileno(self) -> int:
        """Return the descriptor for select()."""
        return self._socket.fileno()

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    def send(self, header: dict[str, Any], arrays: dict[str, NDArray[Any]] | None = None) -> None:
        """Send one record.

        Raises:
            VideoError: the other end is gone, or does not read.
        """
        arrays = arrays or {}
        shapes = [(k, a.dtype.name, a.shape) for k, a in arrays.items()]
        text = json.dumps({**header, "arrays": shapes}).encode()
        try:
            self._socket.sendall(_HEAD.pack(_MAGIC, len(text)) + text)
            for a in arrays.values():
                self._socket.sendall(np.ascontiguousarray(a).data)
        except OSError as error:
            raise VideoError(f"frame channel: {error}") from error

    def receive(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Receive one record; block until it begins, however long that takes.

        Raises:
            VideoError: end of the stream, not a record, or a record cut short.
        """
        magic, length = _HEAD.unpack(self._exactly(_HEAD.size, begun=False))
        if magic != _MAGIC or length > _MAX_HEADER:
            raise VideoError("frame channel: not a record")
        try:
            header = json.loads(bytes(self._exactly(length)))
            shapes = [(str(k), str(d), tuple(map(int, s))) for k, d, s in header.pop("arrays")]
            if "patience" in header:
                self._socket.settimeout(min(float(header.pop("patience")), _MAX_PATIENCE))
        except _BAD_HEADER as error:
            raise VideoError(f"frame channel: bad header: {error}") from error
        arrays: dict[str, NDArray[Any]] = {}
        left = _MAX_PAYLOAD
        for name, dtype, shape in shapes:
            if dtype not in _DTYPES or min(shape, default=1) < 0 or len(shape) > 3:
                raise VideoError(f"frame channel: array {name!r} of {dtype} {shape}")
            size = math.prod(shape) * np.dtype(dtype).itemsize
            left -= size
            if left < 0 or max(shape, default=0) > _MAX_PAYLOAD:
                raise VideoError(f"frame channel: array {name!r} of {dtype} {shape} is too large")
            arrays[name] = np.frombuffer(self._exactly(size), dtype=dtype).reshape(shape)
        return header, arrays

    def waits(self, timeout: float = 0.0) -> bool:
        """Return whether a record (or the end of the stream) arrives within `timeout` [s]."""
        return bool(select.select([self._socket], [], [], timeout)[0])

    def _exactly(self, size: int, begun: bool = True) -> bytearray:
        data = bytearray(size)
        view = memoryview(data)
        while view:
            try:
                got = self._socket.recv_into(view)
            except OSError as error:
                if isinstance(error, TimeoutError) and not begun:
                    continue
                raise VideoError(f"frame channel: {error}") from error
            if not got:
                raise VideoError("frame channel: the other end closed it")
            view, begun = view[got:], True
        return data


def _seconds(microseconds: float) -> float:
    if not math.isfinite(microseconds):
        raise ValueError(f"a time of {microseconds} µs")
    return microseconds / 1e6


def _check_form(name: str, array: NDArray[Any]) -> None:
    """Raise VideoError where an array has not the form of its name; other names are free."""
    dtype, shape = _FORMS.get(name, (array.dtype.name, array.shape))
    fits = len(shape) == array.ndim and all(
        want in (-1, have) for want, have in zip(shape, array.shape, strict=True)
    )
    if not fits or array.dtype.name != dtype:
        raise VideoError(f"frame channel: {name} of {array.dtype} {array.shape}")


class FrameClient:
    """The companion's end: receives frames, sends answers."""

    def __init__(self, host: str, port: int, timeout: float = 10.0) -> None:
        try:
            connection = socket.create_connection((host, port), timeout)
        except OSError as error:
            raise VideoError(f"no frame source at {host}:{port}: {error}") from error
        connection.settimeout(PATIENCE)
        self._stream = RecordStream(connection)

    def fileno(self) -> int:
        """Return the descriptor for select()."""
        return self._stream.fileno()

    def receive(self) -> Frame:
        """Receive the next frame; block until it begins.

        Raises:
            VideoError: end of the stream, not a frame, or a frame cut short.
        """
        header, arrays = self._stream.receive()
        for name, array in arrays.items():
            _check_form(name, array)
        try:
            due = header.get("due_us")
            sent = None if due is None else _seconds(due)
            return Frame(_seconds(header["time_us"]), arrays, int(header["packets"]), sent)
        except _BAD_HEADER as error:
            raise VideoError(f"frame channel: bad header: {error}") from error

    def waits(self, timeout: float = 0.0) -> bool:
        """Return whether a frame arrives within `timeout` [s]."""
        return self._stream.waits(timeout)

    def answer(self, answer: Answer) -> None:
        """Send the answer of a completed tick."""
        self._stream.send(
            {"time_us": round(answer.time * 1e6), "packets": answer.packets, "done": answer.done}
        )

    def close(self) -> None:
        """Close the connection."""
        self._stream.close()


class FrameServer:
    """The simulator's end for one vehicle: listens, and accepts one companion at a time.

    timeout: wall seconds after which it disconnects a companion that does not read a frame or does
    not complete an answer; None: never. lockstep: the companion uses the same timeout.
    """

    def __init__(
        self, host: str, port: int, timeout: float | None = None, lockstep: bool = False
    ) -> None:
        self._timeout = timeout
        self._patience = {"patience": timeout} if lockstep else {}
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listener.bind((host, port))
        except OSError as error:
            self._listener.close()
            raise VideoError(f"TCP {host}:{port} cannot be bound: {error.strerror}") from error
        self._listener.listen(1)
        self._stream: RecordStream | None = None

    @property
    def port(self) -> int:
        """The local port."""
        return int(self._listener.getsockname()[1])

    @property
    def connected(self) -> bool:
        """Whether a companion is connected; accepts a waiting one."""
        if self._stream is None and select.select([self._listener], [], [], 0.0)[0]:
            connection = self._listener.accept()[0]
            connection.settimeout(self._timeout)
            self._stream = RecordStream(connection)
        return self._stream is not None

    def send(self, frame: Frame) -> bool:
        """Send a frame; return False where no companion is connected any longer."""
        if not self.connected or self._stream is None:
            return False
        try:
            due = {} if frame.due is None else {"due_us": round(frame.due * 1e6)}
            header = {"time_us": round(frame.time * 1e6), "packets": frame.packets}
            self._stream.send({**header, **due, **self._patience}, frame.arrays)
        except VideoError:
            self.hang_up()
            return False
        return True

    def answer(self, timeout: float) -> Answer | None:
        """Return the next answer within `timeout` [s]; None without one or without a companion."""
        if self._stream is None:
            return None
        try:
            if not self._stream.waits(timeout):
                return None
            header, _ = self._stream.receive()
            return Answer(_seconds(header["time_us"]), int(header["packets"]), bool(header["done"]))
        except (VideoError, *_BAD_HEADER):
            self.hang_up()
            return None

    def close(self) -> None:
        """Stop listening and disconnect."""
        self.hang_up()
        self._listener.close()

    def hang_up(self) -> None:
        """Disconnect the companion, if any; another companion may connect."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None
