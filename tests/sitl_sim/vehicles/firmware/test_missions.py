"""The mission protocol: upload, download, refusals, and the flight of a mission."""

import math
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import (
    MissionAck,
    MissionClearAll,
    MissionCount,
    MissionCurrent,
    MissionItem,
    MissionItemReached,
    MissionRequest,
    MissionRequestList,
    MissionSetCurrent,
)
from sitl_sim.vehicles.firmware.flavour import Mode
from sitl_sim.vehicles.sensor_noise import SensorNoise

NAN = math.nan


OPEN = 2**31 - 1


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
        (16, 47.0, NAN, 3.0, 11),
        (22, 47.0, -math.inf, 3.0, 11),
        (16, 47.0, 8.0, NAN, 12),
        (22, 47.0, 8.0, math.inf, 12),
        (22, NAN, NAN, NAN, 12),
    ],
)
def test_an_impossible_place_is_refused(make_flight, command, x, y, z, result):
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
def test_every_uploaded_item_can_be_downloaded(make_flight, sent, told):
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


def test_a_vehicle_asks_again_for_an_item_that_does_not_come(make_flight):
    """PX4 1.17: every 0.26 s for five seconds, then it gives up without a word."""
    f = make_flight()
    f.send(MissionCount(1, 1, 2))
    f.run(2.0)
    asked = [m for m in f.heard[0] if isinstance(m, MissionRequest)]
    assert 6 <= len(asked) <= 8
    assert {(m.seq, m.target_system) for m in asked} == {(0, 255)}
    f.run(4.0)
    f.heard[0].clear()
    f.run(1.0)
    assert not [m for m in f.heard[0] if isinstance(m, MissionRequest)]


def test_px4_takes_a_place_off_the_earth_and_keeps_a_fence(make_flight):
    f = make_flight()
    assert upload(f, [item(0, 16, 500.0, 8.0, 3.0)]) == MissionAck(255, 190, 0)
    (request,) = f.send(MissionCount(1, 1, 1, 1))
    assert (request.seq, request.mission_type) == (0, 1)
    corner = replace(item(0, 5001, 47.0, 8.0, 0.0), mission_type=1)
    assert f.send(corner) == [MissionAck(255, 190, 0, 1)]
    assert f.send(MissionRequestList(1, 1, 1)) == [MissionCount(255, 190, 1, 1)]
    assert f.send(MissionRequest(1, 1, 9, 0)) == [MissionAck(255, 190, 1)]


def test_ardupilot_refuses_a_place_off_the_earth(make_flight):
    f = make_flight(flavour="ardupilot")
    assert upload(f, [item(0, 16, 500.0, 8.0, 3.0)]) == MissionAck(255, 190, 10)


def test_an_old_request_is_answered_with_an_old_item(make_flight):
    f = make_flight()
    upload(f, [item(0, 16, 47.0, 8.0, 3.0)])
    (old,) = f.send(MissionRequest(1, 1, 0, 0, floating=True))
    assert old.floating
    assert old.x_deg == 47.0


def test_ardupilot_asks_by_the_old_request_each_second(make_flight):
    """Recorded from ArduCopter 4.7-dev."""
    f = make_flight(flavour="ardupilot")
    (first,) = f.send(MissionCount(1, 1, 2))
    assert first.floating
    f.run(3.5)
    asked = [m for m in f.heard[0] if isinstance(m, MissionRequest)]
    assert len(asked) == 3
    assert all(m.floating and m.seq == 0 for m in asked)
