"""The vehicle on the link: its identity, streams and clock, and the parameters that matter."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field

import numpy as np

from companion.doctor.finding import Finding, Level, either, rated
from companion.doctor.signing import ANSWERS, examine_open, examine_unsigned, sign
from companion.doctor.silence import PARAMETERS, examine_silence
from companion.estimation.vehicle_clock import VehicleClock
from companion.process.time_requests import TimeRequests
from companion.process.vehicle_lock import VehicleLock, VehicleTaken
from companion.settings.config import CompanionConfig
from mavlink_bridge.autopilots.registry import Identity, adapter
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link, open_endpoint
from mavlink_bridge.wire.messages import (
    Attitude,
    Command,
    CommandId,
    Heartbeat,
    LocalPosition,
    Message,
    Odometry,
    ParamRequestRead,
    ParamValue,
    TimeSync,
)
from mavlink_bridge.wire.udp import EndpointError

_LISTEN, _SETTLE = 4.0, 1.5  # s on the link; of them until requested streams run
_STREAM_MIN = 20.0  # Hz of attitude and of position
_JITTER = (0.02, 0.06)  # s, spread of the delay of telemetry: green, amber
_RATE_OFF = (0.005, 1.0)  # any rate is followed; one that is off deserves a word
_CLOCK_DOUBT = (0.03, 0.1)  # s: green, amber
_VERSION, _INT32 = 148.0, 6
_COMPANION = Heartbeat(autopilot=8, vehicle_type=18, armed=False, custom_mode=0, system_status=3)
_HOVER = {"px4": "MPC_THR_HOVER", "ardupilot": "MOT_THST_HOVER"}


@dataclass
class Heard:
    """All messages of the vehicle, with their arrival (CLOCK_MONOTONIC)."""

    messages: list[tuple[float, Message]] = field(default_factory=list)
    requests: TimeRequests = field(default_factory=TimeRequests)
    clock: VehicleClock = field(default_factory=VehicleClock)

    def take(self, at: float, message: Message) -> None:
        """Remember a message; let the clock follow its stamp."""
        self.messages.append((at, message))
        if isinstance(message, Attitude | LocalPosition | Odometry):
            self.clock.hear(at, message.time)
        elif isinstance(message, TimeSync):
            sent = self.requests.sent(message, at)
            if sent is not None:
                self.clock.hear_answer(sent, message.tc1 * 1e-9, at)

    def of(self, kind: type, since: float = 0.0) -> list[tuple[float, Message]]:
        """Return the messages of one kind from `since` on."""
        return [(at, m) for at, m in self.messages if isinstance(m, kind) and at >= since]

    def parameter(self, name: str) -> float | None:
        """Return a parameter's value; PX4 sends integers as the bytes of the float."""
        for _, m in self.messages:
            if isinstance(m, ParamValue) and m.name == name:
                bytewise = m.param_type == _INT32 and abs(m.value) < 1e-30
                raw = struct.pack("<f", m.value)
                return float(struct.unpack("<i", raw)[0]) if bytewise else m.value
        return None


def examine(config: CompanionConfig, hover_known: bool) -> Iterator[Finding]:
    """Return all findings about the vehicle; hover_known: whether a file sets its hover thrust."""
    try:  # on a serial line each byte has one reader: a daemon that flies needs them all
        lock = VehicleLock(f"{config.link.endpoint}#{config.link.system_id}")
    except VehicleTaken as error:
        yield Finding("link", Level.RED, str(error), f"systemctl stop companion@{config.name}")
        return
    with closing(lock):
        yield from _on_the_link(config, hover_known)


def _on_the_link(config: CompanionConfig, hover_known: bool) -> Iterator[Finding]:
    try:
        link = Link(
            open_endpoint(config.link.endpoint),
            Codec(config.link.system_id, config.link.component_id),
        )
    except EndpointError as error:
        todo = f"is the daemon running? systemctl stop companion@{config.name}"
        yield Finding("link", Level.RED, str(error), todo)
        return
    unsigned: Finding | None = None
    try:
        if config.link.signing is not None:
            unsigned = examine_unsigned(config, link)
            if unsigned.level is Level.GREEN:  # else unsigned requests are answered
                sign(config, link)
        started = time.monotonic()
        heard = _listen(link, config)
    finally:
        link.close()
    if not heard.of(Heartbeat):
        todo = "power, wiring, baud rate; the autopilot's port must speak MAVLink 2"
        text = f"no heartbeat of system {config.link.system_id} on {config.link.endpoint}"
        yield Finding("link", Level.RED, text, todo)
        return
    if unsigned is None and any(heard.of(kind) for kind in ANSWERS):
        unsigned = examine_open(config)
    if unsigned is not None:
        yield unsigned
    yield _identity(config, heard)
    yield from _telemetry(heard, started + _SETTLE)
    yield from _clock(heard.clock)
    yield from _parameters(config, heard)
    yield _hover(config, heard, hover_known)


def _listen(link: Link, config: CompanionConfig) -> Heard:
    """Request everything that is examined, and gather the vehicle's messages."""
    system, kind, heard = config.link.system_id, config.link.autopilot, Heard()
    names = [_HOVER[kind], *PARAMETERS[kind]] if kind in _HOVER else []
    version = Command(CommandId.REQUEST_MESSAGE, (_VERSION, 0, 0, 0, 0, 0, 0), system)
    requests: list[Message] = [
        _COMPANION,
        *adapter(kind, system).request_streams(),
        version,
        *(ParamRequestRead(system, 1, name, -1) for name in names),
    ]
    deadline, ask = time.monotonic() + _LISTEN, 0.0
    while (now := time.monotonic()) < deadline:
        if now >= ask:
            link.send(requests)
            ask = now + 1.0
        link.send(heard.requests.due(now))
        link.wait(0.05)
        for r in link.receive():
            if (r.source.system, r.source.component) == (system, 1):
                heard.take(time.monotonic(), r.message)
    return heard


def _identity(config: CompanionConfig, heard: Heard) -> Finding:
    """Examine whether the vehicle is the one of the configuration, and fit to fly."""
    identity = Identity(config.link.autopilot, config.link.system_id)
    identity.hear(m for _, m in heard.messages)
    wrong = identity.inhibit_reason()
    told = f"{config.link.autopilot} {identity.version or '(no version)'}"
    return either("vehicle", not wrong, wrong or told, "correct link.autopilot, or the vehicle")


def _telemetry(heard: Heard, since: float) -> Iterator[Finding]:
    """Examine the rates of the streams, and how evenly they come."""
    span = _LISTEN - _SETTLE
    for kind, name in ((Attitude, "attitude"), (LocalPosition, "position")):
        # Odometry takes the place of a stream that a vehicle does not send.
        rate = max(len(heard.of(k, since)) for k in (kind, Odometry)) / span
        todo = (
            "no estimate yet: wait for GPS or flow" if not rate else "a faster link, fewer streams"
        )
        text = f"{rate:.0f} Hz, {_STREAM_MIN:.0f} wanted"
        yield rated(f"{name} rate", -rate, (-_STREAM_MIN, -10.0), text, todo)
    clock = heard.clock.estimate
    if clock is None:
        return
    late = [
        clock.vehicle(at) - m.time
        for kind in (Attitude, Odometry)
        for at, m in heard.of(kind, since)
        if isinstance(m, Attitude | Odometry)
    ]
    if len(late) > 1:
        jitter = float(np.percentile(late, 95) - min(late))
        text = f"telemetry comes within {jitter * 1e3:.0f} ms (95 %)"
        yield rated("latency", jitter, _JITTER, text, "a faster link, or a less busy board")


def _clock(clock: VehicleClock) -> Iterator[Finding]:
    """Examine the rate of the vehicle's clock, and how well its offset is known."""
    known = clock.estimate
    if known is None or not known.measured:
        return
    off, doubt = abs(known.rate - 1.0), known.doubt
    text = f"{known.rate:.4f} ±{known.rate_doubt:.4f} times this board's"
    todo = "a simulator that is not in real time? an overloaded board?"
    if off > known.rate_doubt:
        yield rated("clock rate", off, _RATE_OFF, text, todo)
    else:
        yield Finding("clock rate", Level.GREEN, text)
    by = "" if known.bounded else "; the vehicle does not answer TIMESYNC"
    text = f"the vehicle's time is known to ±{doubt * 1e3:.0f} ms{by}"
    yield rated("clock", doubt, _CLOCK_DOUBT, text, "a faster link")


def _parameters(config: CompanionConfig, heard: Heard) -> Iterator[Finding]:
    """Examine what the vehicle does when the companion falls silent."""
    kind = config.link.autopilot
    if kind not in PARAMETERS:
        text = "`mavlink-bridge betaflight --check` shows failsafe and override of a controller"
        yield Finding("silence", Level.AMBER, text, "run it")
        return
    yield from examine_silence(kind, heard.parameter, config.fence.altitude_max)


def _hover(config: CompanionConfig, heard: Heard, known: bool) -> Finding:
    """Examine the hover thrust: set in a file, and near the autopilot's own value."""
    mine = config.airframe.hover_thrust
    theirs = heard.parameter(_HOVER.get(config.link.autopilot, ""))
    todo = "hover in altitude hold, read the thrust off, write it to airframe.hover_thrust"
    if not known:
        return Finding("hover thrust", Level.AMBER, f"{mine:g} is the built-in default", todo)
    if theirs is None:
        return Finding("hover thrust", Level.GREEN, f"{mine:g}")
    text = f"{mine:g}; the autopilot says {theirs:g}"
    return rated("hover thrust", abs(mine - theirs), (0.08, 0.2), text, todo)
