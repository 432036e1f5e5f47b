"""What a daemon and an in-process flight do at each tick: send, count, log."""

import shutil

import pytest

from companion.flightlog.reader import read_log
from companion.flightlog.recorder import Recorder
from companion.process.session import Session
from companion.tick import Tick, TickInputs
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.memory import MemoryEndpoint
from mavlink_bridge.wire.messages import Heartbeat, RateSetpoint
from tests.companion.ticks import config, tick

SETPOINT = RateSetpoint(1.0, [0.1, 0.2, 0.3], 0.5, 1)


class Stub:
    """A companion that sends a setpoint at every tick, or nothing."""

    def __init__(self, silent=False):
        self.silent = silent

    def tick(self, inputs):
        return Tick(inputs.time, setpoint=None if self.silent else SETPOINT)


class Wire:
    """A session on one end of a wire, a vehicle on the other."""

    def __init__(self, silent=False):
        vehicle = MemoryEndpoint()
        self.vehicle, self.codec = vehicle, Codec(1, 1)
        self.link = Link(MemoryEndpoint(vehicle), Codec(1, 191))
        self.session = Session(Stub(silent), self.link, lambda: 4)

    def fly(self, n):
        """The n-th tick, after a heartbeat; whether something was sent, and what the log said."""
        self.vehicle.send(self.codec.encode([Heartbeat(12, 2, True, 0, 4)]))
        inputs = TickInputs(round(0.1 * n, 3), self.link.receive(), None)
        made, sent = self.session.tick(inputs)
        return sent, self.session.log(inputs, made)

    def heard(self):
        return [r.message for data in self.vehicle.receive() for r in self.codec.decode(data)]


@pytest.fixture
def wire():
    return Wire()


def test_a_tick_sends_and_counts(wire):
    assert wire.fly(1) == (True, None)
    assert [type(m) for m in wire.heard()] == [RateSetpoint]
    counters = wire.session.counters()
    assert counters["deadline_misses"] == 4
    assert (counters["received"], counters["sent"]) == (1, 1)


def test_a_tick_without_a_setpoint_sends_nothing():
    assert Wire(silent=True).fly(1) == (False, None)


def test_each_tick_is_logged_with_its_packets_and_costs(wire, tmp_path):
    path = tmp_path / "flight.mcap"
    wire.session.open_log(Recorder(config(path), path))
    for n in range(3):
        assert wire.fly(n) == (True, None)
    wire.session.close_log()
    log = read_log(path)
    assert [t["time"] for t in log.ticks] == [0.0, 0.1, 0.2]
    assert all(len(inputs.datagrams) == 1 for inputs in log.inputs)  # what came, not what was sent
    assert log.ticks[0]["stages_ms"]["log"] == 0.0  # the cost of logging is that of the tick before
    assert all(t["stages_ms"]["tick"] > 0.0 for t in log.ticks)
    assert log.ticks[2]["stages_ms"]["log"] > 0.0
    assert log.ticks[2]["counters"]["sent"] == 3
    assert path.with_suffix(".tlog").stat().st_size > 0


def test_a_log_that_fails_is_told_once_and_the_flight_goes_on(wire, tmp_path):
    path = tmp_path / "flight.mcap"
    recorder = Recorder(config(path), path)
    wire.session.open_log(recorder)
    assert wire.fly(0) == (True, None)
    recorder._file.close()
    recorder._file = recorder._writer._file = open("/dev/full", "wb", 0)  # noqa: SIM115, PTH123
    told = [wire.fly(n) for n in range(1, 12)]
    assert all(sent for sent, _ in told)
    problems = [problem for _, problem in told if problem]
    assert len(problems) == 1
    assert "No space left" in problems[0]
    assert wire.session.recorder is None
    assert wire.link.tap is None  # nothing is gathered for a log that is gone


def test_a_log_that_is_removed_is_told_once_and_the_flight_goes_on(wire, tmp_path):
    path = tmp_path / "logs" / "flight.mcap"
    path.parent.mkdir()
    wire.session.open_log(Recorder(config(path), path))
    assert wire.fly(0) == (True, None)
    shutil.rmtree(path.parent)
    told = [wire.fly(n) for n in range(1, 12)]
    assert all(sent for sent, _ in told)
    assert [problem for _, problem in told if problem] == [f"flight log ended: {path} was removed"]
    assert wire.session.recorder is None
    assert not path.parent.exists()


def test_without_a_log_a_session_flies(wire):
    inputs, made = tick(1)
    assert wire.session.log(inputs, made) is None
    wire.session.close_log()
