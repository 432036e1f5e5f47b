"""Records of the frame channel from bytes, each bound at its end, and ends that are not there."""

import contextlib
import json
import math
import socket
import struct
import threading

import numpy as np
import pytest

from mavlink_bridge.wire import video
from mavlink_bridge.wire.video import (
    Answer,
    Frame,
    FrameClient,
    FrameServer,
    RecordStream,
    VideoError,
)


@pytest.fixture
def ends():
    """A stream that waits a moment, and the other end of its line."""
    listener = socket.create_server(("127.0.0.1", 0))
    other = socket.create_connection(listener.getsockname())
    line, _ = listener.accept()
    line.settimeout(0.2)
    stream = RecordStream(line)
    with listener, other, contextlib.closing(stream):
        yield stream, other


def record(header, data=b"", magic=b"SWF1"):
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<4sI", magic, len(text)) + text + data


def of(*arrays, **more):
    return {"arrays": list(arrays), **more}


def test_a_record_is_a_length_a_header_and_its_arrays(ends):
    stream, other = ends
    a, b = np.arange(6, dtype=np.uint16).reshape(2, 3), np.array([1.5, -2.0], np.float32)
    stream.send({"x": 1}, {"a": a, "b": b[::-1]})
    want = record({"x": 1, "arrays": [["a", "uint16", [2, 3]], ["b", "float32", [2]]]})
    got = other.recv(1000)
    assert got == want + bytes([0, 0, 1, 0, 2, 0, 3, 0, 4, 0, 5, 0]) + struct.pack("<2f", -2.0, 1.5)
    other.sendall(got)
    header, arrays = stream.receive()
    assert header == {"x": 1}
    assert (arrays["a"] == a).all()
    assert (arrays["b"] == b[::-1]).all()


def test_records_follow_each_other(ends):
    stream, other = ends
    other.sendall(record(of(["a", "uint8", [2]]), b"xy") + record(of(n=2)))
    assert bytes(stream.receive()[1]["a"]) == b"xy"
    assert stream.receive() == ({"n": 2}, {})


@pytest.mark.parametrize("size", [1 << 16, (1 << 16) + 1])
def test_a_header_has_at_most_64_kib(ends, size):
    stream, other = ends
    text = b'{"arrays": []' + b" " * (size - 14) + b"}"
    threading.Thread(target=other.sendall, args=(record(text),)).start()
    if size <= 1 << 16:
        assert stream.receive() == ({}, {})
    else:
        with pytest.raises(VideoError, match="frame channel: not a record"):
            stream.receive()


BAD = {
    "another magic": record(of(), magic=b"SWF2"),
    "no JSON": record(b"{"),
    "no text": record(b"\xff\xff"),
    "no object": record(b"[]"),
    "no arrays": record({}),
    "arrays that are none": record({"arrays": 3}),
    "an array of two parts": record({"arrays": [["a", "uint8"]]}),
    "a shape of words": record({"arrays": [["a", "uint8", ["x"]]]}),
    "a shape without end": record(b'{"arrays": [["a", "uint8", [Infinity]]]}'),
    "another type": record(of(["a", "int32", [1]]), bytes(4)),
    "objects": record(of(["a", "object", [1]]), bytes(8)),
    "less than nothing": record(of(["a", "uint8", [-1]])),
    "less than nothing, twice": record(of(["a", "uint8", [-2, -2]]), bytes(4)),
    "four dimensions": record(of(["a", "uint8", [1, 1, 1, 1]]), b"x"),
    "patience of words": record(of(patience="long")),
    "a deep header": record(b"[" * 60000),
}


@pytest.mark.parametrize("what", BAD)
def test_what_is_no_record_is_refused(ends, what):
    stream, other = ends
    other.sendall(BAD[what])
    with pytest.raises(VideoError, match=r"frame channel: (not a record|bad header|array)"):
        stream.receive()


@pytest.mark.parametrize("shape", [[], [1], [1, 1], [1, 1, 1]])
def test_an_array_has_up_to_three_dimensions(ends, shape):
    stream, other = ends
    other.sendall(record(of(["a", "uint8", shape]), b"x"))
    assert stream.receive()[1]["a"].shape == tuple(shape)


def test_arrays_have_so_many_bytes_in_all(ends, monkeypatch):
    stream, other = ends
    monkeypatch.setattr(video, "_MAX_PAYLOAD", 16)
    two = of(["a", "float64", [1]], ["b", "uint8", [2, 2]], ["c", "uint16", [2]])
    other.sendall(record(two, bytes(16)))
    assert len(stream.receive()[1]) == 3
    other.sendall(record(of(["a", "uint8", [0, 16]])))
    assert stream.receive()[1]["a"].shape == (0, 16)
    other.sendall(record(of(["a", "float64", [1]], ["b", "uint8", [9]]), bytes(17)))
    with pytest.raises(VideoError, match=r"array 'b' of uint8 .* is too large"):
        stream.receive()


@pytest.mark.parametrize("shape", [[0, 17], [17, 0]])
def test_an_array_of_nothing_may_not_be_wide_without_bound(ends, monkeypatch, shape):
    stream, other = ends
    monkeypatch.setattr(video, "_MAX_PAYLOAD", 16)
    other.sendall(record(of(["a", "uint8", shape])))
    with pytest.raises(VideoError, match="too large"):
        stream.receive()


def test_a_full_picture_fits():
    assert video._MAX_PAYLOAD == 64 * 1024 * 1024


@pytest.mark.parametrize(("asked", "given"), [(0.5, 0.5), (3600, 3600.0), (1e9, 3600.0)])
def test_patience_may_be_an_hour_at_most(ends, asked, given):
    stream, other = ends
    other.sendall(record(of(patience=asked)))
    assert stream.receive() == ({}, {})
    assert stream._socket.gettimeout() == given


@pytest.mark.parametrize("sent", [4, 8, 20])
def test_a_record_that_is_cut_short_ends_in_its_patience(ends, sent):
    stream, other = ends
    other.sendall(record(of(["a", "uint8", [9]]), bytes(9))[:sent])
    with pytest.raises(VideoError, match="frame channel: timed out"):
        stream.receive()


def test_a_record_may_begin_late(ends):
    stream, other = ends
    stream._socket.settimeout(0.05)
    timer = threading.Timer(0.3, other.sendall, [record(of(n=1))])
    timer.start()
    assert stream.receive() == ({"n": 1}, {})
    timer.join()


@pytest.mark.parametrize("sent", [0, 4, 20])
def test_a_line_that_ends_is_named(ends, sent):
    stream, other = ends
    other.sendall(record(of(["a", "uint8", [9]]), bytes(9))[:sent])
    other.close()
    with pytest.raises(VideoError, match="frame channel: the other end closed it"):
        stream.receive()


def test_an_end_that_does_not_read_is_named(ends):
    stream, other = ends
    with pytest.raises(VideoError, match="frame channel: timed out"):
        stream.send({}, {"a": np.zeros(1 << 26, np.uint8)})
    assert other.recv(8)[:4] == b"SWF1"


def test_a_record_is_awaited_so_long(ends):
    stream, other = ends
    assert not stream.waits()
    assert not stream.waits(0.01)
    other.sendall(b"S")
    assert stream.waits(5.0)


def frame_of(**header):
    """What a companion makes of a frame's header, or the error."""
    server = socket.create_server(("127.0.0.1", 0))
    with server, contextlib.closing(FrameClient(*server.getsockname())) as client:
        line = server.accept()[0]
        with line:
            line.sendall(record(of(**header)))
            return client.receive()


def test_times_are_microseconds():
    frame = frame_of(time_us=1_500_000, packets=3, due_us=-250_000)
    assert (frame.time, frame.packets, frame.due, frame.local, frame.lag) == (
        1.5,
        3,
        -0.25,
        False,
        None,
    )
    assert frame_of(time_us=0, packets=0).due is None
    assert frame_of(time_us=0, packets=0, due_us=0).due == 0.0


@pytest.mark.parametrize(
    "header",
    [
        {"packets": 1},
        {"time_us": 1},
        {"time_us": "now", "packets": 1},
        {"time_us": math.nan, "packets": 1},
        {"time_us": math.inf, "packets": 1},
        {"time_us": 1, "packets": math.inf},
        {"time_us": 1, "packets": None},
        {"time_us": 1, "packets": 1, "due_us": math.nan},
    ],
)
def test_a_frame_without_a_time_or_a_count_is_refused(header):
    with pytest.raises(VideoError, match="frame channel: bad header"):
        frame_of(**header)


def test_where_nobody_listens_the_place_is_named():
    with contextlib.closing(FrameServer("127.0.0.1", 0)) as server:
        port = server.port
    with pytest.raises(VideoError, match=f"no frame source at 127.0.0.1:{port}: "):
        FrameClient("127.0.0.1", port)


def test_a_port_that_is_taken_is_named():
    with contextlib.closing(FrameServer("127.0.0.1", 0)) as server:
        text = f"TCP 127.0.0.1:{server.port} cannot be bound: Address already in use"
        with pytest.raises(VideoError, match=text):
            FrameServer("127.0.0.1", server.port)


def test_without_a_companion_nothing_is_sent_or_answered():
    with contextlib.closing(FrameServer("127.0.0.1", 0)) as server:
        assert (server.connected, server.send(Frame(1.0)), server.answer(0.0)) == (
            False,
            False,
            None,
        )


def test_one_companion_at_a_time_and_the_next_once_it_is_gone():
    with contextlib.closing(FrameServer("127.0.0.1", 0, timeout=5.0)) as server:
        first = FrameClient("127.0.0.1", server.port)
        assert server.connected
        with contextlib.closing(FrameClient("127.0.0.1", server.port)) as second:
            assert server.send(Frame(1.0))
            assert first.waits(5.0)
            assert not second.waits()
            first.close()
            assert server.answer(5.0) is None
            assert server.send(Frame(2.0, packets=4))
            assert second.receive() == Frame(2.0, packets=4)
            second.answer(Answer(2.0, 5))
            assert server.answer(5.0) == Answer(2.0, 5)


def test_a_companion_that_reads_no_frame_is_disconnected_in_its_time():
    with contextlib.closing(FrameServer("127.0.0.1", 0, timeout=0.1)) as server:
        client = FrameClient("127.0.0.1", server.port)
        with contextlib.closing(client):
            picture = np.zeros((2000, 2000, 3), np.uint8)
            sent = [server.send(Frame(float(n), {"image": picture})) for n in range(8)]
    assert not all(sent)
    assert sent.index(False) < 8
    assert not server._stream


@pytest.mark.parametrize("header", [{"time_us": 1, "packets": 1}, {"time_us": math.nan}, {}])
def test_an_answer_that_is_none_disconnects(header):
    server = FrameServer("127.0.0.1", 0)
    with (
        contextlib.closing(server),
        socket.create_connection(("127.0.0.1", server.port)) as line,
    ):
        assert server.connected
        line.sendall(record(of(**header)))
        assert server.answer(5.0) is None
        assert line.recv(1) == b""


def test_an_answer_tells_whether_the_mission_is_over():
    with contextlib.closing(FrameServer("127.0.0.1", 0)) as server:
        with socket.create_connection(("127.0.0.1", server.port)) as line:
            assert server.connected
            line.sendall(record(of(time_us=2_500_000, packets=7, done=1)))
            assert server.answer(5.0) == Answer(2.5, 7, done=True)
        with contextlib.closing(FrameClient("127.0.0.1", server.port)):
            assert server.answer(5.0) is None  # the first is gone
            assert server.connected


def test_a_companion_waits_for_its_server_so_long(monkeypatch):
    seen = []

    def connect(place, timeout):
        seen.append((place, timeout))
        raise ConnectionRefusedError("no")

    monkeypatch.setattr(video.socket, "create_connection", connect)
    for options in ({}, {"timeout": 2.0}):
        with pytest.raises(VideoError, match="no frame source at h:1: no"):
            FrameClient("h", 1, **options)
    assert seen == [(("h", 1), 10.0), (("h", 1), 2.0)]
