"""What a drone that waits on the ground leaves on its disk, and what must not get lost by that."""

from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.vehicle import VehicleEstimate
from companion.flightlog.idle import IdleTicks
from companion.flightlog.reader import read_log
from companion.flightlog.recorder import Recorder
from companion.flightlog.replay import replay
from companion.perception.camera_health import CameraFault
from companion.perception.frontend import Detections
from companion.supervision.guard import Broken, Reaction, Reason, Verdict
from companion.supervision.supervision import Supervised
from companion.tick import Tick
from companion.types import Phase
from mavlink_bridge.wire.messages import Heartbeat, RateCommand, VehicleState
from sitl_sim.flight.runner import flight
from sitl_sim.scenarios import scenario as scenarios
from tests.companion.ticks import COSTS, config, tick

AROUND, ONE_IN = 100, 100
COMMANDED = Verdict(RateCommand(np.zeros(3), 9.8), Reason.PLAN, 0)


def waiting(n, armed=False, speed=0.0, **supervised):
    level = np.array([1.0, 0, 0, 0])
    own = VehicleState(0.1 * n, np.zeros(3), np.array([speed, 0, 0]), level, np.zeros(3))
    vehicle = VehicleEstimate(state=own, heartbeat=Heartbeat(12, 2, armed, 0, 4))
    return Tick(0.1 * n, vehicle=vehicle, supervised=Supervised(Phase.WAIT, **supervised))


def logged(ticks):
    """The numbers of the ticks that were written before the log ended."""
    idle = IdleTicks()
    return [n for k, made in enumerate(ticks) for n in idle.due(made, [k])]


def test_few_of_the_ticks_are_logged_while_nothing_happens():
    kept = logged(waiting(n) for n in range(6_000))
    assert kept[:AROUND] == list(range(AROUND))
    assert len(kept) == AROUND + (6_000 - 2 * AROUND) // ONE_IN
    assert np.diff(kept[AROUND:]).tolist() == [ONE_IN] * (len(kept) - AROUND - 1)


@pytest.mark.parametrize(
    "news",
    [
        lambda t: replace(t, vehicle=replace(t.vehicle, heartbeat=Heartbeat(12, 2, True, 0, 4))),
        lambda t: replace(t, vehicle=replace(t.vehicle, heartbeat=Heartbeat(12, 2, False, 9, 4))),
        lambda t: replace(t, vehicle=replace(t.vehicle, refusals=("no GPS",))),
        lambda t: replace(t, supervised=Supervised(Phase.ARM)),
        lambda t: replace(t, supervised=replace(t.supervised, verdict=COMMANDED)),
        lambda t: replace(t, supervised=replace(t.supervised, inhibit_reason="no camera")),
        lambda t: replace(t, seen=Detections(fault=CameraFault.BLACK)),
        lambda t: replace(t, failure="see: ValueError"),
        lambda t: replace(t, broken=Broken("no such thrust", Reaction.HOLD)),
        lambda t: waiting(1500, speed=1.0),
    ],
)
def test_all_ticks_around_news_are_logged(news):
    """Ten seconds before it, which a replay needs, and ten after it."""
    at = 1500
    ticks = [waiting(n) for n in range(3000)]
    ticks[at] = news(ticks[at])
    kept = logged(ticks)
    assert set(range(at - AROUND, at + AROUND)) <= set(kept)
    assert len(kept) < 5 * AROUND + 3000 // ONE_IN


def test_a_daemon_at_rest_ticks_less_and_logs_the_same_times():
    ticks = [waiting(n) for n in range(1000)] + [waiting(n) for n in range(1000, 5000, 10)]
    ticks += [waiting(n, armed=True) for n in range(5000, 5100)]
    kept = [round(ticks[k].time * 10) for k in logged(ticks)]
    rested = [n for n in kept if 1000 <= n < 4900]
    assert rested == list(range(1000 + ONE_IN, 4900, ONE_IN))
    assert set(range(4900, 5000, 10)) <= set(kept)  # ten seconds before it arms
    assert set(range(5000, 5100)) <= set(kept)


def test_a_number_in_a_reason_is_no_news():
    kept = logged(waiting(n, inhibit_reason=f"hover thrust ±{n} %") for n in range(2000))
    assert len(kept) == AROUND + (2000 - 2 * AROUND) // ONE_IN


def test_faults_that_come_and_go_do_not_fill_the_disk():
    """On a busy board the camera is late for a moment, again and again."""
    faults = [CameraFault.NONE, CameraFault.LATE, CameraFault.NONE, CameraFault.FROZEN]
    made = [
        replace(waiting(n), seen=Detections(fault=faults[n // 7 % len(faults)]))
        for n in range(20_000)
    ]
    kept = logged(made)
    assert set(range(21 + AROUND)) <= set(kept)  # all that is new about it
    assert len(kept) < 4 * 3 * AROUND + 20_000 // ONE_IN  # and again every ten minutes


def test_nothing_of_a_flight_is_held_back():
    idle = IdleTicks()
    for n in range(1000):
        assert list(idle.due(waiting(n, armed=True), [n])) == [n]
    for n in range(1000, 2000):
        assert list(idle.due(tick(n, Phase.FLY)[1], [n])) == [n]
    assert not idle.asleep


def test_a_log_that_is_closed_holds_the_last_ticks(tmp_path):
    path = tmp_path / "flight.mcap"
    recorder = Recorder(config(path), path)
    inputs, _ = tick(0)
    for n in range(1000):
        recorder.write(replace(inputs, time=0.1 * n), waiting(n), [], {}, COSTS)
    recorder.close()
    times = [t["time"] for t in read_log(path).ticks]
    assert times == sorted(times)
    assert times[-AROUND:] == pytest.approx(np.arange(900, 1000) / 10)
    assert len(times) < 320


@pytest.fixture(scope="module")
def waited(tmp_path_factory):
    """(simulated s, bytes of all logs) of a drone that waits for a pilot, and its log's path."""
    scenario = scenarios.load(
        "pillars",
        [
            "drones.count=1",
            "mission.time_limit=60",
            "sensing={neighbours: truth, obstacles: map}",
            "companion.mission.auto=false",
        ],
    )
    folder = tmp_path_factory.mktemp("waits") / "run"
    own, sizes = folder / "drones" / "drone1", []

    def note(t):
        logs = [*own.glob("flight.*")]
        sizes.append((t, sum(log.stat().st_size for log in logs)))

    with flight(scenario, folder, in_process=True) as f:
        f.write_inputs()
        f.launch()
        f.wait_for_companions()
        f.run(note)
    return sizes, own / "flight.mcap"


def test_an_hour_of_waiting_leaves_two_megabytes(waited):
    sizes, path = waited
    after = [(t, size) for t, size in sizes if t > 25.0]  # the start is logged in full
    (began, least), (ended, most) = after[0], after[-1]
    assert ended - began > 30.0
    assert 0 < (most - least) / (ended - began) * 3600.0 < 2.5e6
    log = read_log(path)
    assert {t["phase"] for t in log.ticks} == {"wait"}
    assert replay(log).first is None  # the gaps change no decision
