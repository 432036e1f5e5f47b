"""Time, file and command protocols of the emulated vehicle, on messages."""

import math
import struct

from hypothesis import given, settings
from hypothesis import strategies as st

from mavlink_bridge.wire.messages import (
    Command,
    CommandAck,
    FileTransfer,
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


def test_file_transfer_is_refused_at_once(make_flight):
    f = make_flight()
    request = struct.pack("<HBBBBBBI", 7, 0, 4, 3, 0, 0, 0, 0).ljust(251, b"\0")
    (reply,) = f.send(FileTransfer(1, 1, request))
    sequence, _, opcode, size, asked = struct.unpack_from("<HBBBB", reply.payload)
    assert (sequence, opcode, size, asked) == (8, 129, 1, 4)
    assert len(reply.payload) == 251


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
