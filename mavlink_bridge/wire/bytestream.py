"""TCP and serial endpoints: bytes in any chunks, over a line that may be lost and come back.

Neither blocks, and neither raises once it is open. It retries a lost line every half second and
names it in `problem` until it is back. Bytes that a line does not accept are dropped after a
moment: an old setpoint is worse than none.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import termios
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterator

import serial

_RETRY = 0.5  # s between attempts to reconnect
_CHUNK = 65536
_PENDING_MAX = 8192  # bytes that wait for a slow line; more are refused
_STALE = 0.2  # s that a message waits for the line: two ticks of a companion
BAUD_RATES = tuple(b for b in serial.Serial.BAUDRATES if b >= 9600)


class ByteStream(ABC):
    """Reconnection and the send queue that TCP and serial lines share.

    problem: why the line is down, empty while it is up. reconnects: number of reconnections.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.problem = ""
        self.reconnects = 0
        self._pending: deque[tuple[float, bytes]] = deque()  # (time, message)
        self._cut = False  # the first message is partly written
        self._stuck_since: float | None = None  # the line has accepted nothing since then
        self._retry_at = -1.0
        self._was_up = False
        # select() needs an open file even while the line is down.
        self._idle, self._idle_other = os.pipe()

    @property
    @abstractmethod
    def up(self) -> bool:
        """Whether the line is open."""

    @abstractmethod
    def _open(self) -> bool:
        """Try to open without blocking; return whether the line is open. Raises OSError."""

    @abstractmethod
    def _read(self) -> bytes:
        """Return the bytes that have arrived. Raises OSError where the line is lost."""

    @abstractmethod
    def _write(self, data: bytes) -> int:
        """Write as much as fits, return its length. Raises OSError where the line is lost."""

    @abstractmethod
    def _take_back(self) -> bool:
        """Discard bytes written but not yet sent; False where the line cannot discard them."""

    @abstractmethod
    def _shut(self) -> None:
        """Close the line; do nothing where it is closed."""

    @abstractmethod
    def _file(self) -> int:
        """Return the file descriptor of the open line."""

    def open(self) -> bool:
        """Open the line where it is down; return whether it is open."""
        return self._ensure()

    def receive(self) -> Iterator[bytes]:
        """Yield the chunks that have arrived; reconnect where the line is down."""
        while self._ensure():
            try:
                self._flush()
                data = self._read()
            except OSError as error:
                self._lose(error)
                return
            if not data:
                return
            yield data

    def send(self, data: bytes) -> bool:
        """Send whole messages, or queue them for a moment where the line accepts none.

        Return False where they are refused: the queue is full, or the line is stuck for too long.
        """
        self._drop_stale()
        waiting = sum(len(chunk) for _, chunk in self._pending)
        if not self._ensure() or waiting + len(data) > _PENDING_MAX:
            return False
        self._pending.append((time.monotonic(), data))
        try:
            self._flush()
        except OSError as error:
            self._lose(error)
            return False
        if self._stuck():  # so no byte of it is written
            self._pending.pop()
            return False
        return True

    def fileno(self) -> int:
        """Return a descriptor for select(): the line's, or an idle pipe's while it is down."""
        return self._file() if self.up else self._idle

    def close(self) -> None:
        """Close the line and the idle pipe."""
        self._shut()
        for file in (self._idle, self._idle_other):
            os.close(file)

    def _ensure(self) -> bool:
        if self.up:
            return True
        now = time.monotonic()
        if now < self._retry_at:
            return False
        try:
            if not self._open():
                return False
        except OSError as error:
            self._lose(error)
            return False
        self.reconnects += self._was_up
        self._was_up, self.problem = True, ""
        return True

    def _stuck(self) -> bool:
        """Return whether the line has accepted nothing for longer than a message may wait."""
        return self._stuck_since is not None and time.monotonic() - self._stuck_since > _STALE

    def _drop_stale(self) -> None:
        """Drop old messages, but never the rest of one that is partly written."""
        first = int(self._cut)
        oldest = time.monotonic() - _STALE
        while len(self._pending) > first and self._pending[first][0] < oldest:
            del self._pending[first]

    def _flush(self) -> None:
        """Write the queued messages that are not too old."""
        self._drop_stale()
        while self._pending:
            at, data = self._pending[0]
            written = self._write(data)
            if not written:
                if self._stuck_since is None:
                    self._stuck_since = time.monotonic()
                return
            moves_again, self._stuck_since = self._stuck(), None
            if moves_again and self._take_back() and not self._cut:
                continue  # the line discarded this message with the old ones
            self._cut = written < len(data)
            if self._cut:
                self._pending[0] = at, data[written:]
            else:
                self._pending.popleft()

    def _lose(self, error: OSError) -> None:
        self._shut()
        self._pending.clear()
        self._cut, self._stuck_since = False, None
        self._retry_at = time.monotonic() + _RETRY
        self.problem = f"{self.name}: {error.strerror or error}"


class TcpEndpoint(ByteStream):
    """A TCP connection to a listener."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__(f"TCP {host}:{port}")
        self._address = (host, port)
        self._socket: socket.socket | None = None
        self._connected = False

    @property
    def up(self) -> bool:
        """Whether the connection is established."""
        return self._connected

    def _open(self) -> bool:
        if self._socket is None:
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
            self._socket.setblocking(False)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        result = self._socket.connect_ex(self._address)
        if result in (errno.EINPROGRESS, errno.EALREADY):
            return False
        if result not in (0, errno.EISCONN):
            raise OSError(result, os.strerror(result))
        self._connected = True
        return True

    def _read(self) -> bytes:
        assert self._socket is not None
        try:
            data = self._socket.recv(_CHUNK)
        except BlockingIOError:
            return b""
        if not data:
            raise ConnectionResetError(errno.ECONNRESET, "the other end closed the connection")
        return data

    def _write(self, data: bytes) -> int:
        assert self._socket is not None
        try:
            return self._socket.send(data)
        except BlockingIOError:
            return 0

    def _take_back(self) -> bool:
        return False

    def _shut(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket, self._connected = None, False

    def _file(self) -> int:
        assert self._socket is not None
        return self._socket.fileno()


class SerialEndpoint(ByteStream):
    """A serial line, eight data bits, no parity, no flow control."""

    def __init__(self, device: str, baud: int) -> None:
        super().__init__(f"serial {device}")
        self._device, self._baud = device, baud
        self._port: serial.Serial | None = None

    @property
    def up(self) -> bool:
        """Whether the device is open."""
        return self._port is not None

    def _open(self) -> bool:
        self._port = serial.Serial(
            self._device, self._baud, timeout=0, write_timeout=0, exclusive=True
        )
        return True

    def _read(self) -> bytes:
        assert self._port is not None
        return bytes(self._port.read(_CHUNK))

    def _write(self, data: bytes) -> int:
        assert self._port is not None
        try:
            return os.write(self._port.fileno(), data)  # pyserial's write would retry for ever
        except BlockingIOError:
            return 0

    def _take_back(self) -> bool:
        assert self._port is not None
        with contextlib.suppress(termios.error):  # a lost line: the next read raises
            termios.tcflush(self._port.fileno(), termios.TCOFLUSH)
        return True

    def _shut(self) -> None:
        if self._port is not None:
            self._port.close()
        self._port = None

    def _file(self) -> int:
        assert self._port is not None
        return int(self._port.fileno())
