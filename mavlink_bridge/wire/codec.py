"""Encode messages to bytes and decode bytes to messages, without socket and clock.

Bad bytes are counted and never raise an error. Message ids that this project does not use are
dropped.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from mavlink_bridge.wire import framing
from mavlink_bridge.wire.allowance import ACCEPTED, FOREIGN, GARBAGE, OLD, UNSIGNED, Claim
from mavlink_bridge.wire.dialect import FROM_WIRE, TO_WIRE
from mavlink_bridge.wire.dialect.pack import packed
from mavlink_bridge.wire.dialect.unpack import unpacked
from mavlink_bridge.wire.framing import HEADER, SIGNED, V1, V1_AROUND, V2, V2_AROUND, RawFrame
from mavlink_bridge.wire.messages import Message, Received, Source
from mavlink_bridge.wire.sequence import FrameCount
from mavlink_bridge.wire.signing import SIGNATURE_BYTES, Check, Signing

_COPIES_OF = 128  # newest frames whose messages are kept
_SENDERS = 64  # most senders whose frames are counted
_MAGIC = (b"\xfd", b"\xfe")
_NEXT = 16  # frames on, of which a few are lost, the next frame of a sender may be
_FALSE_STARTS = 16  # most false starts in a datagram: a sender of frames makes next to none


@dataclass
class CodecStatistics:
    """Counts of frames and bytes since the codec was made.

    unknown: accepted frames of messages that this project does not know. unsigned: frames refused
    for their signature. replayed: signed with the key, but not new. strange: frames of the vehicle
    from another address than its own. dropped: bytes of a flood that were not looked at.
    """

    received: int = 0
    sent: int = 0
    bad_bytes: int = 0
    bad_frames: int = 0
    unknown: int = 0
    foreign: int = 0
    unsigned: int = 0
    replayed: int = 0
    strange: int = 0
    dropped: int = 0


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
        self._own, self._sequence = Source(system, component), 0
        pairs = None if allow is None else frozenset((a.system, a.component) for a in allow)
        self._allow = _allowed_ids(pairs)
        self._start = framing.start_pattern(pairs)
        self._signing = signing
        if signing is not None:
            signing.own = (system, component)
        self._buffer = bytearray()
        self._counts: dict[Source, FrameCount] = {}
        self._numbers: dict[Source, int] = {}  # of each sender's last frame
        self._newest: OrderedDict[bytes, Message] = OrderedDict()  # by their frames, oldest first

    @property
    def signs(self) -> bool:
        """Whether only signed frames are accepted."""
        return self._signing is not None

    def encode(self, messages: Iterable[Message]) -> bytes:
        """Return the messages as consecutive MAVLink 2 frames."""
        frames = []
        signing, flags = self._signing, 0 if self._signing is None else SIGNED
        for message in messages:
            fields = TO_WIRE[type(message)](message)
            number = type(fields).layout.number
            frame = framing.framed(packed(fields), number, self._sequence, self._own, flags)
            frames.append(frame if signing is None else signing.signed(frame))
            self._sequence = (self._sequence + 1) % 256
            self.statistics.sent += 1
        return b"".join(frames)

    def decode_datagram(self, data: bytes) -> list[Received]:
        """Decode a packet of whole frames; the rest of it is garbage."""
        return self.read(self.frames(data))

    def decode(self, data: bytes) -> list[Received]:
        """Return the messages that `data` completes, in any chunking; garbage is counted."""
        return self.read(self.stream_frames(data))

    def claim(self, data: bytes) -> Claim:
        """Return what the first frame of a datagram is: an accepted one, or why not.

        What costs least is looked at first, and nothing behind that frame; no timestamp is noted.
        A flood asks this for thousands of packets in a tick: it stays one function.
        """
        size = len(data)
        if size < HEADER:
            return GARBAGE
        v1 = data[0] == V1
        if v1:
            flags, sender = 0, data[3] << 8 | data[4]
        else:
            flags, sender = data[2], data[5] << 8 | data[6]
        length = data[1] + (V1_AROUND if v1 else V2_AROUND) + (SIGNATURE_BYTES if flags else 0)
        if length > size or flags > SIGNED or not (v1 or data[0] == V2):
            return GARBAGE
        if not self._allow[sender]:
            return FOREIGN
        signing = self._signing
        if signing is not None:
            if not flags:
                return UNSIGNED
            if not signing.may_be_new(data, length, sender):
                return OLD
        message_id = framing.header(data, 0)[3]
        frame = data[:length]
        if framing.is_known(message_id) and not framing.checksum_holds(frame, message_id):
            return GARBAGE
        if signing is not None and not signing.preview(frame, sender >> 8, sender & 255):
            return UNSIGNED
        return ACCEPTED

    def refuse(self, claim: Claim, packets: int, size: int) -> None:
        """Count packets of `size` bytes in all that are not decoded, as what they claim to be."""
        counts = self.statistics
        if claim is GARBAGE:
            counts.bad_bytes += size
        elif claim is OLD:
            counts.replayed += packets
        elif claim is FOREIGN:
            counts.foreign += packets
        elif claim is UNSIGNED:
            counts.unsigned += packets
        else:
            counts.dropped += size

    def restart(self) -> None:
        """Forget the incomplete frame of a stream: what would complete it is lost."""
        self.statistics.bad_bytes += len(self._buffer)
        self._buffer.clear()

    def stream_frames(self, data: bytes) -> list[RawFrame]:
        """Return the accepted frames that `data` completes, oldest first; unknown ones, too."""
        buffer = self._buffer
        buffer += data
        found, start = self._scan(buffer, whole=False)
        del buffer[:start]
        return found

    def frames(self, data: bytes) -> list[RawFrame]:
        """Return the accepted frames of a datagram, oldest first.

        The first bytes of a frame that is not whole are garbage, and so is the rest of a datagram
        with many false starts.
        """
        return self._scan(data, whole=True)[0]

    def read(self, frames: Sequence[RawFrame], most: int | None = None) -> list[Received]:
        """Return the messages of frames; most: of so many frames, the newest that are used."""
        out: list[Received] = []
        used = [n for n, frame in enumerate(frames) if frame.message_id in FROM_WIRE]
        left_out = 0 if most is None else max(len(used) - most, 0)
        first = used[left_out - 1] + 1 if left_out else 0
        for n, frame in enumerate(frames):
            count = self._count(frame.source)
            if not frame.verified:
                count.unknown += 1
                continue
            convert = FROM_WIRE.get(frame.message_id) if n >= first else None
            message, known = None, self._newest.get(frame.data)
            if convert is not None:
                try:
                    message = known or self._converted(frame, convert)
                except (ValueError, TypeError, OverflowError):
                    self.statistics.bad_frames += 1
                    continue
            self.statistics.received += 1
            if known is not None and hasattr(message, "time"):
                continue  # with the same time and number: a copy, which tells nothing
            count.add(frame.sequence, read=message is not None)
            if message is not None:
                out.append(Received(frame.source, message, *count.take(), frame.arrived))
        return out

    def _converted(self, frame: RawFrame, convert: Callable[[Any], Message]) -> Message:
        """Return the message of a new frame; a line that repeats it will find it.

        Raises:
            ValueError, TypeError, OverflowError: the payload is no such message.
        """
        message = convert(unpacked(frame.message_id, frame.payload))
        self._newest[frame.data] = message
        if len(self._newest) > _COPIES_OF:
            self._newest.popitem(last=False)
        return message

    def _scan(self, data: bytes | bytearray, whole: bool) -> tuple[list[RawFrame], int]:
        """Return the accepted frames in `data`, and the index of the first byte not looked at.

        whole: data holds whole frames; else a frame at its end may be incomplete.
        """
        found: list[RawFrame] = []
        start, false_starts, s = 0, 0, self.statistics
        while not whole or false_starts < _FALSE_STARTS:
            match = self._start.search(data, start)
            if match is None:
                return found, self._skip(data, start, whole)
            s.bad_bytes += match.start() - start
            start = match.start()
            short = len(data) - start < HEADER
            length = 0 if short else framing.frame_length(data, start)
            if short or len(data) - start < length:
                if not whole:
                    return found, start
                false_starts, start = false_starts + 1, start + 1
                s.bad_bytes += 1
                continue
            if self._judge(data, start, length, found):
                start += length
            else:
                s.bad_bytes += 1
                false_starts, start = false_starts + 1, start + 1
        s.bad_bytes += len(data) - start
        return found, len(data)

    def _skip(self, data: bytes | bytearray, start: int, whole: bool) -> int:
        """Count the bytes from `start` on as bad; of a stream the last few may begin a frame."""
        tail = start if whole else max(start, len(data) - HEADER)
        begun = (
            -1 if whole else min((i for m in _MAGIC if (i := data.find(m, tail)) >= 0), default=-1)
        )
        end = len(data) if begun < 0 else begun
        self.statistics.bad_bytes += end - start
        return end

    def _judge(
        self, data: bytes | bytearray, start: int, length: int, found: list[RawFrame]
    ) -> bool:
        """Append the frame at `start` where it is accepted; return whether it is a frame at all."""
        sequence, system, component, message_id = framing.header(data, start)
        s, end = self.statistics, start + length
        if not framing.is_known(message_id):
            return self._judge_unknown(data, start, end, found)
        frame = bytes(data[start:end])
        if not framing.checksum_holds(frame, message_id):
            s.bad_frames += 1
            return False
        if not self._allow[system << 8 | component]:
            s.foreign += 1
        elif self._signed(frame, system, component):
            source = Source(system, component)
            found.append(RawFrame(source, sequence, message_id, frame))
            if source in self._numbers or len(self._numbers) < _SENDERS:
                self._numbers[source] = sequence
        return True

    def _judge_unknown(
        self, data: bytes | bytearray, start: int, end: int, found: list[RawFrame]
    ) -> bool:
        """Append the frame of another dialect that begins at `start`; return whether it is one.

        Its checksum says nothing. Where another frame or the end follows it, it is a frame; so it
        is where its number follows the last one of a sender that is heard.
        """
        sequence, system, component, message_id = framing.header(data, start)
        source = Source(system, component)
        step = (sequence - self._numbers.get(source, sequence)) % 256
        if not (end == len(data) or data[end : end + 1] in _MAGIC or 0 < step <= _NEXT):
            return False
        frame = bytes(data[start:end])
        if not self._allow[system << 8 | component]:
            self.statistics.foreign += 1
        elif self._signed(frame, system, component):
            self.statistics.unknown += 1
            found.append(RawFrame(source, sequence, message_id, frame))
        return True

    def _count(self, source: Source) -> FrameCount:
        """Return the counts of this sender; the counts of too many senders are not kept."""
        count = self._counts.get(source)
        if count is None:
            count = FrameCount()
            if len(self._counts) < _SENDERS:
                self._counts[source] = count
        return count

    def _signed(self, frame: bytes, system: int, component: int) -> bool:
        """Return whether a frame is signed correctly and new, or signing is off."""
        if self._signing is None:
            return True
        if frame[0] != V2 or not frame[2] & SIGNED:
            self.statistics.unsigned += 1
            return False
        check = self._signing.check(frame, system, component)
        self.statistics.unsigned += check is Check.FORGED
        self.statistics.replayed += check is Check.OLD
        return check is Check.GOOD


def _allowed_ids(pairs: Collection[tuple[int, int]] | None) -> bytes:
    """Return for each system × 256 + component whether it is heard; see `Codec`'s `allow`."""
    if pairs is None:
        return bytes([1]) * (1 << 16)
    ids = bytearray(1 << 16)
    for system, component in pairs:
        first, count = system << 8 | component, 1 if component else 256
        ids[first : first + count] = bytes([1]) * count
    return bytes(ids)
