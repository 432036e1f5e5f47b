"""Make MAVLink frames, and find them in bytes of which any may be garbage, at a bounded cost.

The search for a first byte runs at the speed of `re`. Length, flags, ids and checksum are looked at
before anything is decoded, each in a time that does not depend on what the bytes say.
Source: https://mavlink.io/en/guide/serialization.html.
"""

from __future__ import annotations

import binascii
import re
from collections.abc import Collection
from typing import NamedTuple

from mavlink_bridge.wire.dialect.layout import CRC_EXTRA
from mavlink_bridge.wire.messages import Source
from mavlink_bridge.wire.signing import SIGNATURE_BYTES

V1, V2 = 0xFE, 0xFD  # first byte of a frame
SIGNED = 0x01  # MAVLINK_IFLAG_SIGNED, the only flag that is understood
LONGEST = 255 + 12 + SIGNATURE_BYTES  # bytes of a frame
HEADER = 10  # bytes in front of the payload, MAVLink 2
_V1_HEADER = 6
_CHECKSUM = 2
V1_AROUND, V2_AROUND = _V1_HEADER + _CHECKSUM, HEADER + _CHECKSUM  # bytes around the payload
_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
_CRC_EXTRA = {  # of each known message, as one byte with its bits in reverse order
    number: bytes([_REVERSED[extra]]) for number, extra in CRC_EXTRA.items()
}


class RawFrame(NamedTuple):
    """One frame whose checksum is right, or cannot be known; data: all bytes, signature too.

    arrived: as of its packet.
    """

    source: Source
    sequence: int
    message_id: int
    data: bytes
    arrived: float | None = None

    @property
    def verified(self) -> bool:
        """Whether the checksum is known and right."""
        return is_known(self.message_id)

    @property
    def payload(self) -> bytes:
        """The payload, as long as it was sent."""
        start = _V1_HEADER if self.data[0] == V1 else HEADER
        return self.data[start : start + self.data[1]]


def start_pattern(allow: Collection[tuple[int, int]] | None) -> re.Pattern[bytes]:
    """Return the pattern of a header that may begin a frame.

    allow: (system, component) of a MAVLink 1 frame, component 0: any; None: all.
    """
    if allow is None:
        v1_ids = b""
    else:
        choices = (_byte(s) + (b"." if c == 0 else _byte(c)) for s, c in sorted(allow))
        v1_ids = b"..(?:" + b"|".join(choices) + b")" if allow else b"(?!)"
    return re.compile(rb"\xfd.[\x00\x01]|\xfe" + v1_ids, re.DOTALL)


def _byte(value: int) -> bytes:
    return re.escape(bytes([value]))


def frame_length(data: bytes | bytearray, start: int) -> int:
    """Return the number of bytes of the frame whose first three bytes are at `start`."""
    length = data[start + 1]
    if data[start] == V1:
        return length + V1_AROUND
    return length + V2_AROUND + (SIGNATURE_BYTES if data[start + 2] & SIGNED else 0)


def header(data: bytes | bytearray, start: int) -> tuple[int, int, int, int]:
    """Return sequence number, system, component and message id of the frame at `start`."""
    if data[start] == V1:
        return data[start + 2], data[start + 3], data[start + 4], data[start + 5]
    number = data[start + 7] | data[start + 8] << 8 | data[start + 9] << 16
    return data[start + 4], data[start + 5], data[start + 6], number


def is_known(message_id: int) -> bool:
    """Return whether the checksum of this message can be verified."""
    return message_id in _CRC_EXTRA


def checksum_holds(frame: bytes | bytearray, message_id: int) -> bool:
    """Return whether the checksum of a frame of a known message is right."""
    end = (_V1_HEADER if frame[0] == V1 else HEADER) + frame[1]
    return _checksum(frame[1:end], message_id) == frame[end : end + _CHECKSUM]


def framed(payload: bytes, message_id: int, sequence: int, source: Source, flags: int) -> bytes:
    """Return a MAVLink 2 frame without a signature; flags: SIGNED where one will follow.

    Zeros at the end of the payload are not sent, but for its first byte.
    """
    body = payload.rstrip(b"\0") or payload[:1]
    head = bytes((len(body), flags, 0, sequence, *source)) + message_id.to_bytes(3, "little")
    data = head + body
    return b"\xfd" + data + _checksum(data, message_id)


def _checksum(data: bytes | bytearray, message_id: int) -> bytes:
    """Return the checksum of a frame of a known message, as it is sent.

    data: from behind the frame's first byte to the end of its payload. It is CRC-16/MCRF4XX: the
    CRC of `binascii` over bytes whose bits are in reverse order.
    """
    crc = binascii.crc_hqx(data.translate(_REVERSED), 0xFFFF)
    crc = binascii.crc_hqx(_CRC_EXTRA[message_id], crc)
    return crc.to_bytes(2, "big").translate(_REVERSED)
