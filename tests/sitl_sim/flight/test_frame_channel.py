"""The frame channel with an end that is stopped: alive, connected, and silent."""

import contextlib
import json
import socket
import struct
import threading
import time

import numpy as np
import pytest

from mavlink_bridge.wire.video import PATIENCE, Answer, Frame, FrameClient, FrameServer, VideoError
from sitl_sim.flight.runner import Flight
from sitl_sim.scenarios.scenario import Scenario

SOON = 10.0  # s within which what must not hang is over, on a busy machine
PICTURE = Frame(1.0, {"image": np.zeros((400, 640, 3), np.uint8)})


def within(seconds, work, release):
    """Result of `work` within `seconds`; `release` ends it where it hangs."""
    out = []
    thread = threading.Thread(target=lambda: out.append(work()), daemon=True)
    thread.start()
    thread.join(seconds)
    hangs = thread.is_alive()
    release()
    thread.join(SOON)
    assert not hangs
    return out[0]


def outcome(work):
    """Message of the VideoError that `work` raises, or None."""
    try:
        work()
    except VideoError as error:
        return str(error)
    return None


def record(**header):
    """A frame as it crosses the wire: header and a 4×4 picture."""
    text = json.dumps({"packets": 0, **header, "arrays": [["image", "uint8", [4, 4, 3]]]}).encode()
    return struct.pack("<4sI", b"SWF1", len(text)) + text + bytes(48)


@pytest.fixture
def line():
    """A companion's end of the channel, and the bare socket that sends it frames."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        client = FrameClient("127.0.0.1", listener.getsockname()[1])
        sender = listener.accept()[0]
        yield client, sender
        client.close()
        sender.close()


@pytest.mark.parametrize("size", [3, 20, 100])
def test_half_a_frame_and_then_silence_is_a_lost_camera(line, size):
    client, sender = line
    sender.sendall(record(time_us=1)[:size])
    said = within(SOON, lambda: outcome(client.receive), sender.close)
    assert "timed out" in said


def test_the_next_frame_may_take_its_time(line):
    client, sender = line
    for k in range(2):
        later = threading.Timer(3 * PATIENCE, sender.sendall, [record(time_us=k)])
        later.start()
        assert client.receive().time == k / 1e6


def test_in_lockstep_the_rest_may_take_its_time_too(line):
    client, sender = line
    server = FrameServer("127.0.0.1", 0, timeout=SOON, lockstep=True)
    with contextlib.closing(server), socket.create_connection(("127.0.0.1", server.port)) as tap:
        assert server.send(Frame(2.0, {"image": np.ones((4, 4, 3), np.uint8)}))
        sent = tap.recv(4096)
    sender.sendall(sent[:-10])
    later = threading.Timer(3 * PATIENCE, sender.sendall, [sent[-10:]])
    later.start()
    frame = client.receive()
    assert (frame.time, int(frame.arrays["image"].sum())) == (2.0, 48)


@pytest.mark.parametrize("patience", ["null", "[]", "NaN", "-1", '"soon"', "Infinity"])
def test_an_invalid_patience_is_refused_or_bounded(line, patience):
    client, sender = line
    text = record(time_us=1, patience="X").replace(b'"X"', patience.encode())[8:]
    length = len(text) - 48
    sender.sendall(struct.pack("<4sI", b"SWF1", length) + text)
    said = outcome(client.receive)
    assert said is None if patience == "Infinity" else "bad header" in said


def test_answers_that_are_not_received_end_too(line):
    client, sender = line

    def answer_on():
        for k in range(10_000_000):
            client.answer(Answer(float(k), k))

    assert "timed out" in within(6 * SOON, lambda: outcome(answer_on), sender.close)


def test_a_companion_that_takes_no_frames_is_disconnected():
    server = FrameServer("127.0.0.1", 0, timeout=0.3)
    stopped = socket.create_connection(("127.0.0.1", server.port))

    def send_on():
        return next(k for k in range(1000) if not server.send(PICTURE))

    with contextlib.closing(server):
        assert within(SOON, send_on, stopped.close) < 1000
        assert not server.connected
        with socket.create_connection(("127.0.0.1", server.port)):
            assert server.send(Frame(1.0))  # to the next companion


@pytest.mark.parametrize(("neighbours", "frame_port"), [("camera", 28860), ("truth", 28870)])
def test_lockstep_goes_on_without_a_stopped_companion(tmp_path, neighbours, frame_port):
    """Pictures fill its socket; a perfect detector's reports do not, but no answer comes."""
    scenario = Scenario.model_validate(
        {
            "drones": {"count": 1, "heading_deg": 0.0},
            "sensing": {"neighbours": neighbours, "obstacles": "map"},
            "mission": {"time_limit": 5.0},
            "timing": {"answer_timeout": 0.5},
            "wire": {"companion_port": 28840, "gcs_port": 28850, "frame_port": frame_port},
        }
    )
    flight, shown = Flight(scenario, tmp_path), []
    frames = flight._drones[0].frames
    send = frames.send
    frames.send = lambda frame: shown.append(frame) or send(frame)
    stopped = socket.socket()
    stopped.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    stopped.connect(("127.0.0.1", frame_port + 1))
    flight._autopilots.units[0].commander.arm()  # else the flight would end with its companion
    try:
        within(6 * SOON, flight.run, stopped.close)
    finally:
        flight.close()
    assert flight._now == 5000
    assert flight._drones[0].companion_lost
    assert len(shown) == 1


def test_rendering_time_does_not_count_as_the_companions(tmp_path):
    """The first picture waits for compilation, longer than a companion may."""
    scenario = Scenario.model_validate(
        {
            "drones": {"count": 1, "heading_deg": 0.0},
            "sensing": {"neighbours": "truth", "obstacles": "map"},
            "mission": {"time_limit": 0.3},
            "timing": {"answer_timeout": 0.5},
            "wire": {"companion_port": 28840, "gcs_port": 28850, "frame_port": 28880},
        }
    )
    flight = Flight(scenario, tmp_path)
    frame = flight.sensors.frame
    flight.sensors.frame = lambda *what: time.sleep(0.6) or frame(*what)
    companion = FrameClient("127.0.0.1", 28881)

    def answer_late():
        with contextlib.suppress(VideoError):
            while True:
                frame = companion.receive()
                time.sleep(0.3)
                companion.answer(Answer(frame.due, 0))

    thread = threading.Thread(target=answer_late)
    thread.start()
    try:
        flight.run()
        assert not flight._drones[0].companion_lost
    finally:
        flight.close()
        thread.join()
        companion.close()
