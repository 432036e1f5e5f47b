"""The pace of ticks: their clock, and the greeting to a vehicle that sends only HEARTBEAT."""

import itertools
import os
import time

import numpy as np
import pytest

from companion.process import pace as pace_module
from companion.process.pace import ClockPace
from companion.process.time_requests import TimeRequests
from mavlink_bridge.autopilots.ardupilot import ArduPilot
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.messages import (
    Attitude,
    Heartbeat,
    Received,
    Source,
    SystemTime,
    TimeSync,
)
from mavlink_bridge.wire.udp import UdpEndpoint
from mavlink_bridge.wire.video import Frame
from tests.companion.patience import PATIENCE

AUTOPILOT = "ardupilot"  # of the emulated vehicles
LEVEL = np.array([1.0, 0, 0, 0])


class NoFrames:
    """A camera that never has a frame."""

    def __init__(self):
        self._end, self._other = os.pipe()

    def fileno(self):
        return self._end

    def waits(self, timeout=0.0):
        return False


@pytest.fixture
def wire_ends():
    """A companion's link and its vehicle's endpoint, closed after the test."""
    link = Link(UdpEndpoint(local=("127.0.0.1", 0)), Codec(1, 191, [Source(1, 1)]))
    vehicle = UdpEndpoint(remote=("127.0.0.1", link.endpoint.port))
    yield link, vehicle
    link.close()
    vehicle.close()


def test_a_vehicle_that_sends_only_heartbeats_is_asked_for_streams(wire_ends):
    link, vehicle = wire_ends
    wire, streams, said = Codec(1, 1), ArduPilot(1).request_streams(), []
    pace = ClockPace(link, NoFrames(), 0.1, Source(1, 1), streams)
    until = time.monotonic() + PATIENCE

    def hear():
        said.extend(r.message for data in vehicle.receive() for r in wire.decode_datagram(data))
        return [m for m in said if not isinstance(m, TimeSync)]

    def stopped():
        vehicle.send(wire.encode([Heartbeat(3, 2, False, 4, 4)]))
        if hear():
            vehicle.send(wire.encode([Attitude(5.0, LEVEL, np.zeros(3))]))
        return time.monotonic() > until

    inputs = pace.next(stopped)
    assert inputs is not None
    assert 5.0 <= inputs.time < 6.0
    asked = hear()  # more than once where the machine was slow to answer
    assert asked[: len(streams)] == streams
    assert pace.next(stopped) is not None
    assert hear() == asked  # once it has answered it is the phases that ask


def test_an_emulated_ardupilot_starts_on_the_clock(world, start_daemon):
    config = world.config(1)
    config.write_text(
        config.read_text().replace("system_id: 1", f"system_id: 1, autopilot: {AUTOPILOT}")
    )
    daemon = start_daemon(config)
    assert daemon.listen(PATIENCE, until="READY=1"), daemon.log()


VEHICLE = Source(1, 1)


class ScriptedPace(ClockPace):
    """A pace whose messages come by a script: its clock, its telemetry, its answers.

    clock: the vehicle's time [s] at a local time [s]. now: local time.
    """

    def __init__(self, monkeypatch, clock, answers=True):
        self.now, self._next, self.clock, self.sent = 1000.0, 1000.0, clock, []
        monkeypatch.setattr(pace_module.time, "monotonic", lambda: self.now)
        super().__init__(self, NoFrames(), 0.1, VEHICLE)
        self._answers, self._waiting = answers, []

    def send(self, messages):
        self.sent += messages
        for m in messages:
            if self._answers and isinstance(m, TimeSync) and m.tc1 == 0:
                answer = TimeSync(round(self.clock(self.now + 0.002) * 1e9), m.ts1)
                self._waiting.append((self.now + 0.004, answer))

    def _take_in(self, timeout, renew=False):
        """Let time pass up to `timeout`, or the next message, which comes 3 ms late."""
        until = self.now + max(timeout, 1e-4)
        self.now = min([until, self._next, *(at for at, _ in self._waiting)])
        came = [m for at, m in self._waiting if at <= self.now]
        self._waiting = [w for w in self._waiting if w[0] > self.now]
        if self.now >= self._next:
            came.append(Attitude(round(self.clock(self.now - 0.003), 3), LEVEL, np.zeros(3)))
            self._next += 0.02
        received = [Received(VEHICLE, m) for m in came]
        self._hear_clock(received)
        return received

    def ticks(self, count):
        """The local time and the inputs of the next ticks."""
        return [(self.now, inputs) for inputs in (self.next(lambda: False) for _ in range(count))]


@pytest.mark.row("31")
@pytest.mark.parametrize("rate", [0.5, 0.8, 1.0, 1.05, 2.0])
def test_ticks_follow_the_rate_of_the_vehicles_clock(rate, monkeypatch, note):
    pace = ScriptedPace(monkeypatch, lambda t: 7.0 + rate * (t - 1000.0))
    pace.ticks(25)
    ticks = []
    for _ in range(100):
        inputs = pace.next(lambda: False)
        ticks.append((pace.now, inputs))
    (first, one), (last, other) = ticks[0], ticks[-1]
    assert other.time - one.time == pytest.approx(99 * 0.1)
    assert last - first == pytest.approx(99 * 0.1 / rate, rel=1e-3)
    assert pace.misses == 0
    off = [abs(7.0 + rate * (now - 1000.0) - inputs.time) for now, inputs in ticks]
    assert max(off) < 0.003
    assert all(i.time <= i.latest <= i.time + 0.01 for _, i in ticks)
    assert other.clock.bounded
    note(f"s off, clock at {rate:g}", max(off))


def test_a_frame_is_dated_by_offset_and_rate(monkeypatch):
    pace = ScriptedPace(monkeypatch, lambda t: 7.0 + 0.8 * (t - 1000.0))
    assert pace._dated(Frame(1000.0, local=True)) is None
    pace.ticks(30)
    taken = pace.now - 0.1
    dated = pace._dated(Frame(taken, local=True))
    assert not dated.local
    assert dated.time == pytest.approx(7.0 + 0.8 * (taken - 1000.0), abs=0.003)
    assert pace._dated(Frame(8.0)).time == 8.0


def test_a_jump_is_followed_by_the_next_ticks(monkeypatch):
    pace = ScriptedPace(monkeypatch, lambda t: t + 3600.0 * (t > 1005.0))
    times = [inputs.time for _, inputs in pace.ticks(80)]
    (jump,) = [b - a for a, b in itertools.pairwise(times) if b - a > 1.0]
    assert jump == pytest.approx(3600.1, abs=0.15)
    assert pace.ticks(1)[0][1].clock.jumps == 1


def test_the_vehicle_is_asked_for_its_time_and_told_ours(monkeypatch):
    pace = ScriptedPace(monkeypatch, lambda t: t - 990.0)
    pace.ticks(21)
    asked = [m for m in pace.sent if m.tc1 == 0]
    assert 7 <= len(asked) <= 9  # in two seconds
    assert asked[0].ts1 == pytest.approx(1000.0e9, rel=1e-4)
    pace._hear_clock([Received(VEHICLE, TimeSync(0, 12345))])
    assert pace.sent[-1] == TimeSync(round(pace.now * 1e9), 12345)


def test_only_answers_to_open_requests_count():
    requests = TimeRequests()
    (request,) = requests.due(10.0)
    assert requests.due(10.1) == []
    assert requests.sent(TimeSync(5, request.ts1 + 1), 10.1) is None
    assert requests.sent(TimeSync(5, request.ts1), 10.1) == pytest.approx(10.0)
    assert requests.sent(TimeSync(5, request.ts1), 10.1) is None  # once
    (late,) = requests.due(10.3)
    assert requests.sent(TimeSync(5, late.ts1), 11.5) is None


def test_what_waited_to_be_read_sets_the_clock_by_when_it_arrived(wire_ends):
    link, vehicle = wire_ends
    wire, pace = Codec(1, 1), ClockPace(link, NoFrames(), 0.1, VEHICLE)
    began = time.monotonic()
    for n in range(12):  # sent at the vehicle's time 5.0 + n / 10, and all read at the end
        vehicle.send(wire.encode([Attitude(5.0 + n / 10, LEVEL, np.zeros(3))]))
        time.sleep(max(began + (n + 1) / 10 - time.monotonic(), 0.0))
    pace._take_in(0.0, renew=True)
    clock = pace._clock.estimate
    assert clock.measured
    assert clock.rate == pytest.approx(1.0, abs=0.02)
    assert clock.vehicle(began) == pytest.approx(5.0, abs=0.02)
    assert link.stamps


def test_the_vehicle_gets_no_answer_that_is_too_late_to_tell_it_the_time():
    requests = TimeRequests()
    assert requests.reply(TimeSync(0, 7), 10.0, 0.005) == [TimeSync(10_000_000_000, 7)]
    assert requests.reply(TimeSync(0, 7), 10.0, 0.01) == []
    assert requests.reply(TimeSync(3, 7), 10.0, 0.0) == []


def test_only_the_vehicle_sets_the_clock():
    pace = ClockPace(None, None, 0.1, VEHICLE)
    vehicle = Attitude(time.monotonic() - 1000.0, LEVEL, np.zeros(3))
    pace._hear_clock([Received(VEHICLE, vehicle)])
    known = pace._clock.estimate
    others = [Source(255, 190), Source(2, 1), Source(1, 191)]
    pace._hear_clock([Received(s, SystemTime(time.monotonic() + 4e3)) for s in others * 3])
    assert pace._clock.estimate == known
