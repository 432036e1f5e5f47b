"""Telemetry: contents, rates, and requests for messages."""

import math
from collections import Counter

import numpy as np
import pytest

from mavlink_bridge.wire.messages import (
    Attitude,
    AttitudeTarget,
    AutopilotVersion,
    Command,
    CommandAck,
    EulerAttitude,
    Event,
    ExtendedSystemState,
    GlobalPosition,
    GpsRaw,
    Heartbeat,
    HomePosition,
    LocalPosition,
    MissionItemReached,
    Odometry,
    Ping,
    RequestDataStream,
    Source,
    StatusText,
    SystemStatus,
    TimeSync,
)
from sitl_sim.vehicles.sensor_noise import SensorNoise

NAN = math.nan


def test_attitude_and_position_come_together_at_50_hz(make_flight):
    f = make_flight(boot_offset=[7.1234])
    f.command(511, 32, 20000, source=Source(1, 191))
    pairs = []
    for k in range(1, 501):
        f.autopilots.advance(k * 0.002)
        out = f.autopilots.telemetry(0, "companion")
        times = [m.time for m in out if type(m) in (Attitude, LocalPosition)]
        if times:
            pairs.append(times)
    assert len(pairs) in (50, 51)
    assert all(len(t) == 2 and t[0] == t[1] for t in pairs)
    assert pairs[-1][0] == pytest.approx(8.1234, abs=0.02)


def test_health_is_good_from_the_start(make_flight):
    f = make_flight()
    f.run(1.2)
    status = f.last(SystemStatus)
    for bit in (0x1, 0x2, 0x4, 0x20, 0x10000000):
        assert status.present & status.health & bit


def test_global_position_agrees_with_local_position(make_flight):
    f = make_flight(noise=SensorNoise.none())
    f.in_the_air()
    g = f.last(GlobalPosition)
    assert g.relative_altitude == pytest.approx(2.5, abs=0.2)
    assert g.altitude == pytest.approx(490.5, abs=0.2)
    assert g.heading == pytest.approx(math.pi / 2, abs=0.02)  # yaw 0 looks east


GROUND = Heartbeat(8, 6, False, 0, 4)
COMPANION = Heartbeat(8, 18, False, 0, 4)


def words(f, link):
    return [m.text for m in f.autopilots.telemetry(0, link) if isinstance(m, StatusText)]


def test_px4_says_words_only_where_a_ground_station_was_heard(make_flight):
    """PX4's streams/STATUSTEXT.hpp; a HEARTBEAT counts for 2.5 s."""
    f = make_flight()
    f.send(COMPANION, source=Source(1, 191))
    f.send(GROUND)
    f.command(400, 1, source=Source(1, 191))
    f.autopilots.advance(0.01)
    assert words(f, "companion") == []
    assert words(f, "gcs") == ["Armed by external command"]
    assert words(f, "gcs") == []
    f.autopilots.advance(2.6)
    f.command(400, 0)
    assert words(f, "gcs") == []  # silent for too long


def test_ardupilot_says_words_where_anything_was_heard(make_flight):
    f = make_flight(flavour="ardupilot")
    f.send(COMPANION, source=Source(1, 191))
    f.command(400, 1, source=Source(1, 191))
    assert words(f, "companion") == ["Arming motors"]
    assert words(f, "gcs") == []


def test_px4_explains_a_refusal_by_numbers_on_every_link(make_flight):
    """Ids and arguments as recorded from PX4 1.17: a refused ARM in offboard without a stream."""
    f = make_flight()
    assert f.command(176, 1, 6, 0) == 0
    f.run(0.02)
    assert f.command(400, 1) == 1
    heard = [m for m in f.autopilots.telemetry(0, "companion") if isinstance(m, Event)]
    told = {m.event_id: m for m in heard}
    assert [m.sequence for m in heard] == list(range(1, len(heard) + 1))
    assert told[0x0102089D].severity == 2  # arming denied: resolve health failures first
    assert told[0x012F1DC7].severity == 3  # no offboard signal
    assert told[0x012F1DC7].arguments[:4] == bytes([0, 0x40, 0, 0])  # bars offboard
    assert 0x01A893E0 in told  # the summary before them


def test_px4_sends_unasked_what_a_real_one_does(make_flight):
    """Rates of PX4 1.17's onboard link, measured; of those messages that are emulated."""
    f = make_flight()
    rates = Counter()
    for k in range(1, 201):
        f.autopilots.advance(k * 0.01)
        rates.update(type(m) for m in f.autopilots.telemetry(0, "companion"))
    wanted = {EulerAttitude: 100, Attitude: 50, GlobalPosition: 50, LocalPosition: 30}
    wanted |= {Odometry: 30, TimeSync: 10, GpsRaw: 8, SystemStatus: 5, Ping: 1, Heartbeat: 1}
    for kind, hz in wanted.items():
        assert rates[kind] == pytest.approx(2 * hz, abs=2), kind


def test_texts_of_hours_are_sent_once_and_not_kept(make_flight):
    f = make_flight()
    for k in range(1, 1001):
        f.send(GROUND)
        f.send(GROUND, link="companion")
        f.command(176, 1, 99)  # no such mode: refused, in words
        f.autopilots.units[0].guidance.reached.append(k)
        heard = f.autopilots.telemetry(0, "gcs") + f.autopilots.telemetry(0, "companion")
        told = [m for m in heard if isinstance(m, StatusText)]
        assert len(told) == 2
        assert heard.count(MissionItemReached(k)) == 2
    for _ in range(1000):  # of more than is kept at once, the newest
        f.command(176, 1, 99)
    told = [m for m in f.autopilots.telemetry(0, "gcs") if isinstance(m, StatusText)]
    assert told == f.commander.texts
    assert 10 < len(told) <= 100
    assert not f.autopilots.units[0].guidance.reached
    assert not [m for m in f.autopilots.telemetry(0, "gcs") if isinstance(m, StatusText)]


def test_request_message(make_flight):
    f = make_flight()
    for number, kind in ((148, AutopilotVersion), (242, HomePosition), (245, ExtendedSystemState)):
        ack, message = f.send(Command(512, (number, NAN, NAN, NAN, NAN, NAN, NAN), 1))
        assert ack == CommandAck(512, 0, 255, 190)
        assert isinstance(message, kind)
    assert isinstance(f.send(Command(410, (0.0,) * 7, 1))[1], HomePosition)
    assert f.command(512, 9999) == 2
    assert f.command(512, NAN) == 2


def test_a_message_interval_belongs_to_the_link_of_its_request(make_flight):
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


def test_odometry_comes_on_request_and_agrees_with_local_position(make_flight):
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


def targets(f):
    return [m for m in f.heard[0] if isinstance(m, AttitudeTarget)]


def test_the_thrust_of_a_hover_is_told_at_the_rate_asked(make_flight):
    f = make_flight()
    f.in_the_air()
    before = len(targets(f))
    f.command(511, 83, 50_000)
    f.run(2.0)
    told = targets(f)[before:]
    assert len(told) == pytest.approx(40, abs=2)
    assert np.mean([m.thrust for m in told]) == pytest.approx(0.333, abs=0.01)
    assert {m.type_mask for m in told} == {0}


def test_ardupilot_tells_its_thrust_only_when_it_is_asked(make_flight):
    f = make_flight(flavour="ardupilot")
    f.run(1.0)
    assert targets(f) == []
    f.command(511, 83, 50_000)
    f.run(1.0)
    assert len(targets(f)) == pytest.approx(20, abs=1)
    assert {m.thrust for m in targets(f)} == {0.0}  # disarmed
