"""MAVLink 2 signing: frames that are not signed with the key are refused.

A signed frame ends with a link id, a 48-bit timestamp (10 µs since 2015) and the first 48 bits of
SHA-256 over key and frame. Source: https://mavlink.io/en/guide/message_signing.html. This module
checks signatures instead of pymavlink, which accepts a forged frame's timestamp before it checks
the signature: one packet from the future would silence the true vehicle.
"""

from __future__ import annotations

import hashlib
import hmac
from collections import deque
from dataclasses import dataclass, field
from enum import Enum

KEY_BYTES = 32
SIGNATURE_BYTES = 13
TICKS = 100_000  # of the timestamp per second
EPOCH = 1_420_070_400  # s, 2015-01-01 in Unix time
_NEW_STREAM = 60 * TICKS  # greatest age of the first frame of a new stream
_LINKS_APART = 1 * TICKS  # most that one sender's links differ
_SENT = 8192  # most timestamps of sent frames that are remembered: minutes
_STREAMS = 32  # most streams remembered: (link, system, component)
LAST = (1 << 48) - 1  # greatest timestamp

Stream = tuple[int, int, int]


def timestamp_at(unix_time: float) -> int:
    """Return the timestamp of a Unix time [s]; 0 before 2015, as a clock that was never set."""
    return max(round((unix_time - EPOCH) * TICKS), 0)


class Check(Enum):
    """The result of a check: only a good frame is heard."""

    GOOD = "good"
    FORGED = "not signed with the key"
    OLD = "signed with the key, and not new"


@dataclass
class Signing:
    """Key and timestamps of one end; it reads no clock, `advance` sets the time.

    key: 32 bytes. link_id: link id of sent frames. timestamp: of the next frame sent; it starts at
    the present, or at the last one used where that is later. streams: newest timestamp received.
    own: system and component of this end. Its own frames come back from a router that echoes, or
    from a recording: none is accepted that this end has sent.
    """

    key: bytes = field(repr=False)
    timestamp: int
    link_id: int = 0
    streams: dict[Stream, int] = field(default_factory=dict)
    own: tuple[int, int] | None = None
    _latest: dict[tuple[int, int], int] = field(default_factory=dict, repr=False)  # of any link
    _previewed: dict[Stream, int] = field(default_factory=dict, repr=False)
    _sent: deque[int] = field(default_factory=deque, repr=False)
    _sent_set: set[int] = field(default_factory=set, repr=False)
    _sent_until: int | None = None  # this timestamp and all before it may have been sent

    def __post_init__(self) -> None:
        if len(self.key) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, got {len(self.key)}")
        for stream, timestamp in self.streams.items():
            self.note(stream, timestamp)

    def advance(self, unix_time: float) -> None:
        """Set the time to `unix_time` [s]; a clock that goes back is ignored."""
        self.timestamp = max(self.timestamp, timestamp_at(unix_time))

    def next(self) -> int:
        """Return the timestamp of a frame that is sent now; no two frames have the same."""
        timestamp = self.timestamp
        if self._sent_until is None:
            self._sent_until = timestamp - 1
        self._sent.append(timestamp)
        self._sent_set.add(timestamp)
        self.timestamp = min(timestamp + 1, LAST)
        while len(self._sent) > _SENT or self._sent[0] <= timestamp - _NEW_STREAM:
            self._sent_until = self._sent.popleft()
            self._sent_set.discard(self._sent_until)
        return timestamp

    def signed(self, frame: bytes) -> bytes:
        """Return a frame with its signature: it is sent now."""
        stamped = frame + bytes([self.link_id]) + self.next().to_bytes(6, "little")
        return stamped + self._signature(stamped)

    def check(self, frame: bytes, system: int, component: int) -> Check:
        """Return whether a signed frame has the key's signature and is new; note its timestamp."""
        if not self._has_signature(frame):
            return Check.FORGED
        stream, timestamp = _stamp(frame, len(frame), system, component)
        if stream not in self.streams and len(self.streams) >= _STREAMS:
            return Check.OLD
        if timestamp <= self._newest(stream) or self._was_sent(timestamp, stream[1:]):
            return Check.OLD
        self.note(stream, timestamp)
        # A peer whose clock is ahead then accepts our next frame.
        self.timestamp = min(max(self.timestamp, timestamp), LAST)
        return Check.GOOD

    def may_be_new(self, data: bytes, length: int, sender: int) -> bool:
        """Return whether the timestamp of a packet's first frame is new; costs no hash.

        It is newer than what `check` has noted, and than the first frames already previewed: what
        is played back at once is not new either. length: of that frame; sender: system × 256 +
        component.
        """
        stream, timestamp = _stamp(data, length, sender >> 8, sender & 255)
        if timestamp <= self._previewed.get(stream, 0) or timestamp <= self.streams.get(stream, 0):
            return False
        return timestamp > self._newest(stream) and not self._was_sent(timestamp, stream[1:])

    def preview(self, frame: bytes, system: int, component: int) -> bool:
        """Return whether a frame that may be new has the key's signature; `check` still says so."""
        if not self._has_signature(frame):
            return False
        stream, timestamp = _stamp(frame, len(frame), system, component)
        self._previewed[stream] = timestamp
        return True

    def note(self, stream: Stream, timestamp: int) -> None:
        """Note the newest timestamp of a stream: frames must exceed it from now on."""
        self.streams[stream] = timestamp
        self._latest[stream[1:]] = max(self._latest.get(stream[1:], 0), timestamp)

    def _has_signature(self, frame: bytes) -> bool:
        return hmac.compare_digest(self._signature(frame[:-6]), frame[-6:])

    def _signature(self, stamped: bytes) -> bytes:
        """Return the six bytes that follow link id and timestamp of a frame."""
        return hashlib.sha256(self.key + stamped).digest()[:6]

    def _newest(self, stream: Stream) -> int:
        """Return the timestamp that a frame of this stream must exceed.

        Another link of the same sender has the same clock: what was recorded there is refused once
        this much newer frames have come.
        """
        newest = self.streams.get(stream, self.timestamp - _NEW_STREAM)
        return max(newest, self._latest.get(stream[1:], 0) - _LINKS_APART)

    def _was_sent(self, timestamp: int, sender: tuple[int, int]) -> bool:
        """Return whether this end has sent such a frame, now or before it was started."""
        if sender != self.own:
            return False
        until = self.timestamp if self._sent_until is None else self._sent_until
        return timestamp <= until or timestamp in self._sent_set


def _stamp(data: bytes, length: int, system: int, component: int) -> tuple[Stream, int]:
    """Return the stream and the timestamp of the signed frame that data begins with."""
    stream = data[length - SIGNATURE_BYTES], system, component
    return stream, int.from_bytes(data[length - 12 : length - 6], "little")
