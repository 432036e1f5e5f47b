"""The frame channel: forms of its arrays, what crosses it, and its patience."""

import contextlib
import json
import socket
import struct

import numpy as np
import pytest

from mavlink_bridge.wire.video import Answer, Frame, FrameClient, FrameServer, VideoError


@contextlib.contextmanager
def channel(**options):
    """A simulator's end and a companion's, connected."""
    server = FrameServer("127.0.0.1", 0, **options)
    client = FrameClient("127.0.0.1", server.port)
    assert server.connected
    try:
        yield server, client
    finally:
        client.close()
        server.close()


def crossed(**arrays):
    """The arrays as the companion gets them."""
    with channel() as (server, client):
        assert server.send(Frame(1.0, arrays))
        return client.receive().arrays


@pytest.mark.parametrize(
    ("name", "shape", "dtype"),
    [
        ("image", (4, 5, 3), np.uint8),
        ("depth", (4, 5), np.float32),
        ("ranges", (4, 5), np.float32),
        ("neighbours", (2, 6), np.float64),
        ("neighbours", (0, 6), np.float64),
        ("trunks", (3, 6), np.float64),
        ("another", (2, 3, 4), np.uint16),  # a name that has no form is free
        ("another", (7,), np.float32),
    ],
)
def test_an_array_of_its_form_crosses_unchanged(name, shape, dtype):
    sent = np.arange(np.prod(shape)).reshape(shape).astype(dtype)
    (got,) = crossed(**{name: sent}).values()
    assert got.dtype == dtype
    assert got.shape == shape
    assert (got == sent).all()


@pytest.mark.parametrize(
    ("name", "shape", "dtype"),
    [
        ("image", (4, 5), np.uint8),
        ("image", (4, 5, 4), np.uint8),
        ("image", (4, 5, 3), np.float32),
        ("depth", (4, 5, 1), np.float32),
        ("depth", (4, 5), np.float64),
        ("ranges", (20,), np.float32),
        ("ranges", (4, 5), np.uint16),
        ("neighbours", (2, 5), np.float64),
        ("neighbours", (2, 6), np.float32),
        ("trunks", (6, 2), np.float64),
        ("trunks", (6,), np.float64),
    ],
)
def test_an_array_of_another_form_is_refused_by_name(name, shape, dtype):
    with pytest.raises(VideoError, match=f"{name} of "):
        crossed(**{name: np.zeros(shape, dtype)})


def test_a_frame_and_its_answer_cross_with_their_times_and_counts():
    with channel() as (server, client):
        assert server.send(Frame(1.250001, packets=7, due=1.375002))
        frame = client.receive()
        assert (frame.time, frame.packets, frame.due) == (1.250001, 7, 1.375002)
        assert server.send(Frame(2.5))
        frame = client.receive()
        assert (frame.time, frame.packets, frame.due) == (2.5, 0, None)
        assert server.answer(0.0) is None
        for answer in (Answer(1.250001, 3), Answer(2.5, 4, done=True)):
            client.answer(answer)
            assert server.answer(5.0) == answer


@pytest.mark.parametrize(
    ("options", "patience"),
    [
        ({}, None),
        ({"timeout": 7.5}, None),
        ({"timeout": 7.5, "lockstep": False}, None),
        ({"timeout": 7.5, "lockstep": True}, 7.5),
    ],
)
def test_only_a_simulator_in_lockstep_asks_for_its_own_patience(options, patience):
    server = FrameServer("127.0.0.1", 0, **options)
    with contextlib.closing(server), socket.create_connection(("127.0.0.1", server.port)) as tap:
        assert server.send(Frame(1.0))
        magic, length = struct.unpack("<4sI", tap.recv(8, socket.MSG_WAITALL))
        header = json.loads(tap.recv(length, socket.MSG_WAITALL))
    assert magic == b"SWF1"
    assert header.get("patience") == patience
    assert (header["time_us"], header["packets"], header["arrays"]) == (1000000, 0, [])
    assert "due_us" not in header


def test_the_patience_asked_for_is_not_shown_and_holds_from_then_on():
    with channel(timeout=7.5, lockstep=True) as (server, client):
        assert client._stream._socket.gettimeout() == 0.2
        assert server.send(Frame(1.0))
        assert client.receive().time == 1.0
        assert client._stream._socket.gettimeout() == 7.5


def test_a_companion_that_says_nonsense_is_disconnected_and_another_heard():
    with channel() as (server, client):
        client._stream.send({"time_us": 1})  # no packets
        assert server.answer(5.0) is None
        with contextlib.closing(FrameClient("127.0.0.1", server.port)) as other:
            assert server.connected
            other.answer(Answer(2.0, 1))
            assert server.answer(5.0) == Answer(2.0, 1)
