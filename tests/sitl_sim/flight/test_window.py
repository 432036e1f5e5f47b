"""The world around a vehicle that reports its pose, here an emulated one behind a UDP port."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import yaml

from mavlink_bridge.shared.frames import conjugate, multiply, rotation_vector
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.messages import Attitude, Heartbeat, HilState, LocalPosition
from mavlink_bridge.wire.udp import UdpEndpoint
from mavlink_bridge.wire.video import Answer, FrameClient, FrameServer
from sitl_sim.__main__ import main
from sitl_sim.external import watched_vehicle
from sitl_sim.external.external_sitl import ExternalError
from sitl_sim.external.watched_vehicle import WatchedVehicle
from sitl_sim.flight import window as windows
from sitl_sim.flight.results import finish
from sitl_sim.flight.window import open_window
from sitl_sim.recording.run_folder import own_frames
from sitl_sim.scenarios.scenario import Scenario
from tests.wire.served import ROOT, free_ports

START = [3.0, -20.0]
SCENARIO = {
    "name": "around",
    "seed": 5,
    "world": {"cylinders": [{"x": 3.0, "y": -12.0, "radius": 0.6}]},
    "drones": {"count": 1, "starts": [START], "jitter": 0.0, "heading_deg": 90.0},
    "mission": {"targets": [[3.0, -5.0, 2.0]], "home": False},
    "sensing": {"neighbours": "truth", "obstacles": "map", "width": 64, "height": 64},
}


LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
SELDOM = [
    m
    for t in range(1, 9)
    for m in (Attitude(t, LEVEL, np.zeros(3)), LocalPosition(t, np.zeros(3), np.zeros(3)))
]


class Vehicle:
    """An emulated vehicle whose own frame is turned and shifted, on a UDP link of its own."""

    def __init__(self, flight, port):
        self.flight = flight
        self.link = Link(UdpEndpoint(remote=("127.0.0.1", port)), Codec(1, 1))
        self.answered = []

    def fly(self, seconds, each=lambda: None, steps=2):
        """Fly on; every 20 ms of its time the vehicle sends, reads, and `each` is called."""
        for _ in range(round(seconds * 50)):
            heard = len(self.flight.heard[0])
            for _ in range(steps):
                self.flight.run(0.01)
            self.link.send(self.flight.heard[0][heard:])
            for received in self.link.receive():
                self.answered.append(received.message)
                replies = self.flight.send(received.message, source=received.source, link="gcs")
                self.link.send(replies)
            each()


@pytest.fixture
def shown(make_flight, tmp_path):
    """A vehicle in the air's reach, a window round it, its captures, and what it said."""
    scenario = Scenario.model_validate(
        SCENARIO | {"wire": {"frame_port": free_ports(2, socket.SOCK_STREAM)}}
    )
    port, words = free_ports(1), []
    flight = make_flight(yaw=0.4, origin=[[-7.0, 4.0, 0.0]], yaw_offset=1.1)
    vehicle = Vehicle(flight, port)
    with open_window(scenario, tmp_path / "run", f"udpin:127.0.0.1:{port}", 1, words.append) as w:
        captured = []
        draw = w._sensors.frame
        w._sensors.frame = lambda i, at, p, q: (
            captured.append((at, p[0], q[0])) or draw(i, at, p, q)
        )
        vehicle.window, vehicle.words, vehicle.captured = w, words, captured
        yield vehicle
    vehicle.link.close()


def place(vehicle):
    """Let the window find the vehicle, which flies on meanwhile."""
    over = threading.Event()

    def live():
        while not over.is_set():
            vehicle.fly(0.1)
            time.sleep(0.005)

    thread = threading.Thread(target=live)
    thread.start()
    try:
        vehicle.window.find_vehicle()
    finally:
        over.set()
        thread.join()
    vehicle.captured.clear()
    vehicle.window.write_inputs("udpin:127.0.0.1:14999")


def test_the_pictures_show_the_pose_of_their_stamp(shown):
    """In the world the vehicle stands at the start and faces as the scenario says."""
    place(shown)
    w, flight = shown.window, shown.flight
    camera = FrameClient("127.0.0.1", w.frame_port)
    true = {}

    def each():
        t = round(flight.autopilots.t, 3)
        true[t] = (flight.vehicles.p[0].copy(), flight.vehicles.q[0].copy())
        w.step(0.001)

    try:
        shown.fly(0.4, each)
        flight.command(400, 1)
        flight.command(22)
        shown.fly(6.0, each)
        stamps = []
        while camera.waits(0.0):
            stamps.append(camera.receive().time)
        camera.answer(Answer(stamps[-1], 0, done=True))
        camera.waits(0.2)
        w.step(0.01)
    finally:
        camera.close()
    assert w._landed
    assert len(stamps) == pytest.approx(62, abs=2)
    np.testing.assert_allclose(np.diff(stamps), 0.1, atol=1e-6)
    assert stamps[0] % 0.1 == pytest.approx(0.1 - windows.LEAD, abs=1e-6)  # then comes a tick
    assert flight.vehicles.p[0, 2] > 1.5
    # World of the scenario: the vehicle's world, shifted to the start and turned by its heading.
    p0 = np.array([0.0, 0.0, 0.0])
    turn = np.pi / 2 - 0.4
    c, s = np.cos(turn), np.sin(turn)
    around = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    q_turn = np.array([np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)])
    times = np.array(sorted(true))
    for at, p, q in shown.captured:
        before = times[times <= at + 1e-6][-1]
        after = times[times >= at - 1e-6][0]
        share = 0.0 if after == before else (at - before) / (after - before)
        p_true = true[before][0] + share * (true[after][0] - true[before][0])
        expected = np.array([*START, 0.0]) + around @ (p_true - p0)
        np.testing.assert_allclose(p, expected, atol=0.1)  # the estimate's own error
        off = rotation_vector(multiply(conjugate(multiply(q_turn, true[before][1])), q))
        assert np.degrees(np.linalg.norm(off)) < 2.5
    assert len(w.ages) == len(stamps)
    assert 0.0 <= min(w.ages) <= max(w.ages)


def test_the_run_folder_is_a_flights(shown):
    place(shown)
    w = shown.window
    camera = FrameClient("127.0.0.1", w.frame_port)
    try:
        shown.fly(1.0, lambda: w.step(0.001))
    finally:
        camera.close()
    metrics = finish(w, 0.0)
    assert metrics["never_flew"] == ["drone1"]
    assert metrics["faults_in_truth"] == []
    assert metrics["targets_reached"] == {"drone1": "0/1"}
    with np.load(w.folder / "truth.npz") as truth:
        np.testing.assert_allclose(np.diff(truth["t"]), 0.02, atol=1e-6)
        assert truth["t"][0] == 0.0
        assert "estimate" not in truth
        np.testing.assert_allclose(
            truth["position"][:, 0], [[*START, 0.0]] * len(truth["t"]), atol=0.1
        )
    world = json.loads((w.folder / "world.json").read_text())
    (frame,) = own_frames(w.scenario, world)
    config = yaml.safe_load((w.folder / "drones" / "drone1" / "config.yaml").read_text())
    assert config["link"] == {
        "endpoint": "udpin:127.0.0.1:14999",
        "system_id": 1,
        "autopilot": "px4",
    }
    assert config["camera"]["source"] == f"sim:127.0.0.1:{w.frame_port}"
    assert config["timing"]["pace"] == "clock"
    (goal,) = config["mission"]["goals"]  # in the vehicle's own frame
    np.testing.assert_allclose(frame.points(goal), [3.0, -5.0, 2.0], atol=1e-3)


def test_contacts_are_counted_one_by_one(shown):
    place(shown)
    w = shown.window
    w._boot = 0.0
    inside, outside = np.array([3.0, -12.7, 2.0]), np.array([3.0, -15.0, 2.0])
    for n, p in enumerate([outside, inside, inside, outside, inside, outside]):
        state = w.vehicle.poses.at(w.vehicle.poses.known_until)
        own = w._seen.point(p)
        w.vehicle.poses.hear([LocalPosition(state.time + 0.1, own, np.zeros(3))])
        w._state = lambda at, p=p, state=state: windows.replace(state, p=p)
        w._record(0.02 * n)
    assert w.contacts == 2
    assert [line for line in shown.words if "contact" in line] == [
        "contact 1 with an obstacle, 0.0 s",
        "contact 2 with an obstacle, 0.1 s",
    ]


def test_it_ends_when_told_to_and_releases_its_ports(shown):
    place(shown)
    w = shown.window
    w.stop(15)
    w.run()
    assert not w.shown  # no companion came
    assert w.simulated_seconds == 0.0
    assert w.exit_codes() == {"drone1": None}
    w.close()
    FrameServer("127.0.0.1", w.frame_port).close()


def test_ctrl_c_ends_the_search_for_a_vehicle(tmp_path):
    file = tmp_path / "around.yaml"
    file.write_text(yaml.safe_dump(SCENARIO))
    arguments = ["window", file, "--vehicle", f"udpin:127.0.0.1:{free_ports(1)}"]
    process = subprocess.Popen(
        [sys.executable, "-m", "sitl_sim", *arguments, "--set", f"wire.frame_port={free_ports(2)}"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        text=True,
    )
    while not list(tmp_path.glob("runs/*/.lock")):
        assert process.poll() is None
        time.sleep(0.05)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=20)
    assert process.returncode == 130
    assert told == "interrupted\n"


def test_a_vehicle_that_starts_anew_ends_the_window(shown):
    place(shown)
    shown.link.send([LocalPosition(0.001, np.zeros(3), np.zeros(3))])
    shown.window.run()
    assert shown.words == ["the vehicle has started anew: its place in the world is lost"]


def test_only_what_a_simulator_tells_before_the_placing_is_the_truth(shown):
    place(shown)
    state = HilState(9.0, np.array([1.0, 0, 0, 0]), np.zeros(3), 47.0, 8.0, 488.0, np.zeros(3))
    shown.window.vehicle._hear_poses([state])
    assert not shown.window.vehicle.knows_truth


def test_its_sign_of_life_is_no_ground_stations(shown):
    place(shown)
    shown.fly(0.1)
    hello = [m for m in shown.answered if isinstance(m, Heartbeat)]
    assert hello
    assert {m.vehicle_type for m in hello} == {18}


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(watched_vehicle, "_HEARD", 0.3)
    monkeypatch.setattr(watched_vehicle, "_LOCATED", 0.5)


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize(
    ("system", "messages", "words"),
    [
        (1, [], "vehicle 1 sends no heartbeat; nothing is heard"),
        (3, [Heartbeat(12, 2, False, 0, 3)], "no heartbeat; heard 1: --system 1"),
        (1, [Heartbeat(12, 2, False, 0, 3)], "tells no attitude and no position"),
        (1, [Heartbeat(12, 2, False, 0, 3), *SELDOM], "tells its pose too seldom"),
    ],
)
def test_what_a_vehicle_does_not_send_is_said(system, messages, words):
    port = free_ports(1)
    vehicle = WatchedVehicle(f"udpin:127.0.0.1:{port}", system)
    link = Link(UdpEndpoint(remote=("127.0.0.1", port)), Codec(1, 1))
    link.send(messages)
    try:
        with pytest.raises(ExternalError, match=words):
            vehicle.await_stand(lambda: False)
    finally:
        link.close()
        vehicle.close()


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize(
    ("url", "more", "words"),
    [
        ("px4", [], "endpoint 'px4' is none of: udpin:HOST:PORT"),
        ("udpout:127.0.0.1:9", ["--companion", "14540"], "endpoint '14540' is none of"),
        ("udpout:127.0.0.1:9", ["--system", "300"], "--system: must be 1 to 255, got 300"),
        ("serial:/dev/nowhere:57600", [], "serial /dev/nowhere"),
        ("tcp:127.0.0.1:9", [], "sends no heartbeat; TCP 127.0.0.1:9: Connection refused"),
        ("udpout:127.0.0.1:9", [], "sends no heartbeat; nothing is heard"),
    ],
)
def test_a_url_behind_which_no_vehicle_is_found_is_one_clear_line(
    tmp_path, capsys, url, more, words
):
    file = tmp_path / "around.yaml"
    port = free_ports(2, socket.SOCK_STREAM)
    file.write_text(yaml.safe_dump(SCENARIO | {"wire": {"frame_port": port}}))
    out = tmp_path / "run"
    assert main(["window", str(file), "--vehicle", url, "--out", str(out), *more]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert words in line
