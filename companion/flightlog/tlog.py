"""MAVLink traffic as a .tlog, the telemetry log that ground stations open.

Before each frame stand eight bytes: microseconds, big-endian. The time is the vehicle's clock, as
in the flight log. While the vehicle is disarmed, streams of its state are thinned to one frame a
second of each kind, and while nothing happens to one in ten seconds of every kind that is streamed.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path

from mavlink_bridge.wire.ids import MessageId

_V1, _V2, _SIGNED = 0xFE, 0xFD, 0x01
_STAMP = struct.Struct(">Q")
_THINNED = {
    MessageId.ATTITUDE,
    MessageId.ATTITUDE_QUATERNION,
    MessageId.ATTITUDE_TARGET,
    MessageId.DISTANCE_SENSOR,
    MessageId.ESTIMATOR_STATUS,
    MessageId.EXTENDED_SYS_STATE,
    MessageId.GLOBAL_POSITION_INT,
    MessageId.GPS_RAW_INT,
    MessageId.LOCAL_POSITION_NED,
    MessageId.ODOMETRY,
    MessageId.SYS_STATUS,
    MessageId.TIMESYNC,
}
_STREAMED = _THINNED | {
    MessageId.BATTERY_STATUS,
    MessageId.HEARTBEAT,
    MessageId.HOME_POSITION,
    MessageId.MISSION_CURRENT,
    MessageId.NAMED_VALUE_FLOAT,
    MessageId.NAMED_VALUE_INT,
    MessageId.PING,
    MessageId.SYSTEM_TIME,
}
_DISARMED, _IDLE = 1.0, 10.0  # s between two frames of a kind
_KINDS = 512  # most kinds that are remembered


class TelemetryLog:
    """Appends MAVLink frames to a file."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb")
        self._rest = {False: b"", True: b""}
        self._written: dict[
            tuple[bool, int | bytes], float
        ] = {}  # s, of the latest frame of each kind

    def write(
        self,
        time: float,
        packets: Iterable[tuple[bool, bytes]],
        armed: bool = True,
        idle: bool = False,
    ) -> None:
        """Append the frames of packets (sent by us, bytes), cut anywhere; time: s, of all."""
        stamp = _STAMP.pack(max(round(time * 1e6), 0))
        out = []
        for sent, data in packets:
            whole, self._rest[sent] = frames(self._rest[sent] + data)
            if not armed or idle:
                whole = [f for f in whole if self._wanted(time, sent, f, idle)]
            out += [stamp + frame for frame in whole]
        self._file.write(b"".join(out))

    def _wanted(self, time: float, sent: bool, frame: bytes, idle: bool) -> bool:
        """Return whether a frame is kept while the vehicle is disarmed.

        While it is idle, a message that is repeated word for word is a stream, too.
        """
        number = frame[5] if frame[0] == _V1 else int.from_bytes(frame[7:10], "little")
        streams, between = (_STREAMED, _IDLE) if idle else (_THINNED, _DISARMED)
        if not idle and number not in streams:
            return True
        kind = number if number in streams else _words(frame)
        before = self._written.get((sent, kind))
        if before is not None and 0.0 <= time - before < between - 1e-6:
            return False
        if len(self._written) >= _KINDS:
            self._written.clear()
        self._written[sent, kind] = time
        return True

    def flush(self) -> None:
        """Hand everything to the system, so that a kill of the process loses nothing."""
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _words(frame: bytes) -> bytes:
    """Return what a frame says: ids and payload, without its sequence number and signature."""
    start = 3 if frame[0] == _V1 else 5
    return frame[start : (6 if frame[0] == _V1 else 10) + frame[1]]


def frames(data: bytes) -> tuple[list[bytes], bytes]:
    """Return the whole MAVLink frames, by their length alone, and the rest of the data."""
    found: list[bytes] = []
    at = 0
    while at < len(data):
        end = _end(data, at)
        if end is None:
            at += 1
        elif end > len(data):
            break
        else:
            found.append(data[at:end])
            at = end
    return found, data[at:]


def _end(data: bytes, at: int) -> int | None:
    """Return the end of the frame that begins at `at`, past the data where it is cut off.

    None: no frame begins there.
    """
    if data[at] not in (_V1, _V2):
        return None
    if at + 3 > len(data):
        return len(data) + 1
    length = data[at + 1]
    if data[at] == _V1:
        return at + length + 8
    return at + length + (25 if data[at + 2] & _SIGNED else 12)
