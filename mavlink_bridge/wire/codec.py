"""Bytes ↔ messages, without socket and without clock.

Bad bytes are counted and never raised; message ids that this project does not use are
dropped before anything else looks at them.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from pymavlink.dialects.v20 import common as mavlink

from mavlink_bridge.wire.dialect import FROM_WIRE, TO_WIRE
from mavlink_bridge.wire.messages import Message, Received, Source
from mavlink_bridge.wire.sequence import FrameCount
from mavlink_bridge.wire.signing import Signing

_V1, _V2 = 0xFE, 0xFD
_MAGIC = re.compile(rb"[\xfd\xfe]")
_SIGNED = 0x01
_LONGEST_FRAME = 280
_SENDERS = 64  # most whose frames are counted


@dataclass
class CodecStatistics:
    """What went through a codec: counts since it was made."""

    received: int = 0
    sent: int = 0
    bad_bytes: int = 0
    bad_frames: int = 0
    unknown: int = 0
    foreign: int = 0
    unsigned: int = 0


class Codec:
    """One end of a MAVLink 2 stream.

    system, component: this end's ids, stamped on what it sends. allow: who is heard (component 0:
    any of that system); None: everybody. signing: key and timestamps; None: signatures are
    neither made nor checked. One codec per stream: a half-received frame waits in it for the rest.
    """

    def __init__(
        self,
        system: int,
        component: int,
        allow: Collection[Source] | None = None,
        signing: Signing | None = None,
    ) -> None:
        if not 1 <= system <= 255:
            raise ValueError(f"MAVLink system id must be 1…255, got {system}")
        self.statistics = CodecStatistics()
        self._mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self._reader = mavlink.MAVLink(None)
        self._allow = None if allow is None else frozenset((a.system, a.component) for a in allow)
        self._signing = signing
        if signing is not None:
            self._mav.signing.secret_key = signing.key
            self._mav.signing.link_id = signing.link_id
            self._mav.signing.sign_outgoing = True
        self._buffer = bytearray()
        self._counts: dict[Source, FrameCount] = {}

    def encode(self, messages: Iterable[Message]) -> bytes:
        """The messages as consecutive MAVLink 2 frames."""
        frames = bytearray()
        if self._signing is not None:
            self._mav.signing.timestamp = self._signing.timestamp
        for message in messages:
            frames += TO_WIRE[type(message)](message).pack(self._mav)
            self._mav.seq = (self._mav.seq + 1) % 256
            self.statistics.sent += 1
        if self._signing is not None:
            self._signing.timestamp = self._mav.signing.timestamp
        return bytes(frames)

    def decode_datagram(self, data: bytes) -> list[Received]:
        """As `decode`, for transports whose packets hold whole frames: the rest is garbage."""
        out = self.decode(data)
        self.statistics.bad_bytes += len(self._buffer)
        self._buffer.clear()
        return out

    def decode(self, data: bytes) -> list[Received]:
        """Messages completed by `data` (any chunking); garbage is skipped and counted."""
        buffer = self._buffer
        buffer += data
        out: list[Received] = []
        start = 0
        while True:
            start = self._next_magic(start)
            end = self._frame_end(start)
            if end is None:
                break
            received = self._decode_frame(start, end)
            if received is None:
                # Step over the false start only: a true frame may begin inside it.
                start += 1
            else:
                start = end
                if received is not _DROPPED:
                    out.append(received)
        del buffer[:start]
        if len(buffer) > _LONGEST_FRAME:  # cannot happen while frames end where they say
            self.statistics.bad_bytes += len(buffer)
            buffer.clear()
        return out

    def _next_magic(self, start: int) -> int:
        """Index of the next possible frame start, counting what is passed over."""
        magic = _MAGIC.search(self._buffer, start)
        found = len(self._buffer) if magic is None else magic.start()
        self.statistics.bad_bytes += found - start
        return found

    def _frame_end(self, start: int) -> int | None:
        """Index behind the frame that begins at `start`; None while it is incomplete."""
        have = len(self._buffer) - start
        if have < 8:
            return None
        length = self._buffer[start + 1]
        if self._buffer[start] == _V1:
            total = length + 8
        else:
            total = length + 12 + (13 if self._buffer[start + 2] & _SIGNED else 0)
        return start + total if have >= total else None

    def _decode_frame(self, start: int, end: int) -> Received | None:
        """The message in buffer[start:end]; None where that is no valid frame."""
        b = self._buffer
        if b[start] == _V1:
            sequence, system, component, message_id = b[start + 2 : start + 6]
        else:
            sequence, system, component = b[start + 4 : start + 7]
            message_id = b[start + 7] | b[start + 8] << 8 | b[start + 9] << 16
        if not self._allowed(system, component):
            self.statistics.foreign += 1
            return None
        if b[start] == _V2 and b[start + 2] & ~_SIGNED:
            self.statistics.bad_frames += 1  # of a kind that is to be discarded where not known
            return None
        source, convert = Source(system, component), FROM_WIRE.get(message_id)
        if convert is None and message_id not in mavlink.mavlink_map:
            self.statistics.unknown += 1
            if source in self._counts:
                self._counts[source].unknown += 1
            return None
        try:
            wire = self._reader.decode(b[start:end])
            if not self._trusted(bytes(b[start:end]), source):
                self.statistics.unsigned += 1
                return None
            message = convert(wire) if convert else None
        except (mavlink.MAVError, ValueError, TypeError, OverflowError):
            self.statistics.bad_frames += 1
            return None
        self.statistics.received += 1
        count = self._count(source)
        count.came(sequence, read=message is not None)
        return _DROPPED if message is None else Received(source, message, *count.taken())

    def _count(self, source: Source) -> FrameCount:
        """Of this sender; of too many, none is kept."""
        if source not in self._counts and len(self._counts) >= _SENDERS:
            return FrameCount()
        return self._counts.setdefault(source, FrameCount())

    def _allowed(self, system: int, component: int) -> bool:
        allow = self._allow
        return allow is None or (system, component) in allow or (system, 0) in allow

    def _trusted(self, frame: bytes, source: Source) -> bool:
        """Whether a frame may be believed: signed, where signatures are wanted."""
        if self._signing is None:
            return True
        signed = frame[0] == _V2 and bool(frame[2] & _SIGNED)
        return signed and self._signing.accepts(frame, source.system, source.component)


_DROPPED = Received(Source(0, 0), None)  # type: ignore[arg-type]  # a valid frame nobody reads
