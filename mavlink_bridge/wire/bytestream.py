"""TCP and serial endpoints: bytes in any chunks, and a line that may go and come back.

Neither blocks and neither raises once open: a lost line is retried every half second, counted,
and named in `problem` until it is back. What a line does not take waits for a moment only: an old
setpoint is worse than none.
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
_PENDING_MAX = 8192  # bytes that wait for a slow line; what comes on top is refused
_STALE = 0.2  # s that anything waits for a line: two ticks of a companion
BAUD_RATES = tuple(b for b in serial.Serial.BAUDRATES if b >= 9600)


class ByteStream(ABC):
    """What TCP and serial have in common: reconnecting, and bytes that wait to go out.

    problem: why the line is down, empty while it is up. reconnects: times it came back.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.problem = ""
        self.reconnects = 0
        self._pending: deque[tuple[float, bytes]] = deque()  # what was sent, and when
        self._cut = False  # the first of them has gone out in part
        self._stuck_since: float | None = None  # the line has taken nothing from then on
        self._retry_at = -1.0
        self._was_up = False
        # select() wants a file that lives even while the line is down.
        self._idle, self._idle_other = os.pipe()

    @property
    @abstractmethod
    def up(self) -> bool:
        """Whether the line is open."""

    @abstractmethod
    def _open(self) -> bool:
        """Try to open without blocking; True where it is open now. Raises OSError."""

    @abstractmethod
    def _read(self) -> bytes:
        """What waits; empty where nothing does. Raises OSError where the line is dead."""

    @abstractmethod
    def _write(self, data: bytes) -> int:
        """Write what fits now, return how much. Raises OSError where the line is dead."""

    @abstractmethod
    def _take_back(self) -> bool:
        """Discard what was written and has not left yet; False: what is written will arrive."""

    @abstractmethod
    def _shut(self) -> None:
        """Close the line; no error where it is closed."""

    @abstractmethod
    def _file(self) -> int:
        """The open line's file number."""

    def open(self) -> bool:
        """Whether the line is open, after an attempt where it was not."""
        return self._ensure()

    def receive(self) -> Iterator[bytes]:
        """Every chunk that waits; reconnects where the line is down."""
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
        """Send whole messages, or keep them for a moment where the line does not take them now.

        False: refused, because too much waits, or the line has been stuck for too long.
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
        if self._stuck():  # so nothing of it has gone out
            self._pending.pop()
            return False
        return True

    def fileno(self) -> int:
        """For select(): the line, or a file that never speaks while it is down."""
        return self._file() if self.up else self._idle

    def close(self) -> None:
        """Close for good."""
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
        """Whether the line has taken nothing for longer than anything may wait."""
        return self._stuck_since is not None and time.monotonic() - self._stuck_since > _STALE

    def _drop_stale(self) -> None:
        """All but the rest of what is cut: without it the next message would be taken for it."""
        first = int(self._cut)
        oldest = time.monotonic() - _STALE
        while len(self._pending) > first and self._pending[first][0] < oldest:
            del self._pending[first]

    def _flush(self) -> None:
        """Write what waits and is not too old."""
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
                continue  # this one went with the old ones
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
        """Whether it is connected."""
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
            return os.write(self._port.fileno(), data)  # pyserial's own would try for ever
        except BlockingIOError:
            return 0

    def _take_back(self) -> bool:
        assert self._port is not None
        with contextlib.suppress(termios.error):  # of a line that has died: the next read tells
            termios.tcflush(self._port.fileno(), termios.TCOFLUSH)
        return True

    def _shut(self) -> None:
        if self._port is not None:
            self._port.close()
        self._port = None

    def _file(self) -> int:
        assert self._port is not None
        return int(self._port.fileno())
