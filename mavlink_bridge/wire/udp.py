"""A UDP port for MAVLink, with a queue for the vehicle that strangers cannot fill."""

from __future__ import annotations

import contextlib
import socket
from collections import deque
from collections.abc import Iterator
from itertools import islice

from mavlink_bridge.wire.arrival import NOTES_SIZE, ArrivalClock, stamp_arrivals

Address = tuple[str, int]
_RECEIVE_BUFFER = 4 << 20  # a second of telemetry, so that a slow tick loses nothing
_STRANGERS_BUFFER = 64 << 10  # bytes that wait from all other addresses
_STRANGERS = 256  # most datagrams of other addresses that are read at once
_BACKLOG = 4096  # most datagrams that are taken over from the common queue
_REFUSED = 16  # most errors in one reading: as many packets found no listener


class EndpointError(ValueError):
    """An endpoint is malformed or cannot be opened; the message names it."""


class UdpEndpoint:
    """One UDP port with one peer: a given one, the pinned one, or the last of `answer_sender`.

    local, remote: (host, port); local port 0 is any free port. stamps: whether the kernel tells
    when a datagram arrived. arrived: s, CLOCK_MONOTONIC, when the latest datagram did; without
    stamps, when it was read.
    """

    def __init__(self, local: Address | None = None, remote: Address | None = None) -> None:
        self.remote = remote
        self.sender: Address | None = None  # of the latest datagram
        self._vehicle: socket.socket | None = None  # hears the pinned address alone
        self.arrived = 0.0
        self._clock = ArrivalClock()
        self._backlog: deque[tuple[bytes, Address, float]] = deque()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        try:
            self._socket.bind(local or ("", 0))
        except OSError as error:
            self._socket.close()
            host, port = local or ("", 0)
            raise EndpointError(f"UDP {host}:{port} cannot be bound: {error.strerror}") from error
        self._fixed = remote is not None
        self.stamps = stamp_arrivals(self._socket)

    @property
    def port(self) -> int:
        """The local port."""
        return int(self._socket.getsockname()[1])

    def receive(self, strangers: bool = True) -> Iterator[bytes]:
        """Yield the datagrams that have arrived; once pinned, those of strangers first and few.

        strangers: look at the datagrams of other addresses than the pinned one, too.
        """
        while self._backlog:
            data, self.sender, self.arrived = self._backlog.popleft()
            yield data
        if self._vehicle is None:
            yield from self._read(self._socket)
        else:
            if strangers:
                yield from islice(self._read(self._socket), _STRANGERS)
            yield from self._read(self._vehicle)

    def _read(self, port: socket.socket) -> Iterator[bytes]:
        refused, clock = 0, self._clock
        clock.look()
        while refused < _REFUSED:
            try:
                data, notes, _, self.sender = port.recvmsg(65535, NOTES_SIZE)
            except ConnectionError:  # an earlier packet found no listener: no word on later ones
                refused += 1
            except BlockingIOError:
                return
            else:
                self.arrived = clock.arrived(notes)
                yield data

    def pin(self, address: Address) -> None:
        """Make an address the peer, and give it a queue of its own in the kernel.

        Whatever others send can then neither fill that queue nor delay it.
        """
        if not self._fixed:
            self.remote = address
        if self._vehicle is not None:
            self._vehicle.close()
            self._vehicle = None
        local = self._socket.getsockname()
        private = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        private.setblocking(False)
        private.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        stamp_arrivals(private)
        try:
            for end in (self._socket, private):
                end.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            private.bind(local)
            private.connect(address)
        except OSError:  # one queue for all is enough to fly
            private.close()
        else:
            self._vehicle = private
            self._keep_what_came()
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _STRANGERS_BUFFER)
        finally:
            # No other process may bind the port meanwhile.
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 0)
            with contextlib.suppress(OSError):
                private.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 0)

    def _keep_what_came(self) -> None:
        """Keep what came before the address had its own queue, in its order."""
        for data in islice(self._read(self._socket), _BACKLOG):
            assert self.sender is not None
            self._backlog.append((data, self.sender, self.arrived))

    def answer_sender(self) -> None:
        """Make the sender of the last datagram the peer, unless a peer was given.

        Call it for accepted messages only: a stray packet must not redirect the stream.
        """
        if not self._fixed:
            self.remote = self.sender

    def send(self, data: bytes) -> bool:
        """Send to the peer; return False where no peer is known or it does not listen."""
        if self.remote is None:
            return False
        try:
            self._socket.sendto(data, self.remote)
        except OSError:
            return False
        return True

    def fileno(self) -> int:
        """Return the descriptor for select(); once pinned, strangers wake nobody."""
        return (self._vehicle or self._socket).fileno()

    def close(self) -> None:
        """Close the port."""
        self._socket.close()
        if self._vehicle is not None:
            self._vehicle.close()
