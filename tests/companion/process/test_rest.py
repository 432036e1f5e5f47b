"""When a waiting daemon ticks less, what ends that, and what it reads meanwhile."""

import os
import signal
import threading
import time
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.vehicle import VehicleEstimate
from companion.process.pace import ClockPace
from companion.process.rest import Rest
from companion.supervision.guard import Reason, Verdict
from companion.supervision.supervision import Supervised
from companion.tick import Tick
from companion.types import Phase
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.messages import (
    Attitude,
    Command,
    Heartbeat,
    RateCommand,
    Received,
    Source,
    StatusText,
    TimeSync,
    VehicleState,
)
from mavlink_bridge.wire.udp import UdpEndpoint
from tests.companion.patience import PATIENCE
from tests.companion.process.test_pace import NoFrames

PERIOD = 0.1
VEHICLE, GROUND = Source(1, 1), Source(255, 190)
LEVEL = np.array([1.0, 0, 0, 0])
WAITS = Heartbeat(12, 2, False, 0, 3)


def waiting(time=0.0, phase=Phase.WAIT, heartbeat=WAITS, v=0.0, omega=0.0, **vehicle):
    own = VehicleState(time, np.zeros(3), np.array([v, 0, 0]), LEVEL, np.array([0, 0, omega]))
    told = {"state": own, "age": 0.02, "heartbeat": heartbeat, "mode_known": True} | vehicle
    return Tick(time, vehicle=VehicleEstimate(**told), supervised=Supervised(phase))


def resting(arms=False, made=None):
    """A rest after six seconds of ticks."""
    rest = Rest(PERIOD, VEHICLE, arms)
    for n in range(60):
        rest.follow(made or waiting(n * PERIOD))
    return rest


def test_a_drone_rests_after_five_seconds_of_waiting():
    rest, on = Rest(PERIOD, VEHICLE, False), []
    for n in range(60):
        rest.follow(waiting(n * PERIOD))
        on.append(rest.on)
    assert on == [False] * 50 + [True] * 10


@pytest.mark.parametrize("phase", [Phase.DONE, Phase.PASSIVE])
def test_it_rests_after_its_flight_too_even_where_it_armed_by_itself(phase):
    assert resting(arms=True, made=waiting(phase=phase)).on


COMMANDED = Verdict(RateCommand(np.zeros(3), 9.8), Reason.PLAN, 0)
AWAKE = {
    "armed": waiting(heartbeat=replace(WAITS, armed=True)),
    "not heard": waiting(heartbeat=None),
    "silent": waiting(mode_known=False),
    "late": waiting(age=0.5),
    "no state": waiting(state=None),
    "carried": waiting(v=0.5),
    "turned": waiting(omega=0.2),
    "started anew": waiting(rebooted=True),
    "refuses": waiting(refusals=("no GPS",)),
    "arms": waiting(phase=Phase.ARM),
    "flies": waiting(phase=Phase.FLY),
    "a stage fails": replace(waiting(), failure="see: ValueError"),
    "commands": replace(waiting(), supervised=Supervised(Phase.WAIT, verdict=COMMANDED)),
}


@pytest.mark.parametrize("why", AWAKE)
def test_it_does_not_rest_where_anything_is_under_way(why):
    assert not resting(made=AWAKE[why]).on
    rest = resting()
    rest.follow(AWAKE[why])
    assert not rest.on


def test_a_companion_that_may_arm_by_itself_does_not_rest_before():
    assert not resting(arms=True).on


def test_of_five_looks_one_is_a_tick():
    rest = resting()
    assert [rest.may_leave_out() for _ in range(10)] == 2 * [True, True, True, True, False]
    assert rest.step == 2


def heard(message, source=VEHICLE):
    return [Received(VEHICLE, WAITS), Received(source, message)]


@pytest.mark.parametrize(
    "received",
    [
        heard(replace(WAITS, armed=True)),
        heard(replace(WAITS, custom_mode=7)),
        heard(Command(300, ()), GROUND),
        heard(StatusText(6, "to all"), GROUND),
    ],
)
def test_what_may_change_anything_ends_the_rest(received):
    rest = resting()
    assert rest.news(received)
    rest.end()
    rest.follow(waiting())
    assert not rest.on
    assert rest.step == 1


@pytest.mark.parametrize(
    "received",
    [
        heard(Attitude(1.0, LEVEL, np.zeros(3))),
        heard(StatusText(6, "hello")),
        heard(Heartbeat(8, 6, False, 0, 4), GROUND),
        heard(TimeSync(0, 5), GROUND),
    ],
)
def test_what_comes_all_the_time_does_not(received):
    rest = resting()
    assert not rest.news(received)


class Vehicle:
    """A vehicle that sends attitudes at 50 Hz and a heartbeat each second, on a thread."""

    def __init__(self, port):
        self.armed_at, self._over, self._arm = None, threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, args=(port,))
        self._thread.start()

    def arm(self):
        self._arm.set()

    def _run(self, port):
        wire, began = Codec(1, 1), time.monotonic()
        with closing(UdpEndpoint(remote=("127.0.0.1", port))) as endpoint:
            n = 0
            while not self._over.wait(max(began + n * 0.02 - time.monotonic(), 0.0)):
                said = [Attitude(5.0 + time.monotonic() - began, LEVEL, np.zeros(3))]
                armed = self._arm.is_set()
                if n % 50 == 0 or (armed and self.armed_at is None):
                    said.append(replace(WAITS, armed=armed))
                endpoint.send(wire.encode(said))
                if armed and self.armed_at is None:
                    self.armed_at = time.monotonic()
                n += 1

    def close(self):
        self._over.set()
        self._thread.join()


class WithoutStamps(UdpEndpoint):
    """A port whose kernel stamps nothing, as a serial line."""

    stamps = property(lambda self: False, lambda self, stamps: None)


@pytest.fixture(params=[UdpEndpoint, WithoutStamps])
def flown(request):
    """A pace at rest, and its vehicle."""
    rest = resting()
    with (
        closing(Link(request.param(local=("127.0.0.1", 0)), Codec(1, 191, [VEHICLE]))) as link,
        closing(Vehicle(link.endpoint.port)) as vehicle,
    ):
        yield ClockPace(link, NoFrames(), PERIOD, VEHICLE, rest=rest), rest, vehicle


def test_at_rest_it_ticks_once_a_second_and_dates_what_waited(flown, monkeypatch):
    pace, rest, _ = flown
    looked, take_in = [], pace._take_in
    monkeypatch.setattr(pace, "_take_in", lambda *a, **k: looked.append(1) or take_in(*a, **k))
    ticks = [pace.next(lambda: False) for _ in range(4)]
    times = np.array([t.time for t in ticks])
    assert np.diff(times)[1:] == pytest.approx(1.0)
    if pace._link.stamps:
        assert len(looked) < 40  # where each of 200 packets would wake it
    came = [r.message for t in ticks for r in t.received]
    stamps = [m.time for m in came if isinstance(m, Attitude)]
    assert stamps == sorted(stamps)
    assert len(stamps) > 100  # none is lost
    assert pace._clock.estimate.rate == pytest.approx(1.0, abs=0.02)
    for t in ticks[1:]:
        newest = max(r.message.time for r in t.received if isinstance(r.message, Attitude))
        assert newest <= t.latest
        assert t.latest - newest < 0.25
    assert rest.on


def test_a_vehicle_that_is_armed_is_noticed_at_once_and_no_tick_seems_late(flown):
    pace, rest, vehicle = flown
    for _ in range(2):
        pace.next(lambda: False)
    vehicle.arm()
    before = pace.next(lambda: False)
    while rest.on:
        before = pace.next(lambda: False)
    then = pace.next(lambda: False)
    noticed = time.monotonic()
    told = [
        {r.message.armed for r in t.received if isinstance(r.message, Heartbeat)}
        for t in (before, then)
    ]
    assert not any(told[0])  # the tick before knows of none
    assert told[1] == {True}
    assert then.time - before.time == pytest.approx(PERIOD)
    assert noticed - vehicle.armed_at < 0.6  # 0.3 on an idle machine
    assert pace.next(lambda: False).time - then.time == pytest.approx(PERIOD)


def test_the_log_of_each_tick_shows_the_bytes_that_it_read(flown):
    pace, rest, vehicle = flown
    packets, read = [], []
    pace._link.tap = lambda sent, data: None if sent else packets.append(data)
    vehicle.arm()
    for _ in range(4):
        inputs = pace.next(lambda: False)
        again = Codec(1, 191, [VEHICLE])
        decoded = [r.message for data in packets for r in again.decode_datagram(data)]
        shown = [m.time for m in decoded if isinstance(m, Attitude)]
        read.append([r.message.time for r in inputs.received if isinstance(r.message, Attitude)])
        assert read[-1] == shown
        packets.clear()
    assert not rest.on
    assert read[1]


def context_switches(pid):
    with open(f"/proc/{pid}/status") as status:  # noqa: PTH123  (of a process)
        return int(status.read().split("\nvoluntary_ctxt_switches:")[1].split()[0])


def test_a_daemon_at_rest_sleeps_and_feeds_its_watchdog(world, start_daemon):
    daemon = start_daemon(world.config(1))
    assert daemon.listen(PATIENCE, until="READY=1"), daemon.log()
    deadline = time.monotonic() + PATIENCE
    woken = np.inf
    while woken > 20.0 and time.monotonic() < deadline:  # 90 a second before it rests
        before, began = context_switches(daemon.process.pid), time.monotonic()
        daemon.listen(2.0)
        woken = (context_switches(daemon.process.pid) - before) / (time.monotonic() - began)
    assert woken <= 20.0
    daemon.heard.clear()
    daemon.listen(4.0)
    fed = [at for at, line in daemon.heard if line.startswith("WATCHDOG")]
    assert len(fed) > 8
    assert max(np.diff(fed)) < 0.9  # the unit allows a second
    assert daemon.state()["phase"] == "wait"
    os.kill(daemon.process.pid, signal.SIGTERM)
    assert daemon.process.wait(PATIENCE) == 0
