"""Encode messages to bytes and decode bytes to messages, without socket and clock.

Bad bytes are counted and never raise an error. Message ids that this project does not use are
dropped.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from pymavlink.dialects.v20 import common as mavlink

from mavlink_bridge.wire.dialect import FROM_WIRE, TO_WIRE
from mavlink_bridge.wire.messages import Message, Received, Source
from mavlink_bridge.wire.sequence import FrameCount
from mavlink_bridge.wire.signing import SIGNATURE_BYTES, Signing

_V1, _V2 = 0xFE, 0xFD  # first byte of a frame
_V1_OVERHEAD, _V2_OVERHEAD = 8, 12  # bytes of header and checksum
_MAGIC = re.compile(rb"[\xfd\xfe]")
_SIGNED = 0x01  # MAVLINK_IFLAG_SIGNED
_LONGEST_FRAME = 255 + _V2_OVERHEAD + SIGNATURE_BYTES
_SENDERS = 64  # most senders whose frames are counted


@dataclass
class CodecStatistics:
    """Counts of frames and bytes since the codec was made."""

    received: int = 0
    sent: int = 0
    bad_bytes: int = 0
    bad_frames: int = 0
    unknown: int = 0
    foreign: int = 0
    unsigned: int = 0


class Codec:
    """One end of a MAVLink 2 stream.

    system, component: ids of this end, in the frames that it sends. allow: accepted senders
    (component 0: any component of the system); None: all. signing: key and timestamps; None:
    signatures are neither made nor checked. Each stream needs its own codec, which keeps an
    incomplete frame until the rest arrives.
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
        """Return the messages as consecutive MAVLink 2 frames."""
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
        """Decode a packet of whole frames; the rest of it is garbage."""
        out = self.decode(data)
        self.statistics.bad_bytes += len(self._buffer)
        self._buffer.clear()
        return out

    def decode(self, data: bytes) -> list[Received]:
        """Return the messages that `data` completes, in any chunking; garbage is counted."""
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
                # Skip the false start only: a true frame may begin inside it.
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
        """Return the index of the next possible frame start; count the bytes skipped."""
        magic = _MAGIC.search(self._buffer, start)
        found = len(self._buffer) if magic is None else magic.start()
        self.statistics.bad_bytes += found - start
        return found

    def _frame_end(self, start: int) -> int | None:
        """Return the index behind the frame that begins at `start`; None while incomplete."""
        have = len(self._buffer) - start
        if have < _V1_OVERHEAD:
            return None
        length = self._buffer[start + 1]
        if self._buffer[start] == _V1:
            total = length + _V1_OVERHEAD
        else:
            signed = self._buffer[start + 2] & _SIGNED
            total = length + _V2_OVERHEAD + (SIGNATURE_BYTES if signed else 0)
        return start + total if have >= total else None

    def _decode_frame(self, start: int, end: int) -> Received | None:
        """Return the message in buffer[start:end]; None for an invalid frame."""
        b = self._buffer
        sequence, system, component, message_id = _header(b, start)
        if not self._allowed(system, component):
            self.statistics.foreign += 1
            return None
        if b[start] == _V2 and b[start + 2] & ~_SIGNED:
            self.statistics.bad_frames += 1  # unknown flags: MAVLink requires to discard the frame
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
        count.add(sequence, read=message is not None)
        return _DROPPED if message is None else Received(source, message, *count.take())

    def _count(self, source: Source) -> FrameCount:
        """Return the counts of this sender; the counts of too many senders are not kept."""
        if source not in self._counts and len(self._counts) >= _SENDERS:
            return FrameCount()
        return self._counts.setdefault(source, FrameCount())

    def _allowed(self, system: int, component: int) -> bool:
        allow = self._allow
        return allow is None or (system, component) in allow or (system, 0) in allow

    def _trusted(self, frame: bytes, source: Source) -> bool:
        """Return whether a frame is signed correctly, or signing is off."""
        if self._signing is None:
            return True
        signed = frame[0] == _V2 and bool(frame[2] & _SIGNED)
        return signed and self._signing.accepts(frame, source.system, source.component)


def _header(frame: bytearray, start: int) -> tuple[int, int, int, int]:
    """Return sequence number, system, component and message id of the frame at `start`."""
    if frame[start] == _V1:
        sequence, system, component, message_id = frame[start + 2 : start + 6]
    else:
        sequence, system, component = frame[start + 4 : start + 7]
        message_id = int.from_bytes(frame[start + 7 : start + 10], "little")
    return sequence, system, component, message_id


_DROPPED = Received(Source(0, 0), None)  # type: ignore[arg-type]  # a valid frame that is not used
