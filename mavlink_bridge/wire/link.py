"""A UDP, TCP or serial endpoint around the codec.

Endpoints are named as in ground stations: `udpin:HOST:PORT` binds and answers the last accepted
sender, `udpout:HOST:PORT` sends first, `tcp:HOST:PORT` connects, `serial:DEVICE:BAUD` is a line.
"""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Protocol

from mavlink_bridge.wire.bytestream import BAUD_RATES, ByteStream, SerialEndpoint, TcpEndpoint
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.ids import ComponentId
from mavlink_bridge.wire.messages import Heartbeat, Message, Received, Source

_SENDER_MEMORY = 3.0  # s; a vehicle that restarts may have another port
_SENDERS = 16  # most addresses of one vehicle that are remembered
_RECEIVE_BUFFER = 4 << 20  # a second of telemetry, so that a slow tick loses nothing
Address = tuple[str, int]
ENDPOINT_FORMS = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, serial:DEVICE:BAUD"


class EndpointError(ValueError):
    """An endpoint is malformed or cannot be opened; the message names it."""


class Endpoint(Protocol):
    """Packets in and out; never blocks."""

    def receive(self) -> Iterator[bytes]:
        """Yield the packets that have arrived."""
        ...

    def send(self, data: bytes) -> bool:
        """Send one packet; return False where there is no receiver."""
        ...

    def fileno(self) -> int:
        """Return the descriptor for select()."""
        ...

    def close(self) -> None:
        """Close the port."""
        ...


class UdpEndpoint:
    """One UDP socket with one peer: a given one, or the last sender of `answer_sender`.

    local, remote: (host, port); local port 0 is any free port.
    """

    def __init__(self, local: Address | None = None, remote: Address | None = None) -> None:
        self.remote = remote
        self.sender: Address | None = None  # of the latest datagram
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
        """Yield the datagrams that have arrived."""
        while True:
            try:
                data, sender = self._socket.recvfrom(65535)
            except (BlockingIOError, ConnectionError):
                return
            self.sender = sender
            yield data

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
        """Return the descriptor for select()."""
        return self._socket.fileno()

    def close(self) -> None:
        """Close the port."""
        self._socket.close()


def open_endpoint(name: str) -> Endpoint:
    """Open an endpoint by its name, as in ENDPOINT_FORMS; a TCP listener may still be down.

    Raises:
        EndpointError: a malformed name, a port that is taken, no such device.
    """
    kind, host, number = parse_endpoint(name)
    if kind == "udpin":
        return UdpEndpoint(local=(host, number))
    if kind == "udpout":
        return UdpEndpoint(remote=(host, number))
    if kind == "tcp":
        return TcpEndpoint(host, number)
    return open_serial(host, number)


def parse_endpoint(name: str) -> tuple[str, str, int]:
    """Return kind, host or device, port or baud rate.

    Raises:
        EndpointError: a malformed name.
    """
    kind, _, address = name.partition(":")
    host, _, number = address.rpartition(":")
    known = kind in ("udpin", "udpout", "tcp", "serial")
    if not known or not host or not number.isdecimal():
        raise EndpointError(f"endpoint {name!r} is none of: {ENDPOINT_FORMS}")
    if kind == "serial":
        _check_baud(host, int(number))
    elif int(number) > 65535 or not _encodes(host):
        raise EndpointError(f"endpoint {name!r} is none of: {ENDPOINT_FORMS}")
    return kind, host, int(number)


def _encodes(host: str) -> bool:
    """Return whether a socket accepts the host name; it refuses `a..b`."""
    try:
        host.encode("idna")
    except UnicodeError:
        return False
    return True


def _check_baud(device: str, baud: int) -> None:
    if baud not in BAUD_RATES:
        valid = ", ".join(str(b) for b in BAUD_RATES)
        raise EndpointError(f"serial {device}: baud rate {baud} is none of {valid}")


def open_serial(device: str, baud: int) -> SerialEndpoint:
    """Open a serial line.

    Raises:
        EndpointError: no such device or baud rate; the message names both.
    """
    _check_baud(device, baud)
    endpoint = SerialEndpoint(device, baud)
    if not endpoint.open():
        endpoint.close()
        raise EndpointError(endpoint.problem)
    return endpoint


class Link:
    """Messages over an endpoint, with packet counts by which lockstep waits for every packet.

    tap: called with each packet for a log: (whether this end sent it, its bytes).
    """

    def __init__(self, endpoint: Endpoint, codec: Codec) -> None:
        self.endpoint = endpoint
        self.codec = codec
        self.packets_in = 0
        self.packets_out = 0
        self.tap: Callable[[bool, bytes], None] | None = None
        self._heard: dict[tuple[Source, type], float] = {}
        self._senders: dict[int, dict[Address, float]] = {}
        whole = not isinstance(endpoint, ByteStream)
        self._decode = codec.decode_datagram if whole else codec.decode

    @property
    def problem(self) -> str:
        """Why the line is down, or that two vehicles have one id; empty where neither holds."""
        if isinstance(self.endpoint, ByteStream):
            return self.endpoint.problem
        recent = time.monotonic() - _SENDER_MEMORY
        for system, senders in self._senders.items():
            places = [f"{host}:{port}" for (host, port), at in senders.items() if at > recent]
            if len(places) > 1:
                two, more = sorted(places)[:2], len(places) - 2
                text = f"two vehicles with system id {system}: {' and '.join(two)}"
                return f"{text}, and {more} more" if more else text
        return ""

    def _hear(self, data: bytes) -> list[Received]:
        """Return the messages of a packet; the sender of an accepted message becomes the peer."""
        received = self._decode(data)
        if isinstance(self.endpoint, UdpEndpoint) and received:
            self.endpoint.answer_sender()
            self._note_sender(self.endpoint.sender, received)
        return received

    def _note_sender(self, sender: Address | None, received: list[Received]) -> None:
        """Remember the address from which each vehicle's heartbeats come."""
        now = time.monotonic()
        for r in received:
            if isinstance(r.message, Heartbeat) and r.source.component == ComponentId.AUTOPILOT1:
                known = self._senders.get(r.source.system, {})
                kept = {place: at for place, at in known.items() if at > now - _SENDER_MEMORY}
                if sender is not None and (sender in kept or len(kept) < _SENDERS):
                    kept[sender] = now
                self._senders[r.source.system] = kept

    def age(self, kind: type, system: int, component: int = ComponentId.AUTOPILOT1) -> float:
        """Return the seconds since that sender's last message of this kind, or infinity."""
        received_at = self._heard.get((Source(system, component), kind), float("-inf"))
        return time.monotonic() - received_at

    def receive(self) -> list[Received]:
        """Return the messages that have arrived, oldest first; never block."""
        out: list[Received] = []
        for data in self.receive_packets():
            out += self._hear(data)
        now = time.monotonic()
        for r in out:
            self._heard[r.source, type(r.message)] = now
        return out

    def receive_packets(self) -> Iterator[bytes]:
        """Yield the packets that have arrived, as they are: for an end that passes them on."""
        for data in self.endpoint.receive():
            self.packets_in += 1
            if self.tap is not None:
                self.tap(False, data)
            yield data

    def send(self, messages: Iterable[Message]) -> None:
        """Send the messages in one packet; together they stay below the usual 1500-byte MTU."""
        data = self.codec.encode(messages)
        self.send_packets([data] if data else [])

    def send_packets(self, packets: Iterable[bytes]) -> None:
        """Send packets as they are."""
        for data in packets:
            if self.endpoint.send(data):
                self.packets_out += 1
                if self.tap is not None:
                    self.tap(True, data)

    def wait(self, timeout: float) -> bool:
        """Block until bytes arrive or `timeout` [s] has passed; return whether bytes arrived."""
        return bool(select.select([self.endpoint.fileno()], [], [], max(timeout, 0.0))[0])

    def close(self) -> None:
        """Close the endpoint."""
        self.endpoint.close()
