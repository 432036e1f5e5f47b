"""Codec: round trips, any chunking, any garbage."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink
from pymavlink.generator.mavcrc import x25crc

from mavlink_bridge.wire import messages as m
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.dialect import FROM_WIRE, TO_WIRE

EXAMPLES = [
    m.RateSetpoint(1.5, np.array([0.1, -0.2, 0.3]), 0.4, 3, q_wb=np.array([0.5, 0.5, -0.5, 0.5])),
    m.Heartbeat(12, 2, True, 0x00060000, 4, 0x81),
    m.Attitude(2.0, np.array([0.5, 0.5, -0.5, 0.5]), np.array([0.1, 0.2, 0.3])),
    m.AttitudeTarget(2.0, np.array([0.5, 0.5, -0.5, 0.5]), np.array([0.1, 0.2, 0.3]), 0.5, 7),
    m.LocalPosition(2.0, np.array([1.0, 2.0, 3.0]), np.array([0.5, -0.5, 0.25])),
    m.Odometry(
        2.0,
        np.array([1.0, 2.0, 3.0]),
        np.array([0.5, -0.5, 0.25]),
        np.array([0.5, 0.5, -0.5, 0.5]),
        np.array([0.1, 0.2, 0.3]),
    ),
    m.GlobalPosition(2.0, 47.1, 8.2, 500.0, 2.0, np.array([1.0, 0.5, 0.25]), math.radians(90)),
    m.Command(400, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 1, 1),
    m.CommandAck(400, 0, 1, 191),
    m.SetMode(1, 1, 0x00060000),
    m.StatusText(4, "arming refused: no position"),
    m.SystemStatus(7, 7, 7, 16.0, 2.5, 0.75, 0.25),
    m.BatteryStatus(16.0, 2.5, 0.75),
    m.ExtendedSystemState(2),
    m.HomePosition(47.1, 8.2, 500.0, np.array([0.0, 0.0, 1.0])),
    m.Odometry(
        2.0,
        np.array([1.0, 2.0, 3.0]),
        np.array([0.5, -0.5, 0.25]),
        np.array([math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]),
        np.array([0.1, 0.2, 0.3]),
        position_sigma=np.array([0.5, 0.25, 1.0]),
        velocity_sigma=np.array([0.1, 0.2, 0.4]),
        attitude_sigma=np.array([0.01, 0.02, 0.05]),
        resets=7,
        estimator=8,
        quality=90,
    ),
    m.GpsRaw(2.0, 6, 47.1, 8.2, 500.0, 9, 1.0, math.radians(60), 0.7, 1.1, 0.014, 0.02, 0.05),
    m.DistanceSensor(2.0, 1.55, 0.1, 12.0, 25, 0, 0.02, 100),
    m.EstimatorStatus(2.0, 831, 0.5, 0.25, 0.25, 0.5, 0.125, 0.75, 0.0625),
    m.AutopilotVersion(8, 0x010F00FF, 77),
    m.TimeSync(0, 123456789),
    m.SystemTime(12.5, 0.0),
    m.ParamRequestRead(1, 1, "MPC_THR_HOVER", -1),
    m.ParamRequestList(1, 1),
    m.ParamSet(1, 1, "MIS_TAKEOFF_ALT", 2.5, 9),
    m.ParamValue("SIXTEEN_LONG_NAM", 0.5, 9, 10, 3),
    m.MissionCount(1, 1, 3, 0),
    m.MissionRequestList(1, 1, 0),
    m.MissionRequest(1, 1, 2, 0),
    m.MissionItem(1, 1, 0, 6, 16, 1, 1, (0.0, 1.0, 0.0, 0.0), 47.1, 8.2, 5.0, 0),
    m.MissionAck(1, 1, 0, 0),
    m.MissionSetCurrent(1, 1, 2),
    m.MissionClearAll(1, 1, 0),
    m.MissionCurrent(2),
    m.MissionItemReached(1),
    m.RequestDataStream(1, 1, 0, 4, True),
    m.GpsInput(2.0, 3, 47.1, 8.2, 500.0, np.array([1.0, 0.5, 0.25]), 9),
    m.GpsInput(2.0, 3, 47.1, 8.2, 500.0, np.array([1.0, 0.5]), 9),
    m.GpsInput(2.0, 3, 47.1, 8.2, 500.0, None, 9),
    m.ParamError(1, 191, "COM_OBL_RC_ACT", -1, 7),
    m.Event(2.0, 0x0102089D, 7, 2, bytes([0, 64, 0, 0, 20]).ljust(40, b"\0")),
    m.NamedValue(2.0, "tick_p99", 12.5),
    m.NamedValue(2.0, "phase", 4),
    m.ComponentInformation(2.0, 8196, "swarm", "companion", "0.1.0", "1398210561"),
    m.CameraInformation(2.0, "swarm", "forward", 2.1, 3.6, 2.7, 640, 400, 1),
    m.Ping(2.0, 5, 1, 191),
    m.MissionRequest(1, 1, 2, 0, floating=True),
    m.MissionItem(1, 1, 0, 3, 16, 1, 1, (0.0, 1.0, 0.0, 0.0), 47.1, 8.2, 5.0, 0, floating=True),
    m.EulerAttitude(2.0, np.array([0.8, 0.2, -0.4, 0.4]), np.array([0.1, 0.2, 0.3])),
]


def same(a, b):
    """Return whether all fields are equal; floats and arrays within float32."""
    if type(a) is not type(b):
        return False
    for name in a.__dataclass_fields__:
        x, y = getattr(a, name), getattr(b, name)
        if isinstance(x, float | np.ndarray | tuple):
            if not np.allclose(x, y, rtol=1e-6, atol=1e-6):
                return False
        elif x != y:
            return False
    return True


def test_every_message_is_the_same_after_a_round_trip():
    for example in EXAMPLES:
        out = Codec(1, 1).decode(Codec(7, 191).encode([example]))
        assert len(out) == 1
        assert out[0].source == m.Source(7, 191)
        if isinstance(example, m.Heartbeat):  # the armed flag is part of base_mode
            assert out[0].message.armed
            assert out[0].message.custom_mode == example.custom_mode
        else:
            assert same(out[0].message, example), out[0].message


@given(st.lists(st.integers(1, 40), max_size=40))
def test_any_chunking_gives_the_same_messages(cuts):
    stream = Codec(7, 191).encode(EXAMPLES)
    codec, got, at = Codec(1, 1), [], 0
    for cut in cuts:
        got += codec.decode(stream[at : at + cut])
        at += cut
    got += codec.decode(stream[at:])
    assert [type(r.message) for r in got] == [type(e) for e in EXAMPLES]


@given(st.binary(max_size=400), st.binary(max_size=400))
def test_garbage_raises_no_error_and_hides_no_good_frame(before, after):
    good = Codec(7, 191).encode([EXAMPLES[2]] * 12)
    codec = Codec(1, 1)
    got = codec.decode(before) + codec.decode(good) + codec.decode(after)
    # An incomplete false start may hold the first frames back.
    assert sum(isinstance(r.message, m.Attitude) for r in got) >= 5
    assert len(codec._buffer) <= 600


@given(st.data())
def test_a_flipped_bit_is_refused(data):
    frame = bytearray(Codec(7, 191).encode([EXAMPLES[3]]))
    bit = data.draw(st.integers(8, len(frame) * 8 - 1))
    frame[bit // 8] ^= 1 << bit % 8
    codec = Codec(1, 1)
    assert not [r for r in codec.decode(bytes(frame)) if isinstance(r.message, m.LocalPosition)]


def test_odometry_has_its_velocity_along_the_body_or_the_world():
    north = np.array([math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])  # nose north
    sent = m.Odometry(2.0, np.array([1.0, 2.0, 3.0]), np.array([0.0, 1.5, 0.5]), north, np.zeros(3))
    wire = TO_WIRE[m.Odometry](sent)
    assert (wire.vx, wire.vy, wire.vz) == pytest.approx((1.5, 0.0, -0.5), abs=1e-6)
    wire = wire._replace(child_frame_id=1)  # MAV_FRAME_LOCAL_NED
    np.testing.assert_allclose(FROM_WIRE[331](wire).v, [0.0, 1.5, 0.5], atol=1e-6)
    wire = wire._replace(frame_id=20)  # MAV_FRAME_LOCAL_FRD does not point north
    assert np.isnan(FROM_WIRE[331](wire).p).all()


def test_odometry_covariances_are_in_the_frames_of_its_pose_and_velocity():
    """Along north, east, down, and along the body: forward is north here."""
    north = np.array([math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])
    zero = np.zeros(3)
    east = np.array([0.5, 0.25, 1.0])  # m: most doubt is about the height, then about east
    sent = m.Odometry(
        2.0, zero, zero, north, zero, east, np.array([0.1, 0.2, 0.4]), np.full(3, 0.1)
    )
    wire = TO_WIRE[m.Odometry](sent)
    assert wire.pose_covariance[0] == pytest.approx(0.0625)  # north
    assert wire.pose_covariance[6] == pytest.approx(0.25)  # east
    assert wire.velocity_covariance[0] == pytest.approx(0.04)  # forward
    assert wire.velocity_covariance[6] == pytest.approx(0.01)  # right
    wire = wire._replace(child_frame_id=1)  # MAV_FRAME_LOCAL_NED: so along north and east
    np.testing.assert_allclose(FROM_WIRE[331](wire).velocity_sigma, [0.1, 0.2, 0.4])
    nowhere = (math.nan,) * 21
    wire = wire._replace(pose_covariance=nowhere, velocity_covariance=nowhere)
    assert FROM_WIRE[331](wire).position_sigma is None
    assert FROM_WIRE[331](wire).velocity_sigma is None
    wire = wire._replace(pose_covariance=(-1.0,) * 21)
    assert FROM_WIRE[331](wire).position_sigma is None


@pytest.mark.parametrize("off", [0.0, 3e-5, -3e-5])
def test_a_course_is_less_than_a_full_turn(off):
    """A course just west of north must not round to 36000, which MAVLink does not have."""
    north = np.array([-math.sin(off), math.cos(off), 0.0])
    for message in (
        m.GpsRaw(1.0, 3, 47.1, 8.2, 500.0, 9, 1.0, math.pi / 2 + off),
        m.HilGps(1.0, 47.1, 8.2, 500.0, 300.0 * north),
        m.GlobalPosition(2.0, 47.1, 8.2, 500.0, 2.0, north, 2 * math.pi - 1e-6),
    ):
        (sent,) = mavlink.MAVLink(None).parse_buffer(Codec(1, 1).encode([message]))
        course = sent.hdg if isinstance(message, m.GlobalPosition) else sent.cog
        assert course < 36000
        assert min(course, 36000 - course) <= 1


@pytest.mark.parametrize("flags", [0x02, 0x80])
def test_a_frame_with_unknown_flags_is_discarded(flags):
    frame = bytearray(Codec(7, 191).encode([EXAMPLES[2]]))
    frame[2] = flags  # incompat_flags, with a correct checksum
    kind = mavlink.mavlink_map[mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION]
    crc = x25crc(frame[1:-2] + bytes([kind.crc_extra])).crc
    frame[-2:] = crc.to_bytes(2, "little")
    codec = Codec(1, 1)
    assert codec.decode_datagram(bytes(frame)) == []
    assert codec.statistics.bad_bytes == len(frame)
    frame[2] = 0
    frame[-2:] = x25crc(frame[1:-2] + bytes([kind.crc_extra])).crc.to_bytes(2, "little")
    assert len(codec.decode_datagram(bytes(frame))) == 1


def test_attitude_target_of_a_literal_frame():
    """The frame: level, facing north, rates 0.1, 0.2, 0.3 rad/s FRD, thrust 0.57, at 4.321 s."""
    payload = struct.pack("<I8fB", 4321, 1, 0, 0, 0, 0.1, 0.2, 0.3, 0.57, 0)
    head = bytes([0xFD, len(payload.rstrip(b"\0")), 0, 0, 9, 1, 1, 83, 0, 0])
    crc = x25crc(head[1:] + payload.rstrip(b"\0") + bytes([22]))  # 22: CRC_EXTRA of message 83
    frame = head + payload.rstrip(b"\0") + struct.pack("<H", crc.crc)
    (received,) = Codec(1, 191, [m.Source(1, 1)]).decode_datagram(frame)
    target = received.message
    assert isinstance(target, m.AttitudeTarget)
    assert (target.time, target.type_mask) == (4.321, 0)
    assert target.thrust == pytest.approx(0.57)
    assert target.omega == pytest.approx([0.1, -0.2, -0.3])  # FLU
    assert np.abs(target.q_wb) == pytest.approx([math.sqrt(0.5), 0, 0, math.sqrt(0.5)])


def test_a_simulated_fix_tells_both_accuracies_in_centimetres():
    fix = m.HilGps(2.5, 47.25, -8.5, 430.5, np.array([3.0, 4.0, 0.5]), 0.75, 1.25)
    (wire,) = mavlink.MAVLink(None).parse_buffer(Codec(1, 1).encode([fix]))
    assert (wire.eph, wire.epv) == (75, 125)
    assert (wire.lat, wire.lon, wire.alt) == (472500000, -85000000, 430500)
    assert (wire.vn, wire.ve, wire.vd, wire.vel) == (400, 300, -50, 500)
    assert (wire.time_usec, wire.fix_type) == (2500000, 3)


FALSE_STARTS = [
    bytes([0xFD, 255, 0]),  # a frame longer than the datagram
    bytes([0xFD, 0, 0, 0, 0, 1, 1, 0, 0, 0, 9, 9]),  # a HEARTBEAT with a wrong checksum
]


@pytest.mark.parametrize("starts", [FALSE_STARTS[:1], FALSE_STARTS[1:], FALSE_STARTS])
def test_a_datagram_with_sixteen_false_starts_is_garbage(starts):
    good = Codec(7, 191).encode([EXAMPLES[2]])
    for count in (0, 1, 15, 16, 17):
        codec = Codec(1, 1)
        before = b"".join(starts[n % len(starts)] for n in range(count))
        assert len(codec.decode_datagram(before + good)) == (count < 16), count
        assert codec.statistics.bad_bytes == len(before) + (0 if count < 16 else len(good))


def test_false_starts_of_a_stream_hide_no_frame():
    good = Codec(7, 191).encode([EXAMPLES[2]])
    codec, before = Codec(1, 1), FALSE_STARTS[1] * 40
    assert len(codec.decode(before + good)) == 1
    assert codec.statistics.bad_bytes == len(before)
    assert codec.statistics.bad_frames == 40
