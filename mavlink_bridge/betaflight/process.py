"""The bridge's process: two lines, one clock, and what the person at the console is told."""

from __future__ import annotations

import select
import sys
import time
from collections.abc import Callable, Iterator

from mavlink_bridge.betaflight import msp
from mavlink_bridge.betaflight.bridge import BetaflightBridge, BridgeTimes
from mavlink_bridge.betaflight.config import BridgeConfig
from mavlink_bridge.betaflight.controller import Controller, interview
from mavlink_bridge.betaflight.msp import Msp, MspDecoder, MspError, Reply
from mavlink_bridge.betaflight.polling import POLLED
from mavlink_bridge.wire.bytestream import ByteStream
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link, open_endpoint
from mavlink_bridge.wire.messages import Message, RateSetpoint, StatusText

_CYCLE = 0.025  # s between RC frames; a new setpoint goes out at once
_POLL = 0.014  # s between questions, never two at a time: Betaflight answers 100 a second
_POLL_LOST = 0.1  # s after which a question counts as lost
_ANSWER = 0.5  # s for one answer of the interview
_INTERVIEW = 15.0  # s until the controller must be there


class MspLine:
    """MSP over a byte stream."""

    def __init__(self, stream: ByteStream) -> None:
        self.stream = stream
        self._decoder = MspDecoder()

    def receive(self) -> Iterator[Reply]:
        """Answers that wait."""
        for data in self.stream.receive():
            yield from self._decoder.decode(data)

    def ask(self, command: Msp) -> bytes | None:
        """The answer to one command; None where none came in time."""
        self.stream.send(msp.encode(command))
        end = time.monotonic() + _ANSWER
        while (left := end - time.monotonic()) > 0.0:
            select.select([self.stream], [], [], min(left, 0.05))
            for reply in self.receive():
                if reply.command == command and not reply.refused:
                    return reply.payload
        return None


def open_controller(name: str) -> MspLine:
    """The line to the controller, `serial:DEVICE:BAUD` or `tcp:HOST:PORT`.

    Raises:
        EndpointError: no such device.
    """
    endpoint = open_endpoint(name)
    assert isinstance(endpoint, ByteStream)
    return MspLine(endpoint)


def meet(line: MspLine, patience: float = _INTERVIEW) -> Controller:
    """Interview the controller, once it answers.

    Raises:
        MspError: it does not, or is not fit to be flown.
    """
    end = time.monotonic() + patience
    while True:
        if line.ask(Msp.API_VERSION) is not None:
            return interview(line.ask)
        if time.monotonic() > end:
            why = line.stream.problem or f"{line.stream.name}: open, but nobody speaks MSP"
            raise MspError(f"no flight controller: {why}")


class BridgeLoop:
    """Runs one bridge until told to stop."""

    def __init__(self, config: BridgeConfig, line: MspLine, controller: Controller) -> None:
        system = config.link.system_id
        self._line = line
        self._links = [
            Link(open_endpoint(name), Codec(system, 1))
            for name in (config.link.endpoint, config.link.ground, config.link.gps)
            if name
        ]
        self._listeners = self._links[: 1 + bool(config.link.ground)]  # the GPS only speaks
        self._bridge = BetaflightBridge(
            system,
            controller,
            config.thrust_map,
            config.angle_limit,
            BridgeTimes(setpoint=config.setpoint_timeout),
        )
        self._asked = self._cycled = -1.0
        self._waiting = False
        self._said_problem = ""

    def run(self, stopped: Callable[[], bool]) -> None:
        """Until `stopped()`; the last thing sent is level sticks."""
        while not stopped():
            self._wait()
            now = time.monotonic()
            fresh = self._take_in(now)
            if fresh or now - self._cycled >= _CYCLE:
                self._cycled = now
                out = self._bridge.cycle(now)
                if out.rc:
                    self._line.stream.send(out.rc)
                self._tell(out.messages)
            self._poll(now)
        if parting := self._bridge.parting():
            self._line.stream.send(parting)
        self.close()

    def close(self) -> None:
        """Release both lines."""
        self._line.stream.close()
        for link in self._links:
            link.close()

    def _wait(self) -> None:
        due = min(self._cycled + _CYCLE, self._asked + (_POLL_LOST if self._waiting else _POLL))
        files = [self._line.stream, *(link.endpoint for link in self._links)]
        select.select(files, [], [], min(max(due - time.monotonic(), 0.0), _CYCLE))

    def _take_in(self, now: float) -> bool:
        """Both sides' messages; True where a setpoint came."""
        fresh = False
        for reply in self._line.receive():
            self._waiting &= reply.command != Msp.MULTIPLE_MSP
            self._bridge.read(now, reply)
        for link in self._links:
            for received in link.receive():
                self._bridge.receive(now, received)
                fresh |= isinstance(received.message, RateSetpoint)
        if self._line.stream.problem != self._said_problem:
            self._said_problem = self._line.stream.problem
            print(self._said_problem or f"{self._line.stream.name}: back", file=sys.stderr)
        return fresh

    def _poll(self, now: float) -> None:
        if now - self._asked >= (_POLL_LOST if self._waiting else _POLL):
            self._asked = now
            self._waiting = self._line.stream.send(msp.several(POLLED))

    def _tell(self, messages: list[Message]) -> None:
        for message in messages:
            if isinstance(message, StatusText):
                print(message.text, file=sys.stderr, flush=True)
        for link in self._listeners:
            link.send(messages)
