"""The pace of ticks: when a tick falls due, and its inputs.

`ClockPace`: every period of the vehicle's clock, free-running; the clock's offset and rate against
CLOCK_MONOTONIC are estimated. `FramePace`: when a frame comes, for senders that wait for the
answer. Both give the pipeline the same kind of inputs, so that it cannot tell them apart.
"""

from __future__ import annotations

import math
import select
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

from companion.estimation.vehicle_clock import ClockEstimate, VehicleClock
from companion.process.frame_source import FrameSource
from companion.process.rest import BETWEEN, Rest
from companion.process.time_requests import TimeRequests
from companion.tick import TickInputs
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.messages import (
    Attitude,
    LocalPosition,
    Message,
    Odometry,
    Received,
    Source,
    SystemTime,
    TimeSync,
)
from mavlink_bridge.wire.video import Answer, Frame, VideoError

_PATIENCE = 1.0  # s that a frame waits for telemetry announced but not arrived
_POLL = 0.2  # s between two looks at the stop flag
_GREET = 1.0  # s between greetings


class Pace(Protocol):
    """Says when the next tick is due; misses: deadlines missed so far."""

    misses: int

    def next(self, stopped: Callable[[], bool]) -> TickInputs | None:
        """Block until a tick is due; return its inputs, None when there will be no more."""
        ...

    def done(self, inputs: TickInputs, landed: bool) -> None:
        """Answer the frame of a tick whose messages are sent."""
        ...


class FramePace:
    """One tick for each frame, with exactly the telemetry that was sent before the frame."""

    def __init__(self, link: Link, frames: FrameSource) -> None:
        self.misses = 0
        self._link = link
        self._frames = frames

    def next(self, stopped: Callable[[], bool]) -> TickInputs | None:
        """Return the next frame and all telemetry before it; None when the sender hung up."""
        try:
            while not self._frames.waits(_POLL):
                if stopped():
                    return None
            frame = self._frames.receive()
        except VideoError:
            return None
        received = self._link.receive()
        deadline = time.monotonic() + _PATIENCE
        while self._link.packets_in < frame.packets and time.monotonic() < deadline:
            self._link.wait(0.05)
            received += self._link.receive(renew=self._link.spent)
        if self._link.packets_in < frame.packets:
            self.misses += 1
            self._link.packets_in = frame.packets  # lost for good: do not wait again
        return TickInputs(frame.time if frame.due is None else frame.due, received, frame)

    def done(self, inputs: TickInputs, landed: bool) -> None:
        """Answer the frame, also where no setpoint was sent."""
        try:
            self._frames.answer(Answer(inputs.time, self._link.packets_out, landed))
        except VideoError:
            return  # the next receive ends the daemon in an orderly way


@dataclass
class _Read:
    """Messages of one reading, and its packets as the log is told of them: (sent, bytes)."""

    received: list[Received] = field(default_factory=list)
    packets: list[tuple[bool, bytes]] = field(default_factory=list)


class ClockPace:
    """One tick every `period` [s] of the vehicle's clock; a late tick is counted, not repeated.

    Where the vehicle's clock runs at another rate, so do the ticks. It is asked for its time by
    TIMESYNC, and told ours. vehicle: the source of the clock. greeting: sent each second until that
    clock is known, for vehicles that send nothing but HEARTBEAT before they are asked. rest: says
    which ticks are left out while the drone waits on the ground; None: none. Then what comes waits
    for the next reading, once a period, where the link dates it by when it arrived; a serial or TCP
    line does not, so that it is read as it comes.
    """

    def __init__(
        self,
        link: Link,
        frames: FrameSource,
        period: float,
        vehicle: Source,
        greeting: Sequence[Message] = (),
        rest: Rest | None = None,
    ) -> None:
        self.misses = 0
        self._link = link
        self._vehicle = vehicle
        self._greeting = greeting
        self._greeted = -math.inf
        self._frames: FrameSource | None = frames
        self._period = period
        self._clock = VehicleClock()
        self._requests = TimeRequests()
        self._rest = rest or Rest(period, vehicle, arms=True)
        self._line: ClockEstimate | None = None  # of the clock, as of the last tick
        self._kept: _Read | None = None  # for the next tick
        self._due: float | None = None
        self._frame: Frame | None = None

    def next(self, stopped: Callable[[], bool]) -> TickInputs | None:
        """Sleep until the next tick is due, and read what arrives; None when told to stop."""
        received = self._release()
        while not stopped():
            wait, local, clock = _POLL, time.monotonic(), self._estimate()
            if clock is None:
                self._greet()
            else:
                now = clock.vehicle(local)
                if self._due is None:
                    self._due = math.ceil(now / self._period) * self._period
                if now >= self._due:
                    if (inputs := self._tick(now, received)) is not None:
                        return inputs
                    continue
                if request := self._requests.due(local, *[BETWEEN] * self._rest.on):
                    self._link.send(request)
                wait = min(clock.local(self._due) - local, _POLL)
            if (self._rest.on and self._link.stamps and clock is not None) or self._kept:
                time.sleep(max(wait, 0.0))
                continue
            received += self._read(wait)
            if self._kept and clock is not None and self._due is not None:
                now = clock.vehicle(time.monotonic())
                self._due = min(self._due, math.ceil(now / self._period) * self._period)
        return None

    def _read(self, timeout: float, renew: bool = False) -> list[Received]:
        """Return what `_take_in` does; what ends a rest is kept for the tick after the next.

        It is kept with its bytes, which the log of that tick has to show.
        """
        if not self._rest.on:
            return self._take_in(timeout, renew)
        read, tap = _Read(), self._link.tap
        self._link.tap = None if tap is None else lambda *packet: read.packets.append(packet)
        try:
            read.received = self._take_in(timeout, renew)
        finally:
            self._link.tap = tap
        self._kept = read
        if self._rest.news(read.received):
            self._rest.end()
            return []
        return self._release()

    def _release(self) -> list[Received]:
        """Return what was kept, and show its bytes to the log."""
        read, self._kept = self._kept, None
        if read is None:
            return []
        if self._link.tap is not None:
            for packet in read.packets:
                self._link.tap(*packet)
        return read.received

    def _estimate(self) -> ClockEstimate | None:
        """Return the line of the clock; at rest that of the last tick is good enough."""
        if self._line is None or not self._rest.on:
            self._line = self._clock.estimate
        return self._line

    def _greet(self) -> None:
        now = time.monotonic()
        if now - self._greeted >= _GREET:
            self._greeted = now
            self._link.send(self._greeting)

    def done(self, inputs: TickInputs, landed: bool) -> None:
        """Answer the frame, whose sender may count the answers."""
        if self._frames is not None and inputs.frame is not None:
            try:
                self._frames.answer(Answer(inputs.frame.time, self._link.packets_out, landed))
            except VideoError:
                self._frames = None

    def _tick(self, now: float, received: list[Received]) -> TickInputs | None:
        """Return the inputs of the tick that is due; None where it is left out."""
        assert self._due is not None
        late = int((now - self._due) / self._period)
        self.misses += late
        due = self._due + late * self._period
        self._due = due + self._rest.step * self._period
        if self._kept is None:
            received += self._read(0.0, renew=True)
        if self._rest.may_leave_out():
            return None
        if self._kept and self._due is not None:  # else the clock has jumped
            self._due = due + self._period
        clock = self._line = self._clock.estimate
        assert clock is not None
        latest = round(clock.vehicle(time.monotonic()) + clock.doubt, 6)
        return TickInputs(
            round(due, 6), received, self._frame, latest=max(latest, due), clock=clock
        )

    def _take_in(self, timeout: float, renew: bool = False) -> list[Received]:
        """Wait up to `timeout` [s] for telemetry or a frame; keep only the newest frame.

        renew: as once a tick, see `Link.receive`. A link on which too much came is left alone until
        then.
        """
        renew |= self._due is None
        sources: list[Link | FrameSource] = []
        if renew or not self._link.spent:
            sources.append(self._link)
        if self._frames is not None:
            sources.append(self._frames)
        files = [s.endpoint.fileno() if isinstance(s, Link) else s.fileno() for s in sources]
        ready, _, _ = select.select(files, [], [], max(timeout, 0.0))
        try:
            while self._frames is not None and self._frames.fileno() in ready:
                self._frame = self._dated(self._frames.receive())
                if not self._frames.waits():
                    break
        except VideoError:
            self._frames = None
        if not renew and self._link.endpoint.fileno() not in ready:
            return []
        received = self._link.receive(renew)
        self._hear_clock(received)
        return received

    def _dated(self, frame: Frame) -> Frame | None:
        """Return the frame in the vehicle's clock; None before that clock is known."""
        if not frame.local:
            return frame
        clock = self._clock.estimate
        return (
            None if clock is None else replace(frame, time=clock.vehicle(frame.time), local=False)
        )

    def _hear_clock(self, received: list[Received]) -> None:
        """Follow the vehicle's clock by its messages, and answer its own requests of the time."""
        now = time.monotonic()
        for r in received:
            if r.source != self._vehicle:
                continue
            m, arrived, jumped = r.message, now if r.arrived is None else r.arrived, False
            if isinstance(m, Attitude | LocalPosition | Odometry | SystemTime):
                jumped = self._clock.hear(arrived, m.time)
            elif isinstance(m, TimeSync):
                if (sent := self._requests.sent(m, arrived)) is not None:
                    jumped = self._clock.hear_answer(sent, m.tc1 * 1e-9, arrived)
                if reply := self._requests.reply(m, now, now - arrived):
                    self._link.send(reply)
            if jumped:  # or the vehicle has started anew
                self._due, self._frame, self._line = None, None, None
