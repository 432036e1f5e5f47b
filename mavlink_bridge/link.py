"""An endpoint (UDP now; TCP and serial have the same shape) around the codec.

Endpoints are named as ground stations name them:
`udpin:HOST:PORT` binds and answers whoever speaks, `udpout:HOST:PORT` speaks first.
"""

from __future__ import annotations

import select
import socket
from collections.abc import Iterable, Iterator
from typing import Protocol

from mavlink_bridge.codec import Codec
from mavlink_bridge.messages import Message, Received

_RECEIVE_BUFFER = 4 << 20  # a second of telemetry, so that a slow tick loses nothing
ENDPOINT_FORMS = "udpin:HOST:PORT, udpout:HOST:PORT"


class EndpointError(ValueError):
    """An endpoint that cannot be understood or opened; the message names it."""


class Endpoint(Protocol):
    """Bytes in and out; never blocks."""

    def receive(self) -> Iterator[bytes]:
        """Every packet that waits."""
        ...

    def send(self, data: bytes) -> bool:
        """Send one packet; False where there is nobody to send to."""
        ...

    def fileno(self) -> int:
        """For select()."""
        ...

    def close(self) -> None:
        """Release the port."""
        ...


class UdpEndpoint:
    """One UDP socket with one peer: given, or whoever spoke last.

    local, remote: (host, port); local port 0 takes any free one.
    """

    def __init__(
        self, local: tuple[str, int] | None = None, remote: tuple[str, int] | None = None
    ) -> None:
        self.remote = remote
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

    @property
    def port(self) -> int:
        """The local port."""
        return int(self._socket.getsockname()[1])

    def receive(self) -> Iterator[bytes]:
        """Every datagram that waits; learns the peer from it unless it was given."""
        while True:
            try:
                data, sender = self._socket.recvfrom(65535)
            except (BlockingIOError, ConnectionError):
                return
            if not self._fixed:
                self.remote = sender
            yield data

    def send(self, data: bytes) -> bool:
        """Send to the peer; False where none is known or nobody listens."""
        if self.remote is None:
            return False
        try:
            self._socket.sendto(data, self.remote)
        except OSError:
            return False
        return True

    def fileno(self) -> int:
        """For select()."""
        return self._socket.fileno()

    def close(self) -> None:
        """Release the port."""
        self._socket.close()


def open_endpoint(name: str) -> UdpEndpoint:
    """Open `udpin:HOST:PORT` or `udpout:HOST:PORT`.

    Raises:
        EndpointError: not such a name, or the port is taken.
    """
    kind, _, address = name.partition(":")
    host, _, port = address.rpartition(":")
    if kind not in ("udpin", "udpout") or not host or not port.isdigit() or int(port) > 65535:
        raise EndpointError(f"endpoint {name!r} is none of: {ENDPOINT_FORMS}")
    if kind == "udpin":
        return UdpEndpoint(local=(host, int(port)))
    return UdpEndpoint(remote=(host, int(port)))


class Link:
    """Messages over an endpoint. Counts packets both ways, for who must know all arrived."""

    def __init__(self, endpoint: Endpoint, codec: Codec) -> None:
        self.endpoint = endpoint
        self.codec = codec
        self.packets_in = 0
        self.packets_out = 0

    def receive(self) -> list[Received]:
        """All messages that wait, oldest first; never blocks."""
        out: list[Received] = []
        for data in self.endpoint.receive():
            self.packets_in += 1
            out += self.codec.decode_datagram(data)
        return out

    def send(self, messages: Iterable[Message]) -> None:
        """Send the messages in one packet (they stay below the usual 1500-byte MTU)."""
        data = self.codec.encode(messages)
        if data and self.endpoint.send(data):
            self.packets_out += 1

    def wait(self, timeout: float) -> bool:
        """Block until something arrives or `timeout` [s] has passed; True where it arrived."""
        return bool(select.select([self.endpoint.fileno()], [], [], max(timeout, 0.0))[0])

    def close(self) -> None:
        """Release the endpoint."""
        self.endpoint.close()
