"""Parameter, mission, stream, time and file protocols of the emulated vehicle, on messages."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import (
    Attitude,
    AutopilotVersion,
    Command,
    CommandAck,
    ExtendedSystemState,
    FileTransfer,
    Heartbeat,
    HomePosition,
    LocalPosition,
    MissionAck,
    MissionClearAll,
    MissionCount,
    MissionCurrent,
    MissionItem,
    MissionItemReached,
    MissionRequest,
    MissionRequestList,
    MissionSetCurrent,
    Odometry,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    Received,
    RequestDataStream,
    Source,
    StatusText,
    TimeSync,
)
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.estimator import SensorNoise
from sitl_sim.vehicles.firmware.flavour import Mode
from sitl_sim.vehicles.rigid_body import Airframe, Vehicles

REAL32, INT32 = 9, 6
NAN = math.nan
OPEN = 2**31 - 1


def as_float(value):
    return struct.unpack("<f", struct.pack("<i", value))[0]


# Parameters.


def test_all_parameters_once_and_in_order(make_flight):
    f = make_flight()
    values = f.send(ParamRequestList(1, 1))
    assert [v.index for v in values] == list(range(len(values)))
    assert {v.count for v in values} == {len(values)}
    assert len({v.name for v in values}) == len(values)
    assert all(len(v.name) <= 16 for v in values)
    hover = next(v for v in values if v.name == "MPC_THR_HOVER")
    assert hover.value == pytest.approx(0.333, abs=1e-3)


def test_parameter_by_name_and_by_index(make_flight):
    f = make_flight()
    (by_name,) = f.send(ParamRequestRead(1, 1, "MIS_TAKEOFF_ALT", -1))
    (by_index,) = f.send(ParamRequestRead(1, 1, "", by_name.index))
    assert by_name == by_index
    assert by_name.value == 2.5
    assert f.send(ParamRequestRead(1, 1, "NO_SUCH", -1)) == []
    assert f.send(ParamRequestRead(1, 1, "", 9999)) == []


def test_set_parameter_is_echoed_and_used(make_flight):
    f = make_flight()
    (echo,) = f.send(ParamSet(1, 1, "MIS_TAKEOFF_ALT", 4.0, REAL32))
    assert (echo.name, echo.value) == ("MIS_TAKEOFF_ALT", 4.0)
    f.in_the_air()
    assert f.vehicles.p[0, 2] == pytest.approx(4.0, abs=0.3)


def test_int32_crosses_bytewise(make_flight):
    f = make_flight()
    (echo,) = f.send(ParamSet(1, 1, "COM_OBL_RC_ACT", as_float(3), INT32))
    assert echo.param_type == INT32
    assert struct.pack("<f", echo.value) == struct.pack("<i", 3)
    assert f.autopilots.units[0].parameters["COM_OBL_RC_ACT"] == 3.0


def test_nan_changes_nothing(make_flight):
    f = make_flight()
    (echo,) = f.send(ParamSet(1, 1, "MIS_TAKEOFF_ALT", NAN, REAL32))
    assert echo.value == 2.5


# Missions.


def item(seq, command, x=0.0, y=0.0, z=3.0, params=(0.0, 0.0, 0.0, NAN)):
    return MissionItem(1, 1, seq, 6, command, 0, 1, params, x, y, z)


def square(f):
    """Take-off, three points 5 m around, and land at the last: with degrees."""
    ref = f.autopilots.units[0].frame.reference
    points = [(5.0, 0.0), (5.0, 5.0), (0.0, 5.0)]
    items = [item(0, 22)]
    items += [item(k + 1, 16, *ref.to_degrees(*p)) for k, p in enumerate(points)]
    return [*items, item(4, 21, *ref.to_degrees(*points[-1]))]


def upload(f, items):
    replies = f.send(MissionCount(1, 1, len(items)))
    while isinstance(replies[0], MissionRequest):
        replies = f.send(items[replies[0].seq])
    return replies[0]


def test_mission_round_trip(make_flight):
    f = make_flight()
    items = square(f)
    assert upload(f, items) == MissionAck(255, 190, 0)
    (count,) = f.send(MissionRequestList(1, 1))
    assert count == MissionCount(255, 190, 5)
    for sent in items:
        (got,) = f.send(MissionRequest(1, 1, sent.seq))
        assert (got.seq, got.command, got.x_deg, got.y_deg, got.z, got.frame) == (
            sent.seq,
            sent.command,
            sent.x_deg,
            sent.y_deg,
            sent.z,
            sent.frame,
        )
        assert got.current == (sent.seq == 0)
    assert f.send(MissionRequest(1, 1, 7))[0].result != 0
    assert f.send(MissionSetCurrent(1, 1, 2)) == [MissionCurrent(2)]
    assert f.send(MissionClearAll(1, 1)) == [MissionAck(255, 190, 0)]
    assert f.send(MissionRequestList(1, 1)) == [MissionCount(255, 190, 0)]


def test_a_repeated_item_does_no_harm(make_flight):
    f = make_flight()
    items = square(f)
    f.send(MissionCount(1, 1, 5))
    f.send(items[0])
    (again,) = f.send(items[0])
    assert again == MissionRequest(255, 190, 1)
    for sent in items[1:]:
        (last,) = f.send(sent)
    assert last == MissionAck(255, 190, 0)


def test_unknown_items_are_refused_and_the_old_mission_stays(make_flight):
    f = make_flight()
    upload(f, square(f))
    assert upload(f, [item(0, 9999)]).result == 3
    assert len(f.autopilots.units[0].missions.items) == 5


@pytest.mark.parametrize(
    ("command", "x", "y", "z", "result"),
    [
        (16, NAN, 8.0, 3.0, 10),
        (16, 500.0, 8.0, 3.0, 10),
        (21, -90.1, 8.0, 3.0, 10),
        (16, 47.0, NAN, 3.0, 11),
        (22, 47.0, 180.1, 3.0, 11),
        (22, 47.0, -math.inf, 3.0, 11),
        (16, 47.0, 8.0, NAN, 12),
        (22, 47.0, 8.0, math.inf, 12),
        (22, NAN, NAN, NAN, 12),
    ],
)
def test_a_place_that_is_none_on_earth_is_refused(make_flight, command, x, y, z, result):
    f = make_flight()
    upload(f, square(f))
    assert upload(f, [item(0, command, x, y, z)]) == MissionAck(255, 190, result)
    assert len(f.autopilots.units[0].missions.items) == 5


@pytest.mark.parametrize(
    ("sent", "told"),
    [
        (item(0, 22, NAN, NAN), (OPEN, OPEN)),
        (item(0, 21, NAN, NAN, NAN), (OPEN, OPEN)),
        (item(0, 530, NAN, 1e9), (OPEN, OPEN)),
        (item(0, 178, 500.0, -500.0), (OPEN, -OPEN - 1)),
    ],
)
def test_whatever_was_uploaded_can_be_asked_for(make_flight, sent, told):
    f, wire = make_flight(), Codec(1, 1)
    assert upload(f, [sent]) == MissionAck(255, 190, 0)
    (message,) = mavlink.MAVLink(None).parse_buffer(wire.encode(f.send(MissionRequest(1, 1, 0))))
    assert (message.x, message.y) == told
    (heard,) = wire.decode(wire.encode(f.send(MissionRequest(1, 1, 0))))
    assert math.isnan(heard.message.x_deg) or not math.isnan(sent.x_deg)


@pytest.mark.parametrize("yaw_offset", [0.0, 1.0])
def test_mission_is_flown(make_flight, yaw_offset):
    f = make_flight(yaw_offset=[yaw_offset])
    upload(f, square(f))
    assert f.command(400, 1) == 0
    assert f.command(300, 0, 0) == 0
    path = []
    landed = f.run(90.0, lambda: path.append(f.vehicles.p[0].copy()) or not f.commander.armed)
    assert landed
    reached = [m.seq for m in f.heard[0] if isinstance(m, MissionItemReached)]
    assert reached == [0, 1, 2, 3, 4]
    frame = f.autopilots.units[0].frame
    own = np.array([frame.point(p) for p in path])
    for x, y in ((5, 0), (5, 5), (0, 5)):
        assert np.hypot(own[:, 0] - x, own[:, 1] - y).min() < 2.1
    np.testing.assert_allclose(own[-1, :2], [0, 5], atol=1.1)


def test_items_without_a_place_are_done_at_once(make_flight):
    """A change of speed leads nowhere, whatever its coordinates say."""
    f = make_flight(noise=SensorNoise.none())
    slow = item(1, 178, params=(1.0, 1.0, -1.0, 0.0), z=0.0)
    ref = f.autopilots.units[0].frame.reference
    upload(f, [item(0, 22), slow, item(2, 16, *ref.to_degrees(8.0, 0.0))])
    f.command(400, 1)
    f.command(300, 0, 0)
    f.run(4.0)
    speeds = []
    f.run(5.0, lambda: speeds.append(f.vehicles.v[0, 0]) and False)
    assert f.vehicles.p[0, 2] > 2.5
    assert max(speeds) == pytest.approx(1.0, abs=0.15)
    assert f.run(20.0, lambda: f.commander.mode is Mode.HOLD)
    assert [m.seq for m in f.heard[0] if isinstance(m, MissionItemReached)] == [0, 1, 2]
    f.command(300, 0, 0)  # again, from the start
    assert f.commander.mode is Mode.MISSION


def test_what_is_said_for_hours_is_told_once_and_not_kept(make_flight):
    f = make_flight()
    for k in range(1, 1001):
        f.command(176, 1, 6)  # offboard without setpoints: refused, in words
        f.autopilots.units[0].guidance.reached.append(k)
        heard = f.autopilots.telemetry(0, "gcs") + f.autopilots.telemetry(0, "companion")
        told = [m for m in heard if isinstance(m, StatusText)]
        assert len(told) == 2
        assert heard.count(MissionItemReached(k)) == 2
    for _ in range(1000):  # of more than is kept at once, the newest
        f.command(176, 1, 6)
    told = [m for m in f.autopilots.telemetry(0, "gcs") if isinstance(m, StatusText)]
    assert told == f.autopilots.status_texts(0)
    assert 10 < len(told) <= 100
    assert not f.autopilots.units[0].guidance.reached
    assert not [m for m in f.autopilots.telemetry(0, "gcs") if isinstance(m, StatusText)]


def test_a_pilot_interrupts_a_mission(make_flight):
    f = make_flight()
    upload(f, square(f))
    f.command(400, 1)
    f.command(176, 1, 4, 4)
    f.run(5.0)
    assert f.commander.mode is Mode.MISSION
    f.command(176, 1, 4, 3)
    f.run(3.0)
    assert np.linalg.norm(f.vehicles.v[0]) < 0.3


# Streams and requests.


def test_request_message(make_flight):
    f = make_flight()
    for number, kind in ((148, AutopilotVersion), (242, HomePosition), (245, ExtendedSystemState)):
        ack, message = f.send(Command(512, (number, NAN, NAN, NAN, NAN, NAN, NAN), 1))
        assert ack == CommandAck(512, 0, 255, 190)
        assert isinstance(message, kind)
    assert isinstance(f.send(Command(410, (0.0,) * 7, 1))[1], HomePosition)
    assert f.command(512, 9999) == 2
    assert f.command(512, NAN) == 2


def test_message_interval_belongs_to_the_asking_link(make_flight):
    f = make_flight()
    assert f.command(511, 31, 4000) == 0
    assert f.command(511, 31, -1, source=Source(1, 191)) == 0
    counts = {"gcs": 0, "companion": 0}
    for k in range(1, 501):
        f.autopilots.advance(k * 0.002)
        for link in counts:
            heard = f.autopilots.telemetry(0, link)
            counts[link] += sum(type(m) is Attitude for m in heard)
    assert counts["gcs"] == pytest.approx(250, abs=3)
    assert counts["companion"] == 0
    assert f.command(511, 31, 0, source=Source(1, 191)) == 0
    assert f.autopilots.units[0].schedules["companion"].rate(31) == 50.0


def test_odometry_comes_when_asked_for_and_says_what_the_others_say(make_flight):
    f = make_flight()
    assert f.command(511, 331, 20000) == 0
    assert f.command(511, 32, 20000) == 0
    f.run(1.0)
    odometry = {m.time: m for m in f.heard[0] if isinstance(m, Odometry)}
    positions = {m.time: m for m in f.heard[0] if isinstance(m, LocalPosition)}
    assert len(odometry.keys() & positions.keys()) >= 45
    for time in odometry.keys() & positions.keys():
        np.testing.assert_array_equal(odometry[time].p, positions[time].p)


def test_request_data_stream(make_flight):
    f = make_flight()
    f.send(RequestDataStream(1, 1, 6, 25.0, True))
    f.run(1.1)
    positions = [m for m in f.heard[0] if isinstance(m, LocalPosition)]
    assert len(positions) == pytest.approx(27, abs=2)
    f.send(RequestDataStream(1, 1, 0, 1.0, False))
    f.heard[0].clear()
    f.run(2.0)
    assert not [m for m in f.heard[0] if isinstance(m, LocalPosition)]
    assert [m for m in f.heard[0] if isinstance(m, Heartbeat)]


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


def test_unknown_commands_are_unsupported_and_others_targets_left_alone(make_flight):
    f = make_flight()
    assert f.command(31000) == 3
    assert f.send(Command(400, (1, 0, 0, 0, 0, 0, 0), 9)) == []
    assert f.send(Command(400, (1, 0, 0, 0, 0, 0, 0), 1, 191)) == []
    assert not f.commander.armed


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
