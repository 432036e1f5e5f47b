"""Where a simulated vehicle truly is, from the bytes in which PX4 tells it."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import HilState
from sitl_sim.external.true_motion import TrueMotion

LATITUDE, LONGITUDE = 473977420, 85455940  # 1e-7 deg
METRE_NORTH = 89.9  # of these, about


def sent(north, altitude=488.0, vx=100, q=(1.0, 0.0, 0.0, 0.0)):
    """The message of pymavlink, as its bytes are read here; vx: cm/s north."""
    whole = round(LATITUDE + north * METRE_NORTH)
    wire = mavlink.MAVLink_hil_state_quaternion_message(
        *(0, q, 0.1, 0.2, 0.3, whole, LONGITUDE, round(altitude * 1e3), vx, 0, -50, 0, 0, 0, 0, 0)
    )
    (received,) = Codec(1, 191).decode_datagram(wire.pack(mavlink.MAVLink(None, 1, 1)))
    return received.message


def test_a_literal_message_is_read_in_our_frames():
    m = sent(0.0)
    assert isinstance(m, HilState)
    assert (m.time, m.altitude) == (0.0, 488.0)
    assert m.latitude_deg == pytest.approx(47.3977420)
    assert m.v == pytest.approx([0.0, 1.0, 0.5])  # east, north, up
    assert m.omega == pytest.approx([0.1, -0.2, -0.3])
    assert m.q_wb == pytest.approx([0.7071, 0.0, 0.0, 0.7071], abs=1e-4)  # nose to the north


def test_steps_of_a_centimetre_are_smooth():
    motion, places = TrueMotion(), []
    for k in range(200):
        places.append(motion.hear(sent(0.02 * k, 488.0 + 0.01 * k), 5.0 + 0.02 * k))
    assert places[0].p == pytest.approx([0.0, 0.0, 0.0])
    assert places[-1].time == pytest.approx(8.98)
    true = np.array([[0.0, 0.02 * k, 0.01 * k] for k in range(200)])
    off = np.abs(np.array([p.p for p in places]) - true)
    assert off[50:].max() < 0.006  # half a step of the degrees is 0.0056 m
    speed = np.diff([p.p[1] for p in places]) / 0.02
    assert np.abs(speed[50:] - 1.0).max() < 0.08  # their plain differences are off by 0.5 m/s


def test_a_place_without_a_time_waits_for_one():
    motion = TrueMotion()
    assert motion.hear(sent(0.0), -np.inf) is None
    assert motion.hear(sent(0.0), 1.0) is not None
    assert motion.hear(sent(0.0), 1.0) is None


def test_a_vehicle_that_is_moved_by_hand_is_there():
    motion = TrueMotion()
    motion.hear(sent(0.0), 1.0)
    assert motion.hear(sent(30.0), 1.02).p[1] == pytest.approx(30.0, abs=0.02)
