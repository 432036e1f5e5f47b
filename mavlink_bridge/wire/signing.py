"""MAVLink 2 signing: frames that are not signed with the key are refused.

A signed frame ends with a link id, a 48-bit timestamp (10 µs since 2015) and the first 48 bits of
SHA-256 over key and frame. Source: https://mavlink.io/en/guide/message_signing.html. This module
checks signatures instead of pymavlink, which accepts a forged frame's timestamp before it checks
the signature: one packet from the future would silence the true vehicle.
"""

from __future__ import annotations

import hashlib
import hmac
from dataclasses import dataclass, field

KEY_BYTES = 32
SIGNATURE_BYTES = 13
TICKS = 100_000  # of the timestamp per second
EPOCH = 1_420_070_400  # s, 2015-01-01 in Unix time
_NEW_STREAM = 60 * TICKS  # greatest age of the first frame of a new stream
_STREAMS = 32  # most streams remembered: (link, system, component)
LAST = (1 << 48) - 1  # greatest timestamp

Stream = tuple[int, int, int]


def timestamp_at(unix_time: float) -> int:
    """Return the timestamp of a Unix time [s]; 0 before 2015, as a clock that was never set."""
    return max(round((unix_time - EPOCH) * TICKS), 0)


@dataclass
class Signing:
    """Key and timestamps of one end; it reads no clock, `advance` sets the time.

    key: 32 bytes. link_id: link id of sent frames. timestamp: of the next frame sent; it starts at
    the present, or at the last one used where that is later. streams: newest timestamp received.
    """

    key: bytes = field(repr=False)
    timestamp: int
    link_id: int = 0
    streams: dict[Stream, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.key) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, got {len(self.key)}")

    def advance(self, unix_time: float) -> None:
        """Set the time to `unix_time` [s]; a clock that goes back is ignored."""
        self.timestamp = max(self.timestamp, timestamp_at(unix_time))

    def accepts(self, frame: bytes, system: int, component: int) -> bool:
        """Return whether a frame is signed with the key and newer than its stream's last one."""
        if len(frame) <= SIGNATURE_BYTES:
            return False
        signature = hashlib.sha256(self.key + frame[:-6]).digest()[:6]
        if not hmac.compare_digest(signature, frame[-6:]):
            return False
        stream = (frame[-SIGNATURE_BYTES], system, component)
        timestamp = int.from_bytes(frame[-12:-6], "little")
        if stream not in self.streams and len(self.streams) >= _STREAMS:
            return False
        if timestamp <= self.streams.get(stream, self.timestamp - _NEW_STREAM):
            return False
        self.streams[stream] = timestamp
        # A peer whose clock is ahead then accepts our next frame.
        self.timestamp = min(max(self.timestamp, timestamp), LAST)
        return True
