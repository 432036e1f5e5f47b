"""The process of the bridge: an MSP line, MAVLink links, one clock, and lines on the console."""

from __future__ import annotations

import select
import sys
import time
from collections.abc import Callable, Iterator

from mavlink_bridge.betaflight import msp
from mavlink_bridge.betaflight.bridge import BetaflightBridge
from mavlink_bridge.betaflight.config import BridgeConfig
from mavlink_bridge.betaflight.controller import Controller, query_controller
from mavlink_bridge.betaflight.msp import Msp, MspDecoder, MspError, Reply
from mavlink_bridge.betaflight.polling import POLLED
from mavlink_bridge.betaflight.times import BridgeTimes
from mavlink_bridge.wire.bytestream import ByteStream
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.ids import ComponentId
from mavlink_bridge.wire.link import Link, open_endpoint
from mavlink_bridge.wire.messages import Message, RateSetpoint, StatusText

_CYCLE = 0.025  # s between RC frames; a new setpoint goes out at once
_POLL = 0.014  # s between requests, one at a time: Betaflight answers 100 a second
_POLL_LOST = 0.1  # s after which an unanswered request counts as lost
_ANSWER = 0.5  # s for one answer about the setup
_STARTUP = 15.0  # s until the controller must answer


class MspLine:
    """MSP over a byte stream."""

    def __init__(self, stream: ByteStream) -> None:
        self.stream = stream
        self._decoder = MspDecoder()

    def receive(self) -> Iterator[Reply]:
        """Yield the answers that have arrived."""
        for data in self.stream.receive():
            yield from self._decoder.decode(data)

    def query(self, command: Msp) -> bytes | None:
        """Return the answer to one command; None where it does not arrive in time."""
        self.stream.send(msp.encode(command))
        end = time.monotonic() + _ANSWER
        while (left := end - time.monotonic()) > 0.0:
            select.select([self.stream], [], [], min(left, 0.05))
            for reply in self.receive():
                if reply.command == command and not reply.refused:
                    return reply.payload
        return None


def open_controller(name: str) -> MspLine:
    """Open the line to the controller, `serial:DEVICE:BAUD` or `tcp:HOST:PORT`.

    Raises:
        EndpointError: no such device.
    """
    endpoint = open_endpoint(name)
    assert isinstance(endpoint, ByteStream)
    return MspLine(endpoint)


def wait_for_controller(line: MspLine, timeout: float = _STARTUP) -> Controller:
    """Return the controller's setup, as soon as it answers.

    Raises:
        MspError: the controller does not answer within `timeout` [s], or cannot fly.
    """
    end = time.monotonic() + timeout
    while True:
        if line.query(Msp.API_VERSION) is not None:
            return query_controller(line.query)
        if time.monotonic() > end:
            why = line.stream.problem or f"{line.stream.name}: open, but no MSP answer"
            raise MspError(f"no flight controller: {why}")


class BridgeLoop:
    """One bridge with its lines; `run` lasts until it is stopped."""

    def __init__(self, config: BridgeConfig, line: MspLine, controller: Controller) -> None:
        system = config.link.system_id
        self._line = line
        self._links = [
            Link(open_endpoint(name), Codec(system, ComponentId.AUTOPILOT1))
            for name in (config.link.endpoint, config.link.ground, config.link.gps)
            if name
        ]
        self._listeners = self._links[: 1 + bool(config.link.ground)]  # not the GPS receiver
        self._bridge = BetaflightBridge(
            system,
            controller,
            config.thrust_map,
            config.angle_limit,
            BridgeTimes(setpoint=config.setpoint_timeout),
        )
        self._polled_at = self._cycled_at = -1.0
        self._awaits_answer = False
        self._printed_problem = ""

    def run(self, stopped: Callable[[], bool]) -> None:
        """Run until `stopped()`, then send level sticks and close the lines."""
        while not stopped():
            self._wait()
            now = time.monotonic()
            new_setpoint = self._receive(now)
            if new_setpoint or now - self._cycled_at >= _CYCLE:
                self._cycled_at = now
                out = self._bridge.cycle(now)
                if out.rc:
                    self._line.stream.send(out.rc)
                self._send(out.messages)
            self._poll(now)
        if final := self._bridge.final_frame():
            self._line.stream.send(final)
        self.close()

    def close(self) -> None:
        """Close all lines."""
        self._line.stream.close()
        for link in self._links:
            link.close()

    @property
    def _poll_interval(self) -> float:
        return _POLL_LOST if self._awaits_answer else _POLL

    def _wait(self) -> None:
        due = min(self._cycled_at + _CYCLE, self._polled_at + self._poll_interval)
        files = [self._line.stream, *(link.endpoint for link in self._links)]
        select.select(files, [], [], min(max(due - time.monotonic(), 0.0), _CYCLE))

    def _receive(self, now: float) -> bool:
        """Pass everything that arrived to the bridge; return whether a setpoint is among it."""
        new_setpoint = False
        for reply in self._line.receive():
            self._awaits_answer &= reply.command != Msp.MULTIPLE_MSP
            self._bridge.read(now, reply)
        for link in self._links:
            for received in link.receive():
                self._bridge.receive(now, received)
                new_setpoint |= isinstance(received.message, RateSetpoint)
        if self._line.stream.problem != self._printed_problem:
            self._printed_problem = self._line.stream.problem
            print(self._printed_problem or f"{self._line.stream.name}: back", file=sys.stderr)
        return new_setpoint

    def _poll(self, now: float) -> None:
        if now - self._polled_at >= self._poll_interval:
            self._polled_at = now
            self._awaits_answer = self._line.stream.send(msp.several(POLLED))

    def _send(self, messages: list[Message]) -> None:
        for message in messages:
            if isinstance(message, StatusText):
                print(message.text, file=sys.stderr, flush=True)
        for link in self._listeners:
            link.send(messages)
