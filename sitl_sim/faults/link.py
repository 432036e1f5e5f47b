"""Faults of the link between a vehicle and its companion: packets, and telemetry values."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.ids import ComponentId
from mavlink_bridge.wire.link import Endpoint, Link
from mavlink_bridge.wire.messages import (
    Attitude,
    Command,
    CommandId,
    Heartbeat,
    LocalPosition,
    Message,
    Odometry,
    Received,
    SystemTime,
    TimeSync,
)
from sitl_sim.faults.catalogue import Fault, Schedule

_DATAGRAM = 1400  # bytes of garbage at a time
_RECORDED = 4096  # packets that a recording keeps
_HOLD = 0x03040000  # PX4's custom_mode AUTO LOITER, as HEARTBEAT tells it
_FLIPS = 8  # most bits flipped in a packet
_FORCE = 21196.0  # param2 of a disarm that is not refused in flight
_PERIOD = 0.02  # s between two calls of `noise`
_NOT_NUMBERS = (np.nan, np.inf, -np.inf, 1e-45)  # the last: a denormal as float32 too

_Own: TypeAlias = Attitude | LocalPosition | Odometry  # of one estimator, so wrong together


class FaultyLine:
    """Alters the packets of drone i, each way; the flight sets `now` [s of the flight]."""

    def __init__(self, schedule: Schedule, i: int) -> None:
        self.now = 0.0
        self._schedule, self._i = schedule, i
        self._attacked = 0.0  # until then the vehicle was attacked
        self._held: list[bytes] = []  # on their way to the companion
        self._seen = b""
        self._recorded: deque[bytes] = deque(maxlen=_RECORDED)  # sent either way
        self._reflected: list[bytes] = []  # on their way back to the companion

    def carry(self, data: bytes, to_companion: bool) -> list[bytes]:
        """Return the packets that arrive where `data` was sent."""
        waiting: list[bytes] = []
        self._recorded.append(data)
        if not to_companion and self._strikes("link_reflect"):
            self._reflected.append(data)
        if to_companion:
            waiting, self._held = self._held, []
        if self._strikes("link_loss"):
            return waiting
        if self._strikes("link_flip"):
            data = _flip(data, self._active("link_flip")[0].rng)
        if to_companion:
            self._seen = data
            if self._strikes("link_reorder"):
                self._held.append(data)
                return waiting
        return [data] * (1 + self._strikes("link_duplicate")) + waiting

    def noise(self) -> list[bytes]:
        """Return packets that no vehicle sent, for the companion; called every 20 ms."""
        out: list[bytes] = []
        for fault in self._active("link_garbage"):
            left = round(fault.value * _PERIOD)
            while left > 0:
                out.append(self._garbage(fault.rng, min(left, _DATAGRAM)))
                left -= len(out[-1]) or 1
        for fault in self._active("link_foreign"):
            for _ in range(fault.rng.poisson(fault.value * _PERIOD)):
                out.append(foreign(fault.rng, self._i + 1))
        return out + self._attack()

    def _attack(self) -> list[bytes]:
        """Return what an attacker on the line sends to the companion in 20 ms."""
        out, self._reflected = self._reflected, []
        for fault in self._active("link_replay"):
            for _ in range(fault.rng.poisson(fault.value * _PERIOD) if self._recorded else 0):
                out.append(self._recorded[int(fault.rng.integers(len(self._recorded)))])
        for fault in self._active("link_flood"):
            whole, rest = divmod(round(fault.value * _PERIOD), _DATAGRAM)
            out += [b"\xfd" * _DATAGRAM] * whole + [b"\xfd" * rest] * (rest > 0)
        for fault in self._active("link_spoof"):
            spoof = Heartbeat(12, 2, True, _HOLD, 4)
            for _ in range(fault.rng.poisson(fault.value * _PERIOD)):
                out.append(Codec(self._i + 1, 1).encode([spoof]))
        return out

    def attack_vehicle(self) -> list[bytes]:
        """Return what an attacker has sent to the vehicle since this was last called."""
        out: list[bytes] = []
        since, self._attacked = self.now - self._attacked, self.now
        if since <= 0.0:
            return out
        for fault in self._active("link_replay"):
            for _ in range(fault.rng.poisson(fault.value * since) if self._recorded else 0):
                out.append(self._recorded[int(fault.rng.integers(len(self._recorded)))])
        for fault in self._active("link_forge"):
            system = self._i + 1
            disarm = Command(
                CommandId.COMPONENT_ARM_DISARM, (0.0, _FORCE, 0.0, 0.0, 0.0, 0.0, 0.0), system
            )
            for _ in range(fault.rng.poisson(fault.value * since)):
                out.append(Codec(system, ComponentId.ONBOARD_COMPUTER).encode([disarm]))
        return out

    def _garbage(self, rng: np.random.Generator, size: int) -> bytes:
        """Return random bytes, a truncated frame, or a frame with flipped bits."""
        kind = rng.integers(3)
        if kind == 0 or not self._seen:
            return rng.bytes(size)
        if kind == 1:
            return self._seen[: rng.integers(1, len(self._seen))]
        return _flip(self._seen, rng)

    def _active(self, kind: str) -> list[Fault]:
        return self._schedule.at(self._i, self.now, kind)

    def _strikes(self, kind: str) -> bool:
        return sum(f.strikes() for f in self._active(kind)) > 0  # every fault draws


class FaultyLink(Link):
    """A link whose packets pass a `FaultyLine`; counts the packets really put on the wire."""

    def __init__(self, endpoint: Endpoint, codec: Codec, line: FaultyLine) -> None:
        super().__init__(endpoint, codec)
        self.line = line

    def send_packets(self, packets: Iterable[bytes]) -> None:
        """Send what the line lets through, and what the line adds."""
        carried = [p for data in packets for p in self.line.carry(data, to_companion=True)]
        super().send_packets(carried + self.line.noise())

    def receive(self, renew: bool = True) -> list[Received]:
        """Return what the line lets through; all packets that arrived are counted."""
        return [r for data in self.receive_packets() for r in self._hear(data)]

    def receive_packets(self) -> Iterator[bytes]:
        """Yield what the line lets through; all packets that arrived are counted."""
        for data in super().receive_packets():
            yield from self.line.carry(data, to_companion=False)
        yield from self.line.attack_vehicle()


class FaultyTelemetry:
    """Alters, delays or drops the telemetry of drone i's autopilot."""

    def __init__(self, schedule: Schedule, i: int) -> None:
        self._schedule, self._i = schedule, i
        self._late: deque[tuple[float, Message]] = deque()

    def alter(self, now: float, messages: list[Message]) -> list[Message]:
        """Return the messages that are sent at `now` [s of the flight]."""
        out = [a for m in messages for a in self._one(now, m)]
        while self._late and self._late[0][0] <= now:
            out.append(self._late.popleft()[1])
        for fault in self._schedule.at(self._i, now, "timesync_jump"):
            out.append(TimeSync(0, round((now + fault.value) * 1e9)))
        return out

    def _one(self, now: float, m: Message) -> list[Message]:
        if isinstance(m, SystemTime):
            jump = sum(f.value for f in self._at(now, "clock_jump"))
            return [replace(m, unix_time=max(m.unix_time + jump, 0.0))]
        if not isinstance(m, Attitude | LocalPosition | Odometry):
            return [m]
        lost = isinstance(m, LocalPosition | Odometry) and self._at(now, "position_lost")
        if lost or self._at(now, "telemetry_stale"):
            return []
        wrong = self._wrong(now, m)
        if ahead := sum(f.value for f in self._at(now, "stamps")):
            wrong = replace(wrong, time=max(wrong.time + ahead, 0.0))
        if late := self._at(now, "telemetry_late"):
            self._late.append((now + late[0].value, wrong))
            return []
        return [wrong]

    def _wrong(self, now: float, m: _Own) -> _Own:
        for fault in self._at(now, "telemetry_nan"):
            if not isinstance(m, Odometry) and fault.strikes():
                m = _not_a_number(m, fault.rng)
        if isinstance(m, Attitude | Odometry):
            for fault in self._at(now, "quaternion"):
                m = replace(m, q_wb=m.q_wb * fault.value)
        return m

    def _at(self, now: float, kind: str) -> list[Fault]:
        return self._schedule.at(self._i, now, kind)


def foreign(rng: np.random.Generator, system: int) -> bytes:
    """Return a heartbeat of another system, or of another component of this system."""
    other = int(rng.integers(1, 256))
    component = int(rng.integers(2, 191)) if other == system else int(rng.integers(1, 256))
    heartbeat = Heartbeat(12, 2, bool(rng.integers(2)), int(rng.integers(1 << 32)), 4)
    return Codec(other, component).encode([heartbeat])


def _flip(data: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(data)
    for bit in rng.integers(0, 8 * len(data), rng.integers(1, _FLIPS + 1)):
        changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def _not_a_number(
    m: Attitude | LocalPosition, rng: np.random.Generator
) -> Attitude | LocalPosition:
    """Return the message with one of its numbers NaN, infinite or denormal."""
    names = ("q_wb", "omega") if isinstance(m, Attitude) else ("p", "v")
    name = names[rng.integers(2)]
    values = getattr(m, name).copy()
    values[rng.integers(len(values))] = _NOT_NUMBERS[rng.integers(len(_NOT_NUMBERS))]
    changed: dict[str, Any] = {name: values}
    return replace(m, **changed)
