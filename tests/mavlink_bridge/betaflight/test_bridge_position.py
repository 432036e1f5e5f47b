"""Position estimate of the bridge, and flight without one."""

import math
import struct

import numpy as np
import pytest

from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import Attitude, GpsInput, LocalPosition
from tests.mavlink_bridge.betaflight.bench import STEP, Bench


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e38])
def test_a_fix_with_an_impossible_velocity_is_refused(bad):
    b = Bench()
    b.hover()
    for k in range(50):
        v = np.zeros(3)
        v[k % 3] = bad
        b.send([GpsInput(0.0, 3, 47.4, 8.5, 488.0, v)])
        b.run(STEP)
    assert np.abs(b.last(LocalPosition).v).max() < 1.0
    assert b.rc[4] > 1700


def test_the_velocity_follows_from_fixes_without_velocity():
    """The vehicle moves east at 2 m/s, and the receiver reports positions only."""
    b = Bench()
    b.fc.gps = False
    b.run(0.5)
    east = 2.0 / (math.radians(1.0) * 6371008.8 * math.cos(math.radians(47.4)))
    for k in range(40):
        fix = GpsInput(0.0, 3, 47.4, 8.5 + 0.1 * k * east, 488.0, None)
        b.send([r.message for r in Codec(1, 1).decode(Codec(1, 220).encode([fix]))])
        b.run(0.1)
    assert b.last(LocalPosition).v[0] == pytest.approx(2.0, abs=0.3)


def drifting():
    """Return a bench in hold with a GPS that reports a drift to the east; the sticks oppose it."""
    b = Bench()
    b.hover()
    b.fc.gps = False
    for _ in range(20):
        b.send([GpsInput(0.0, 3, 47.4, 8.5, 488.0, np.array([0.8, 0.0, 0.0]))])
        b.run(0.1)
    assert abs(b.rc[1] - 1500) > 30
    return b


def test_without_a_fix_the_bridge_sends_no_position_levels_and_still_lands():
    b = drifting()
    b.run(1.1)
    b.messages.clear()
    b.run(5.0)
    assert not [m for m in b.messages if isinstance(m, LocalPosition)]
    assert len([m for m in b.messages if isinstance(m, Attitude)]) >= 250
    assert b.rc[:2] == (1500, 1500)
    assert b.rc[2] > 1300  # the height is still controlled
    b.send(b.adapter.land())
    b.run(3.0)  # the height does not change, so it counts as landed
    assert not b.fc.armed
    b.send(b.adapter.arm())
    b.run(0.5)
    assert "Arming denied: no position" in b.texts()


def test_a_controller_that_stops_answering_gets_level_sticks():
    b = drifting()
    for _ in range(round(2.0 / STEP)):
        b.t += STEP
        out = b.bridge.cycle(b.t)
    rc = struct.unpack("<16H", out.rc[5:-1])
    assert rc[:2] == (1500, 1500)
    assert 1300 < rc[2] < 1700
    assert rc[4] > 1700


def places(b, seconds=3.0, longitude=8.5001):
    """East [m] of the positions sent while the board's receiver and GPS_INPUT differ by 7.5 m."""
    b.messages.clear()
    for _ in range(round(seconds / 0.1)):
        b.send([GpsInput(0.0, 3, 47.4, longitude, 488.0, np.zeros(3))])
        b.run(0.1)
    return [m.p[0] for m in b.messages if isinstance(m, LocalPosition)]


def test_of_two_receivers_one_is_used():
    b = Bench()
    b.run(1.0)
    east = places(b)
    assert max(east) - min(east) < 0.1


def test_a_board_without_a_receiver_does_not_place_the_vehicle_at_0_0():
    b = Bench()
    b.fc.gps_place = (0.0, 0.0)
    b.run(2.0)
    b.messages.clear()
    b.run(0.5)
    assert not [m for m in b.messages if isinstance(m, LocalPosition)]
    east = places(b)
    assert max(east) - min(east) < 0.1


def test_the_other_receiver_takes_over_when_the_first_is_silent():
    b = Bench()
    b.run(1.0)
    b.fc.gps = False
    east = places(b, seconds=6.0)
    assert east[-1] == pytest.approx(7.5, abs=0.5)
