"""Time, file and command protocols of the emulated vehicle, on messages."""

import math
import struct

from hypothesis import given, settings
from hypothesis import strategies as st

from mavlink_bridge.wire.messages import (
    Command,
    CommandAck,
    FileTransfer,
    Ping,
    Received,
    Source,
    TimeSync,
)
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.rigid_body import Vehicles


def test_timesync_answers_with_the_boot_clock(make_flight):
    f = make_flight(boot_offset=[3.0])
    f.run(1.0)
    (reply,) = f.send(TimeSync(0, 123456789))
    assert reply.tc1 == 4_000_000_000
    assert reply.ts1 == 123456789
    assert f.send(TimeSync(5, 123456789)) == []


def file_request(f, opcode, path=b"", offset=0):
    """Sequence, opcode and content of the answer to a request with sequence 7."""
    head = struct.pack("<HBBBBBBI", 7, 0, opcode, len(path), 0, 0, 0, offset)
    (reply,) = f.send(FileTransfer(1, 1, (head + path).ljust(251, b"\0")))
    assert len(reply.payload) == 251
    sequence, _, answered, size, asked = struct.unpack_from("<HBBBB", reply.payload)
    assert asked == opcode
    return sequence, answered, reply.payload[12 : 12 + size]


def test_files_are_listed_and_none_can_be_opened(make_flight):
    f = make_flight()
    assert file_request(f, 3, b"/") == (8, 128, b"Dfs\0")
    assert file_request(f, 3, b"/fs/microsd") == (8, 128, b"Dlog\0")
    assert file_request(f, 3, b"/", 1) == (8, 129, b"\x06")  # end of file
    assert file_request(f, 3, b"/no") == (8, 129, b"\x0a")
    assert file_request(f, 4, b"@PARAM/param.pck") == (8, 129, b"\x0a")
    assert file_request(f, 5) == (8, 129, b"\x04")
    assert file_request(f, 2) == (8, 128, b"")
    assert file_request(f, 99) == (8, 129, b"\x07")


def test_a_ping_is_answered_to_its_sender(make_flight):
    f = make_flight()
    assert f.send(Ping(1.25, 9)) == [Ping(1.25, 9, 255, 190)]
    assert f.send(Ping(1.25, 9, 1, 1)) == []  # an answer


def test_requests_and_intervals_are_acknowledged_as_px4_does(make_flight):
    """Recorded from PX4 1.17: a running stream is denied (2), as it comes by itself anyway."""
    f = make_flight()
    for number in (24, 31, 32, 33, 42, 331, 999):
        assert f.command(512, number) == 2, number
    for number in (1, 2, 30, 147, 148, 230, 242, 245):
        assert f.command(512, number) == 0, number
    assert [f.command(511, number, 1e6) for number in (105, 83, 24, 999)] == [0, 0, 0, 4]


def test_unknown_commands_are_unsupported_and_other_targets_ignored(make_flight):
    f = make_flight()
    assert f.command(31000) == 3
    assert f.send(Command(400, (1, 0, 0, 0, 0, 0, 0), 9)) == []
    assert f.send(Command(400, (1, 0, 0, 0, 0, 0, 0), 1, 191)) == []
    assert not f.commander.armed


def test_any_source_may_command_but_the_target_must_match(make_flight):
    f = make_flight(2)
    assert f.send(Command(400, (1, 0, 0, 0, 0, 0, 0), 2), i=0, source=Source(7, 7)) == []
    assert f.send(Command(400, (1, 0, 0, 0, 0, 0, 0), 2), i=1, source=Source(7, 7)) != []


floats = st.one_of(
    st.sampled_from([math.nan, math.inf, -math.inf, 0.0, 1.0, 31.0, 1e-40, -1.0, 3e38]),
    st.floats(width=32),
    st.integers(-10, 600).map(float),
)


@settings(max_examples=200, deadline=None)
@given(st.sampled_from([20, 21, 22, 176, 300, 400, 410, 511, 512, 520]), st.tuples(*[floats] * 7))
def test_no_command_can_raise(command, params):
    a = Autopilots(Vehicles(Airframe(), [[0, 0, 0]], 0.0), [1])
    replies = a.receive(0, Received(Source(255, 190), Command(command, params, 1)))
    assert isinstance(replies[0], CommandAck)
