"""A UDP, TCP or serial endpoint around the codec.

Endpoints are named as in ground stations: `udpin:HOST:PORT` binds and answers the last accepted
sender, `udpout:HOST:PORT` sends first, `tcp:HOST:PORT` connects, `serial:DEVICE:BAUD` is a line.
"""

from __future__ import annotations

import heapq
import select
import time
from collections.abc import Callable, Iterable, Iterator
from math import inf
from typing import Protocol

from mavlink_bridge.wire.allowance import (
    ACCEPTED,
    FOREIGN,
    GARBAGE,
    Allowance,
    Claim,
    Newest,
    Packet,
)
from mavlink_bridge.wire.bytestream import BAUD_RATES, ByteStream, SerialEndpoint, TcpEndpoint
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.framing import RawFrame
from mavlink_bridge.wire.ids import ComponentId, MessageId
from mavlink_bridge.wire.messages import Message, Received, Source
from mavlink_bridge.wire.udp import Address, EndpointError, UdpEndpoint

_SENDER_MEMORY = 3.0  # s; a vehicle that restarts may have another port
_SENDERS = 16  # most addresses of one vehicle that are remembered
# s that the vehicle's address has to be silent before another one is taken for it. HEARTBEAT comes
# each second; a signature is proof enough once nothing comes from the old address any more.
_SILENCE, _SIGNED_SILENCE = 1.5, 0.2
ENDPOINT_FORMS = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, serial:DEVICE:BAUD"


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

    vehicle: the autopilot whose address alone gets what is sent over UDP, and alone is believed
    when it speaks for the vehicle; None: the last accepted sender is the peer. tap: called with
    each packet for a log: (whether this end sent it, its bytes). address_changes: how often the
    vehicle had another address than before. spent: whether `receive` has read as much as it may.
    """

    def __init__(self, endpoint: Endpoint, codec: Codec, vehicle: Source | None = None) -> None:
        self.endpoint = endpoint
        self.codec = codec
        self.packets_in = 0
        self.packets_out = 0
        self.tap: Callable[[bool, bytes], None] | None = None
        self.address_changes = 0
        self._vehicle = vehicle
        self._pinned: Address | None = None
        self._pinned_heard = -inf
        self._allowance = Allowance()
        self._heard: dict[tuple[Source, type], float] = {}
        self._senders: dict[int, dict[Address, float]] = {}
        self._whole = not isinstance(endpoint, ByteStream)

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

    @property
    def address(self) -> str:
        """The vehicle's address over UDP, `host:port`; empty where it is not known."""
        return "" if self._pinned is None else f"{self._pinned[0]}:{self._pinned[1]}"

    @property
    def stamps(self) -> bool:
        """Whether what waits to be read is dated by when it arrived, as over UDP on Linux."""
        return isinstance(self.endpoint, UdpEndpoint) and self.endpoint.stamps

    @property
    def spent(self) -> bool:
        """Whether `receive` has read all that it may before it is renewed."""
        return self._allowance.spent

    def _hear(self, data: bytes) -> list[Received]:
        """Return the messages of a packet; the sender of an accepted message becomes the peer."""
        place = self.endpoint.sender if isinstance(self.endpoint, UdpEndpoint) else None
        return self.codec.read(self._frames(data, place))

    def _frames(self, data: bytes, place: Address | None) -> list[RawFrame]:
        """Return the accepted frames of a packet that came from `place`; None: not over UDP."""
        frames = self.codec.frames(data) if self._whole else self.codec.stream_frames(data)
        if place is None or not frames:
            return frames
        if place != self._pinned:  # what has no checksum that holds makes no address known
            frames = [f for f in frames if f.verified]
            if not frames:
                return []
        self._note_sender(place, frames)
        assert isinstance(self.endpoint, UdpEndpoint)
        if self._vehicle is None:
            self.endpoint.answer_sender()
            return frames
        own = [f for f in frames if f.source == self._vehicle]
        if own and self._is_vehicle(place, own):
            return frames
        self.codec.statistics.strange += len(own)
        return [f for f in frames if f.source != self._vehicle]

    def _is_vehicle(self, place: Address, frames: list[RawFrame]) -> bool:
        """Return whether an address is the vehicle's: the first, or the next once it is silent.

        A router or a radio that starts anew has another port than before, and the old one is
        silent. Two addresses that speak for one vehicle are a relay or a forger: the first stays.
        """
        if place == self._pinned:
            return True
        silence = _SIGNED_SILENCE if self.codec.signs else _SILENCE
        if self._pinned is not None:
            shows_mode = any(f.message_id == MessageId.HEARTBEAT for f in frames)
            if time.monotonic() - self._pinned_heard <= silence or not shows_mode:
                return False
            self.address_changes += 1
        self._pinned, self._pinned_heard = place, time.monotonic()
        assert isinstance(self.endpoint, UdpEndpoint)
        self.endpoint.pin(place)
        return True

    def _note_sender(self, sender: Address, frames: list[RawFrame]) -> None:
        """Remember the address from which each vehicle's heartbeats come."""
        now = time.monotonic()
        for frame in frames:
            source = frame.source
            if (
                frame.message_id == MessageId.HEARTBEAT
                and source.component == ComponentId.AUTOPILOT1
            ):
                known = self._senders.get(source.system, {})
                kept = {place: at for place, at in known.items() if at > now - _SENDER_MEMORY}
                if sender in kept or len(kept) < _SENDERS:
                    kept[sender] = now
                self._senders[source.system] = kept

    def age(self, kind: type, system: int, component: int = ComponentId.AUTOPILOT1) -> float:
        """Return the seconds since that sender's last message of this kind, or infinity."""
        received_at = self._heard.get((Source(system, component), kind), float("-inf"))
        return time.monotonic() - received_at

    def receive(self, renew: bool = True) -> list[Received]:
        """Return the messages that have arrived, oldest first; never block.

        A flood costs a bounded time: so much is read, and the newest of what begins with an
        accepted frame is decoded. renew: begin a new allowance, as once a tick.
        """
        if renew:
            self._allowance = Allowance()
        near: list[RawFrame] = []
        far: list[RawFrame] = []  # from other addresses than the vehicle's
        for _, data, place, _, arrived in self._arrived(strangers=renew):
            frames = self._frames(data, place)
            if arrived is not None:
                frames = [frame._replace(arrived=arrived) for frame in frames]
            if self.tap is not None and (frames or not self._whole):
                self.tap(False, data)
            (far if self._is_strange(place) else near).extend(frames)
        heard = self.codec.read(far, max(self._allowance.of_strangers, 0))
        self._allowance.of_strangers -= len(heard)
        own = self.codec.read(near, max(self._allowance.messages, 0))
        self._allowance.messages -= len(own)
        now = time.monotonic()
        for r in heard + own:
            self._heard[r.source, type(r.message)] = now
        return heard + own

    def _is_strange(self, place: Address | None) -> bool:
        """Return whether an address is another than the vehicle's."""
        return self._vehicle is not None and place is not None and place != self._pinned

    def _arrived(self, strangers: bool) -> list[Packet]:
        """Return the newest packets that may hold frames, the vehicle's last.

        A packet that begins with an accepted frame is displaced by later ones of its kind alone:
        what was cut, forged or played back has a share of its own. strangers: read the packets of
        other addresses than the vehicle's, too.
        """
        udp = self.endpoint if isinstance(self.endpoint, UdpEndpoint) else None
        allowance, whole, claims = self._allowance, self._whole, self.codec.claim
        if allowance.spent:
            return []
        packets = self.endpoint.receive() if udp is None else udp.receive(strangers)
        data = next(packets, None)
        if data is None:  # as most often on a simulator's many links
            return []
        pinned = None if self._vehicle is None else self._pinned
        near, far = Newest(), Newest.of_strangers()
        doubtful: list[Packet] = []
        place, arrived, strange, heard, may_doubt = None, None, False, 0, True
        counts, sizes = [0] * len(Claim), [0] * len(Claim)  # of what is refused, by its claim
        number, left, room = 0, allowance.packets, allowance.bytes
        while data is not None:
            size = len(data)
            room -= size
            if udp is not None:
                place, arrived = udp.sender, udp.arrived
                strange = pinned is not None and place != pinned
            heard += not strange
            number += 1
            claim = claims(data) if whole else ACCEPTED
            if strange and claim is not GARBAGE and claim is not FOREIGN:
                self._drop(far.add(Packet(number, data, place, claim, arrived)))
            elif claim is ACCEPTED:
                self._drop(near.add(Packet(number, data, place, claim, arrived)))
            elif may_doubt and not strange and (may_doubt := allowance.take_doubtful(size)):
                doubtful.append(Packet(number, data, place, claim, arrived))
            else:
                counts[claim] += 1
                sizes[claim] += size
            data = next(packets, None) if number < left and room > 0 else None
        allowance.packets, allowance.bytes = left - number, room
        for claim in Claim:
            self.codec.refuse(claim, counts[claim], sizes[claim])
        self.packets_in += heard
        if heard:
            self._pinned_heard = time.monotonic()
        return [*far.packets, *heapq.merge(doubtful, near.packets)]

    def _drop(self, packets: list[Packet]) -> None:
        """Count packets that are not decoded."""
        for packet in packets:
            self.codec.refuse(packet.claim, 1, len(packet.data))
            if not self._whole:
                self.codec.restart()

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
