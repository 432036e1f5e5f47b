"""TCP and serial lines: partial reads at 921600 baud, loss and reconnection, clear errors."""

import contextlib
import itertools
import os
import pty
import select
import signal
import socket
import threading
import time
import tty

import numpy as np
import pytest

from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.link import Link, open_endpoint
from mavlink_bridge.wire.messages import Attitude, Heartbeat
from mavlink_bridge.wire.udp import EndpointError, UdpEndpoint

BAUD = 921600
HEARTBEAT = Heartbeat(12, 2, False, 0, 3)
FRAME = 44  # bytes, an attitude


@pytest.fixture
def line(tmp_path):
    """A pty pair with a stable name, as udev gives to a flight controller: master, name, slave."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    name = tmp_path / "ttyFC"
    name.symlink_to(os.ttyname(slave))
    yield master, name, slave
    for file in (master, slave):
        with contextlib.suppress(OSError):  # the test may have unplugged it
            os.close(file)


@contextlib.contextmanager
def in_time(seconds):
    """Fail where the code inside blocks."""

    def late(number, frame):
        raise AssertionError(f"still blocked after {seconds} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def receive(link, count, seconds=10.0):
    """Return messages as soon as there are `count`."""
    out, end = [], time.monotonic() + seconds
    while len(out) < count and time.monotonic() < end:
        link.wait(0.1)
        out += link.receive()
    return out


def test_serial_receives_every_message_in_any_chunking(line):
    master, name, _ = line
    link = Link(open_endpoint(f"serial:{name}:{BAUD}"), Codec(1, 191))
    sender = Codec(1, 1)
    sent = [Attitude(k / 100, np.array([1.0, 0, 0, 0]), np.zeros(3)) for k in range(200)]
    stream = sender.encode(sent)

    def trickle():
        rng, at = np.random.default_rng(1), 0
        while at < len(stream):
            size = int(rng.integers(1, 40))
            os.write(master, stream[at : at + size])
            at += size

    writer = threading.Thread(target=trickle)
    writer.start()
    got = receive(link, len(sent))
    writer.join()
    assert [r.message.time for r in got] == [a.time for a in sent]
    assert link.codec.statistics.bad_bytes == 0
    link.close()


def test_serial_sends(line):
    master, name, _ = line
    link = Link(open_endpoint(f"serial:{name}:{BAUD}"), Codec(1, 191))
    link.send([HEARTBEAT])
    received = Codec(1, 1).decode(os.read(master, 1000))
    assert received[0].source.component == 191
    link.close()


def test_a_serial_line_is_opened_once(line):
    """Two readers would have half of the telemetry each."""
    _, name, _ = line
    first = open_endpoint(f"serial:{name}:{BAUD}")
    with pytest.raises(EndpointError, match="lock"):
        open_endpoint(f"serial:{name}:{BAUD}")
    first.close()


def test_a_serial_line_that_is_not_read_refuses_messages_and_does_not_block(line, monkeypatch):
    monkeypatch.setattr("mavlink_bridge.wire.bytestream._STALE", 60.0)  # as if it were at once
    master, name, _ = line
    link = Link(open_endpoint(f"serial:{name}:{BAUD}"), Codec(1, 191))
    sender = Codec(1, 191)
    frames = [sender.encode([HEARTBEAT]) for _ in range(2000)]
    with in_time(5.0):
        taken = [link.endpoint.send(frame) for frame in frames]
        assert link.receive() == []
    assert taken[0]
    assert not taken[-1]
    assert link.problem == ""
    # Accepted messages arrive whole once the other end reads.
    reader, count = Codec(1, 1), 0
    with in_time(5.0):
        while count < sum(taken):
            count += len(reader.decode(os.read(master, 65536)))
            link.receive()
    assert reader.statistics.bad_bytes == 0
    link.close()


_NUMBER = itertools.count()


def accepts(link, at, size=FRAME):
    """Return whether the line accepts `size` bytes: attitudes of this time [s], and zeros."""
    level = np.array([1.0, 0, 0, 0])  # no two are copies of each other
    turns = [Attitude(at, level, np.array([next(_NUMBER), 0.0, 0.0])) for _ in range(size // FRAME)]
    return link.endpoint.send(link.codec.encode(turns).ljust(size, b"\0"))


def stall(link, size):
    """Fill the line until it accepts no more; return the number of accepted packets."""
    taken, moved = 0, time.monotonic()
    while time.monotonic() - moved < 0.4:
        while accepts(link, 0.0, size):
            taken, moved = taken + 1, time.monotonic()
        time.sleep(0.02)
    return taken


def times(reader, data):
    """Return the times of the attitudes that `data` completes."""
    return [r.message.time for r in reader.decode(data)]


@pytest.mark.parametrize(
    "size", [FRAME, 64]
)  # with a packet cut by the buffer of the pty, and without
def test_a_serial_line_that_was_stuck_delivers_nothing_old(line, size):
    master, name, _ = line
    link, reader = Link(open_endpoint(f"serial:{name}:{BAUD}"), Codec(1, 191)), Codec(1, 1)
    with in_time(20.0):
        stall(link, size)
        assert not accepts(link, 1.0)
        beyond_reach = os.read(master, 65536)  # already on the reading side of the pty
        found = times(reader, beyond_reach)
        while not accepts(link, 2.0):
            time.sleep(0.01)
        for at in (3.0, 4.0):
            assert accepts(link, at)
        while 4.0 not in found:
            found += times(reader, os.read(master, 65536))
    old = found.count(0.0)
    assert found == [0.0] * old + [2.0, 3.0, 4.0]
    # As much again is sent before the next message shows that the other end reads.
    assert old <= 2 * len(beyond_reach) / size + 1
    link.close()


def test_a_tcp_line_that_was_stuck_drops_whole_packets():
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = Link(open_endpoint(f"tcp:127.0.0.1:{server.getsockname()[1]}"), Codec(1, 191))
        assert receive(link, 1, 0.05) == []
        peer, _ = server.accept()
    reader, found, at = Codec(1, 1), [], 2.0
    with peer, in_time(20.0):
        assert receive(link, 1, 0.05) == []
        with socket.socket(fileno=os.dup(link.endpoint.fileno())) as ours:
            ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 8192)  # soon full
        taken = stall(link, 30 * FRAME)
        assert not accepts(link, 1.0)
        while not found or found[-1] < 2.0:
            accepts(link, at)
            at += 1.0
            while select.select([peer], [], [], 0.02)[0]:
                found += times(reader, peer.recv(65536))
    old = found.count(0.0)
    assert found[:old] == [0.0] * old
    assert 1.0 not in found
    assert old % 30 == 0  # a cut packet is completed
    assert old < 30 * (taken - 2)  # queued packets are dropped
    assert reader.statistics.bad_bytes == 0
    link.close()


@pytest.mark.row("25")
def test_an_unplugged_serial_line_is_reported_and_comes_back(line, tmp_path):
    master, name, slave = line
    link = Link(open_endpoint(f"serial:{name}:{BAUD}"), Codec(1, 191))
    assert link.problem == ""
    name.unlink()
    os.close(master)
    os.close(slave)
    end = time.monotonic() + 5.0
    while not link.problem and time.monotonic() < end:
        assert link.receive() == []
    assert str(name) in link.problem
    assert "\n" not in link.problem
    link.send([HEARTBEAT])  # lost without an error

    master, slave = pty.openpty()
    tty.setraw(slave)
    name.symlink_to(os.ttyname(slave))
    looks = 0
    while link.problem and looks < 40:  # 2 s, or longer on a busy machine
        link.wait(0.05)
        link.receive()
        looks += 1
    assert not link.problem
    os.write(master, Codec(1, 1).encode([HEARTBEAT]))
    assert [r.message for r in receive(link, 1)] == [HEARTBEAT]
    assert link.endpoint.reconnects == 1
    link.close()
    os.close(master)
    os.close(slave)


@pytest.mark.row("25")
def test_tcp_waits_for_its_listener_and_reconnects():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    link = Link(open_endpoint(f"tcp:127.0.0.1:{port}"), Codec(1, 191))
    assert receive(link, 1, 0.05) == []
    for _ in range(2):
        with socket.create_server(("127.0.0.1", port)) as server:
            server.settimeout(5.0)
            reader = threading.Thread(target=receive, args=(link, 1, 2.0))
            reader.start()
            peer, _ = server.accept()
            with peer:
                peer.sendall(Codec(1, 1).encode([HEARTBEAT]))
                reader.join()
                assert link.problem == ""
        receive(link, 1, 0.05)
        assert str(port) in link.problem
    link.close()


def test_the_age_of_a_stream_is_kept_per_sender(line):
    master, name, _ = line
    link = Link(open_endpoint(f"serial:{name}:{BAUD}"), Codec(1, 191))
    assert link.age(Heartbeat, 1) == float("inf")
    os.write(master, Codec(1, 1).encode([HEARTBEAT]))
    receive(link, 1)
    assert link.age(Heartbeat, 1) < 5.0
    assert link.age(Heartbeat, 2) == float("inf")
    assert link.age(Attitude, 1) == float("inf")
    link.close()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("serial:/dev/no-such-tty:921600", "serial /dev/no-such-tty: "),
        ("serial:/dev/null:921601", "baud rate 921601 is none of 9600"),
        ("tcp:localhost", "endpoint 'tcp:localhost' is none of: udpin:"),
        ("tcp:localhost:70000", "is none of: udpin:"),
        ("usb:1:2", "is none of: udpin:"),
        ("udpin:127.0.0.1:²", "is none of: udpin:"),
        ("serial:/dev/null:²", "is none of: udpin:"),
        ("udpin:a..b:14550", "is none of: udpin:"),
    ],
)
def test_a_bad_endpoint_is_refused_with_one_line(name, words):
    with pytest.raises(EndpointError) as error:
        open_endpoint(name)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_two_vehicles_with_one_system_id_are_reported_in_one_line():
    link = Link(UdpEndpoint(local=("127.0.0.1", 0)), Codec(1, 191))
    address = ("127.0.0.1", link.endpoint.port)
    vehicles = [Link(UdpEndpoint(remote=address), Codec(7, 1)) for _ in range(2)]
    vehicles[0].send([HEARTBEAT])
    receive(link, 1)
    assert link.problem == ""
    vehicles[1].send([HEARTBEAT])
    receive(link, 1)
    ports = sorted(f"127.0.0.1:{v.endpoint.port}" for v in vehicles)
    assert link.problem == f"two vehicles with system id 7: {' and '.join(ports)}"
    for each in (link, *vehicles):
        each.close()
