"""Frames as pymavlink packs them from literal fields, kept here as bytes, in both directions.

A sign or an axis that both directions have wrong is right after every round trip. The bytes were
packed from wire fields in NED and FRD that are in the comments; the expected values are those
fields, turned into ENU and FLU by hand. All are sequence number 7 of system 1, component 1.
"""

import math

import numpy as np
import pytest

from mavlink_bridge.wire import messages as m
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.signing import Signing
from tests.mavlink_bridge.wire.test_codec import same

NORTH = np.array([math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])  # q = 1, 0, 0, 0: level, nose north
TURNS = np.array([0.125, -0.25, -0.5])  # roll right 0.125, pitch up 0.25, yaw right 0.5 rad/s
PLACE = np.array([2.0, 1.0, 3.0])  # x = 1 north, y = 2 east, z = -3 down
KEY, STAMP = bytes(range(32)), 4_000_000_000_000  # of the signed frames; link 3

FRAMES = [
    pytest.param(
        "fd09000007010100000000000600020c8104039123",
        m.Heartbeat(12, 2, True, 0x00060000, 4, 0x81),
        id="HEARTBEAT",
    ),
    pytest.param(
        "fd2000000701011f0000d00700000000803f0000000000000000000000000000003e0000803e0000003f1f77",
        m.Attitude(2.0, NORTH, TURNS),
        id="ATTITUDE_QUATERNION",
    ),
    pytest.param(
        "fd1c00000701011e0000d00700000000000000000000000000000000003e0000803e0000003fc481",
        m.EulerAttitude(2.0, NORTH, TURNS),
        id="ATTITUDE",
    ),
    pytest.param(
        "fd250000070101530000d00700000000803f0000000000000000000000000000003e0000803e0000003f"
        "0000403f07a7cf",
        m.AttitudeTarget(2.0, NORTH, TURNS, 0.75, 7),
        id="ATTITUDE_TARGET",
    ),
    # vx 0.5, vy -0.25, vz 0.75
    pytest.param(
        "fd1c0000070101200000d00700000000803f00000040000040c00000003f000080be0000403f6fb6",
        m.LocalPosition(2.0, PLACE, np.array([-0.25, 0.5, -0.75])),
        id="LOCAL_POSITION_NED",
    ),
    # body FRD: vx 1, vy 0.5, vz 0.25; variances 0.25, 1, 4; of the attitude 0.0625, 0.25, 1
    pytest.param(
        "fde900000701014b010080841e00000000000000803f00000040000040c00000803f0000000000000000"
        "000000000000803f0000003f0000803e0000003e0000803e0000003f0000803e00000000000000000000"
        "000000000000000000000000803f00000000000000000000000000000000000080400000000000000000"
        "000000000000803d00000000000000000000803e000000000000803f0000803e00000000000000000000"
        "000000000000000000000000803f00000000000000000000000000000000000080400000000000000000"
        "00000000000000000000000000000000000000000000000000000000010c03085a9198",
        m.Odometry(
            2.0,
            PLACE,
            np.array([0.5, 1.0, -0.25]),
            NORTH,
            TURNS,
            position_sigma=np.array([1.0, 0.5, 2.0]),
            velocity_sigma=np.array([1.0, 0.5, 2.0]),
            attitude_sigma=np.array([0.25, 0.5, 1.0]),
            resets=3,
            estimator=8,
            quality=90,
        ),
        id="ODOMETRY",
    ),
    # vx 100, vy -50, vz 25 cm/s; heading 9000 cdeg
    pytest.param(
        "fd1c0000070101210000d0070000c0e3121c8038e30420a10700d00700006400ceff19002823ded2",
        m.GlobalPosition(2.0, 47.1, 8.2, 500.0, 2.0, np.array([-0.5, 1.0, -0.25]), math.pi / 2),
        id="GLOBAL_POSITION_INT",
    ),
    pytest.param(
        "fd0a00000701014d0000900101000000000001bf4deb",
        m.CommandAck(400, 1, 1, 191),
        id="COMMAND_ACK",
    ),
    pytest.param(
        "fd1900000701011600000000003f0a0003004d50435f5448525f484f564552000000099f50",
        m.ParamValue("MPC_THR_HOVER", 0.5, 9, 10, 3),
        id="PARAM_VALUE",
    ),
    pytest.param(
        "fd0f0000070101fd00000461726d696e6720726566757365649271",
        m.StatusText(4, "arming refused"),
        id="STATUSTEXT",
    ),
    pytest.param(
        "fd020000070101f5000000029c2a",
        m.ExtendedSystemState(2),
        id="EXTENDED_SYS_STATE",
    ),
    pytest.param(
        "fd0c00000701016f0000002f68590000000000f902957165",
        m.TimeSync(1500000000, 2500000000),
        id="TIMESYNC",
    ),
    pytest.param(
        "fd2a0000070101e6000080841e00000000000000803e0000003f0000003e0000403f0000803d00000000"
        "0000003f0000803e3f0352e6",
        m.EstimatorStatus(2.0, 831, 0.5, 0.25, 0.25, 0.5, 0.125, 0.75, 0.0625),
        id="ESTIMATOR_STATUS",
    ),
    pytest.param(
        "fd270000070101840000d00700000a00b0049b0000001904000000000000000000000000000000000000"
        "0000000000006400fb",
        m.DistanceSensor(2.0, 1.55, 0.1, 12.0, 25, 0, 0.02, 100),
        id="DISTANCE_SENSOR",
    ),
    # roll 0.125, pitch -0.25, yaw -0.5 rad/s; thrust 0.375; mask 0x80
    pytest.param(
        "fd270000070101520000dc0500000000803f0000000000000000000000000000003e000080be000000bf"
        "0000c03e010180423c",
        m.RateSetpoint(1.5, np.array([0.125, 0.25, 0.5]), 0.375, 1, q_wb=NORTH),
        id="SET_ATTITUDE_TARGET",
    ),
    pytest.param(
        "fd2000000701014c00000000803f00000000000000000000000000000000000000000000000090010101a00f",
        m.Command(400, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 1, 1),
        id="COMMAND_LONG",
    ),
    pytest.param(
        "fd110000070101140000ffff01014d50435f5448525f484f564552707a",
        m.ParamRequestRead(1, 1, "MPC_THR_HOVER", -1),
        id="PARAM_REQUEST_READ",
    ),
    pytest.param(
        "fd0e000007010104000080841e00000000000500000001bfbe74",
        m.Ping(2.0, 5, 1, 191),
        id="PING",
    ),
]
SIGNED_HEARTBEAT = "fd09010007010100000000000600020c81040376db0300409452a3036c3b22e8d498"
SIGNED_SETPOINT = (  # of component 191, sequence number 0
    "fd2701000001bf520000dc0500000000803f0000000000000000000000000000003e000080be000000bf"
    "0000c03e0101800e040300409452a303d5b2a588c119"
)


@pytest.mark.parametrize(("frame", "message"), FRAMES)
def test_the_bytes_are_read_as_their_fields_say(frame, message):
    received = Codec(1, 191).decode(bytes.fromhex(frame))
    assert [r.source for r in received] == [m.Source(1, 1)]
    assert same(received[0].message, message), received[0].message


@pytest.mark.parametrize(("frame", "message"), FRAMES)
def test_the_message_is_written_as_the_same_bytes(frame, message):
    codec = Codec(1, 1)
    codec._sequence = 7
    assert Codec(1, 191).decode(bytes.fromhex(frame))  # a frame
    written = codec.encode([message]).hex()
    if isinstance(message, m.Odometry):  # its velocity goes out along the body, in float32
        assert same(Codec(1, 191).decode(bytes.fromhex(written))[0].message, message)
    else:
        assert written == frame


def test_a_setpoint_that_pitches_up_has_a_positive_pitch_rate_on_the_wire():
    """In FLU pitching up is negative, about the axis to the left; in FRD it is positive."""
    frame = Codec(1, 191).encode([m.RateSetpoint(1.5, np.array([0.0, -0.25, 0.0]), 0.375, 1)])
    rates = np.frombuffer(frame[10 + 20 : 10 + 32], "<f4")  # behind time and quaternion
    assert rates.tolist() == [0.0, 0.25, 0.0]


def test_a_signed_frame_of_another_implementation_is_heard():
    codec = Codec(1, 191, [m.Source(1, 1)], Signing(KEY, STAMP - 5))
    data = bytes.fromhex(SIGNED_HEARTBEAT)
    assert codec.decode(data)[0].message == m.Heartbeat(12, 2, True, 0x00060000, 4, 0x81)
    assert codec.decode(data) == []  # played back
    for at in range(len(data)):
        other = Codec(1, 191, [m.Source(1, 1)], Signing(KEY, STAMP - 5))
        assert other.decode(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]) == [], at


def test_a_signed_setpoint_is_what_another_implementation_would_send():
    codec = Codec(1, 191, signing=Signing(KEY, STAMP, link_id=3))
    setpoint = m.RateSetpoint(1.5, np.array([0.125, 0.25, 0.5]), 0.375, 1)
    assert codec.encode([setpoint]).hex() == SIGNED_SETPOINT
