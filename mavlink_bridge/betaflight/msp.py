"""Betaflight's MSP version 1: frames, and the messages that the bridge reads and writes.

Frame: `$M`, `<` (to the controller), `>` (answer) or `!` (refused), payload size, command,
payload, XOR of everything from the size on. Numbers are little-endian.
Source: Betaflight msp_serial.c and msp.c, API 1.40 to 1.47.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from mavlink_bridge.shared.arrays import Vector

_GYRO_STEPS = 16.4  # per °/s, of the ±2000 °/s range that Betaflight sets every gyro to
_HEAD = 5  # $ M > size command


class Msp(IntEnum):
    """MSP command numbers."""

    API_VERSION = 1
    FC_VARIANT = 2
    FC_VERSION = 3
    MODE_RANGES = 34
    FEATURE_CONFIG = 36
    RX_MAP = 64
    RAW_IMU = 102
    RC = 105
    RAW_GPS = 106
    ATTITUDE = 108
    ALTITUDE = 109
    ANALOG = 110
    RC_TUNING = 111
    BOXIDS = 119
    STATUS_EX = 150
    SET_RAW_RC = 200
    MULTIPLE_MSP = 230


class MspError(ValueError):
    """A controller cannot fly as it is set up, or an answer cannot be read."""


@dataclass(frozen=True)
class Reply:
    """An answer to a command; refused: the controller does not carry the command out."""

    command: int
    payload: bytes
    refused: bool = False


def encode(command: int, payload: bytes = b"") -> bytes:
    """Return a request frame."""
    body = bytes([len(payload), command]) + payload
    return b"$M<" + body + bytes([_checksum(body)])


def _checksum(body: bytes | bytearray) -> int:
    total = 0
    for byte in body:
        total ^= byte
    return total


class MspDecoder:
    """Decode answers from a stream in any chunking; garbage is skipped and counted."""

    def __init__(self) -> None:
        self.bad_bytes = 0
        self._buffer = bytearray()

    def decode(self, data: bytes) -> list[Reply]:
        """Return the answers that `data` completes."""
        b = self._buffer
        b += data
        out: list[Reply] = []
        while True:
            start = b.find(b"$M")
            if start < 0:
                keep = 1 if b.endswith(b"$") else 0
                self._drop(len(b) - keep)
                return out
            self._drop(start)
            if len(b) < _HEAD or len(b) < _HEAD + b[3] + 1:
                return out
            end = _HEAD + b[3]
            if b[2] not in b">!" or _checksum(b[3:end]) != b[end]:
                self._drop(2)
                continue
            out.append(Reply(b[4], bytes(b[_HEAD:end]), b[2] == ord("!")))
            del b[: end + 1]

    def _drop(self, count: int) -> None:
        self.bad_bytes += count
        del self._buffer[:count]


# --- contents of the answers; each function raises MspError for an answer cut short ------


@dataclass(frozen=True)
class Status:
    """STATUS_EX. modes: bit k set where the box at place k of BOXIDS is active."""

    modes: int
    arming_disabled: int


@dataclass(frozen=True)
class RawImu:
    """RAW_IMU: specific force (3,) in the sensor's own unit and rates (3,) rad/s, body FLU."""

    force: Vector
    omega: Vector


@dataclass(frozen=True)
class RawGps:
    """RAW_GPS: degrees, whole metres; v (2,) m/s east and north."""

    fix: bool
    satellites: int
    latitude_deg: float
    longitude_deg: float
    altitude: float
    v: Vector


@dataclass(frozen=True)
class ModeRange:
    """A mode (box) that is on while AUX channel `aux` (0 = AUX1) lies in [low, high) µs."""

    box: int
    aux: int
    low: int
    high: int

    @property
    def middle(self) -> int:
        """Channel value [µs] that switches the mode on."""
        return (self.low + self.high) // 2

    def holds(self, value: int) -> bool:
        """Return whether a channel at `value` µs has the mode on."""
        return self.low <= value < self.high


# Names of the bits of Status.arming_disabled, API 1.47 (the lower ones are older).
ARMING_DISABLED = (
    "NOGYRO", "FAILSAFE", "RXLOSS", "NOT_DISARMED", "BOXFAILSAFE", "RUNAWAY", "CRASH", "THROTTLE",
    "ANGLE", "BOOTGRACE", "NOPREARM", "LOAD", "CALIB", "CLI", "CMS", "BST", "MSP", "PARALYZE",
    "GPS", "RESCUE_SW", "DSHOT_TELEM", "REBOOT_REQD", "DSHOT_BBANG", "NO_ACC_CAL", "MOTOR_PROTO",
    "FLIP_SWITCH", "ALT_HOLD_SW", "POS_HOLD_SW", "ARM_SWITCH",
)  # fmt: skip


def arming_reasons(flags: int) -> list[str]:
    """Return the names of the set bits; a bit without a name as its number."""
    names = dict(enumerate(ARMING_DISABLED))
    return [names.get(k, f"bit {k}") for k in range(32) if flags >> k & 1]


def _unpack(form: str, payload: bytes, at: int = 0) -> tuple[Any, ...]:
    """Return the fields of an answer; a busy Betaflight sends some answers empty.

    Raises:
        MspError: the answer is too short.
    """
    try:
        return struct.unpack_from(form, payload, at)
    except struct.error as error:
        raise MspError(f"an MSP answer of {len(payload)} bytes is too short") from error


def status(payload: bytes) -> Status:
    """Read STATUS_EX: a fixed head, a variable middle, and the arming flags behind it."""
    modes, extra = _unpack("<I5xB", payload, 6)
    more = extra & 0x0F  # bytes of modes beyond the first 32
    (flags,) = _unpack("<I", payload, 17 + more)
    return Status(modes | int.from_bytes(payload[16 : 16 + more], "little") << 32, flags)


def raw_imu(payload: bytes) -> RawImu:
    """Read RAW_IMU, whose gyro is in steps of the sensor."""
    values = np.array(_unpack("<6h", payload), dtype=float)
    return RawImu(values[:3], np.radians(values[3:6] / _GYRO_STEPS))


def attitude(payload: bytes) -> tuple[float, float, float]:
    """Read ATTITUDE: roll, pitch (nose down), compass heading [rad]; steps 0.1°, 0.1°, 1°."""
    roll, pitch, heading = _unpack("<3h", payload)
    return math.radians(roll / 10), math.radians(pitch / 10), math.radians(heading)


def altitude(payload: bytes) -> tuple[float, float]:
    """Read ALTITUDE: height [m] and climb rate [m/s]."""
    height, climb = _unpack("<ih", payload)
    return height / 100, climb / 100


def raw_gps(payload: bytes) -> RawGps:
    """Read RAW_GPS, whose speed is in cm/s and course over ground in 0.1°."""
    fix, satellites, lat, lon, height, speed, course = _unpack("<BBiihHH", payload)
    along = math.radians(course / 10)
    v = speed / 100 * np.array([math.sin(along), math.cos(along)])
    return RawGps(bool(fix), satellites, lat / 1e7, lon / 1e7, float(height), v)


def throttle(payload: bytes) -> float:
    """Read RC: the throttle [µs] in effect, from the bridge or the pilot."""
    return float(_unpack("<4H", payload)[3])


def battery(payload: bytes) -> tuple[float, float]:
    """Read ANALOG: voltage [V] and current [A]."""
    _, _, _, current, voltage = _unpack("<BHHhH", payload)
    return voltage / 100, current / 100


def mode_ranges(payload: bytes) -> list[ModeRange]:
    """Read MODE_RANGES: steps of 25 µs from 900 µs; unused entries are empty ranges."""
    whole = len(payload) // 4 * 4
    ranges = [
        ModeRange(box, aux, 900 + 25 * low, 900 + 25 * high)
        for box, aux, low, high in struct.iter_unpack("<4B", payload[:whole])
    ]
    return [r for r in ranges if r.low < r.high]


def several(commands: list[Msp]) -> bytes:
    """Return one request for several commands; Betaflight takes one request a cycle."""
    return encode(Msp.MULTIPLE_MSP, bytes(commands))


def split(commands: list[Msp], payload: bytes) -> dict[Msp, bytes]:
    """Return the answers inside the answer to `several`, each behind its length."""
    out, at = {}, 0
    for command in commands:
        if at >= len(payload):
            break
        size = payload[at]
        out[command] = payload[at + 1 : at + 1 + size]
        at += 1 + size
    return out


def raw_rc(channels: list[int]) -> bytes:
    """Return SET_RAW_RC: channels in µs, order A E T R AUX1 and on."""
    return encode(Msp.SET_RAW_RC, struct.pack(f"<{len(channels)}H", *channels))
