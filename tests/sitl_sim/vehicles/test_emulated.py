"""Flights of the emulated PX4: modes, arming, failsafes, telemetry; over message objects."""

import math
from dataclasses import replace

import numpy as np
import pytest

from mavlink_bridge.wire.messages import (
    Attitude,
    Command,
    ExtendedSystemState,
    GlobalPosition,
    Heartbeat,
    LocalPosition,
    RateSetpoint,
    Received,
    SetMode,
    Source,
    StatusText,
    SystemStatus,
)
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.estimator import SensorNoise
from sitl_sim.vehicles.firmware.flavour import Mode
from sitl_sim.vehicles.rigid_body import Airframe, Vehicles

OFFBOARD, HOLD, LAND = 0x00060000, 0x03040000, 0x06040000
HOVER = Airframe().hover_thrust


def test_takeoff_reaches_its_altitude_and_holds(make_flight):
    f = make_flight(parameters={"MIS_TAKEOFF_ALT": 5.0})
    f.in_the_air()
    f.run(5.0)
    np.testing.assert_allclose(f.vehicles.p[0], [0, 0, 5], atol=0.3)
    assert np.linalg.norm(f.vehicles.v[0]) < 0.3
    assert f.last(Heartbeat).custom_mode == HOLD
    assert f.last(ExtendedSystemState).landed_state == 2


@pytest.mark.parametrize(("asked", "reached"), [(488.0 + 4.0, 4.0), (5.0, 2.5)])
def test_takeoff_to_an_altitude_above_the_sea(make_flight, asked, reached):
    f = make_flight()
    f.command(400, 1)
    nan = math.nan
    assert f.command(22, 0, 0, 0, nan, nan, nan, asked) == 0
    f.run(10.0)
    assert f.vehicles.p[0, 2] == pytest.approx(reached, abs=0.3)


def test_holds_against_wind(make_flight):
    f = make_flight()
    f.in_the_air()
    f.run(10.0, wind=[4.0, 0.0, 0.0])
    np.testing.assert_allclose(f.vehicles.p[0], [0, 0, 2.5], atol=0.4)


def test_land_is_gentle_and_disarms(make_flight):
    f = make_flight()
    f.in_the_air()
    assert f.command(21) == 0
    speeds = []
    assert f.run(15.0, lambda: speeds.append(f.vehicles.v[0, 2]) or not f.commander.armed)
    assert min(speeds) > -1.2
    assert f.vehicles.p[0, 2] == 0.0
    assert f.texts()[-2:] == ["Landing detected", "Disarmed by landing"]
    assert (f.vehicles.motor[0] < 0.06).all()


def test_touchdown_stays_within_what_a_judge_of_the_truth_believes(make_flight):
    """No acceleration beyond 80 m/s² between samples at 100 Hz."""
    f = make_flight()
    f.in_the_air()
    f.command(21)
    v = []
    f.run(15.0, lambda: v.append(f.vehicles.v[0].copy()) or not f.commander.armed)
    assert np.linalg.norm(np.diff(v, axis=0), axis=1).max() / 0.01 < 80


def test_offboard_is_acknowledged_but_not_entered_without_a_stream(make_flight):
    f = make_flight()
    f.in_the_air()
    assert f.command(176, 1, 6, 0) == 0
    f.run(0.5)
    assert f.commander.mode is Mode.HOLD
    f.stream([0, 0, 0], HOVER)
    f.run(0.5)
    assert f.command(176, 1, 6, 0) == 0
    f.run(1.0)
    assert f.last(Heartbeat).custom_mode == OFFBOARD


def test_one_new_setpoint_is_enough_for_offboard_and_an_old_one_is_not(make_flight):
    # MAVSDK asks for the mode right after its first setpoint; the second may come later.
    f = make_flight()
    f.in_the_air()
    f.send(RateSetpoint(0.0, np.zeros(3), HOVER, 1))
    f.run(1.5)
    f.command(176, 1, 6, 0)
    assert f.commander.mode is Mode.HOLD
    f.send(RateSetpoint(0.0, np.zeros(3), HOVER, 1))
    f.command(176, 1, 6, 0)
    assert f.commander.mode is Mode.OFFBOARD


def offboard(f):
    f.in_the_air()
    f.stream([0, 0, 0], HOVER)
    f.run(0.5)
    f.command(176, 1, 6, 0)
    assert f.commander.mode is Mode.OFFBOARD


def test_offboard_follows_body_rates_and_thrust(make_flight):
    f = make_flight(noise=SensorNoise.none())
    offboard(f)
    f.stream([0.3, -0.2, 0.5], 1.3 * HOVER)
    f.run(0.4)
    np.testing.assert_allclose(f.vehicles.omega[0], [0.3, -0.2, 0.5], atol=0.05)
    assert f.vehicles.specific_force[0, 2] == pytest.approx(1.3 * 9.81, rel=0.03)


def test_offboard_loss_holds_level_then_lands(make_flight):
    f = make_flight(parameters={"COM_OF_LOSS_T": 0.5})
    offboard(f)
    f.stream([0.2, 0.3, 0.0], HOVER)
    f.run(0.6)
    f.setpoint = None
    start = f.autopilots.t
    assert f.run(0.62, lambda: f.commander.mode is Mode.HOLD)
    assert f.autopilots.t - start <= 0.6
    f.run(1.5)
    _, x, y, _ = f.vehicles.q[0]
    assert 1 - 2 * (x * x + y * y) > math.cos(math.radians(8))
    f.run(1.5)
    assert np.linalg.norm(f.vehicles.v[0]) < 0.4
    assert f.last(Heartbeat).system_status == 5
    assert f.run(4.0, lambda: f.commander.mode is Mode.LAND)
    assert f.run(15.0, lambda: not f.commander.armed)


def test_offboard_is_not_retaken_when_the_stream_comes_back(make_flight):
    f = make_flight(parameters={"COM_OF_LOSS_T": 0.5})
    offboard(f)
    f.setpoint = None
    f.run(1.0)
    f.stream([0, 0, 0], HOVER)
    f.run(1.0)
    assert f.commander.mode is Mode.HOLD


@pytest.mark.parametrize(
    "bad",
    [
        RateSetpoint(0.0, np.array([math.nan, 0, 0]), 0.4, 1),
        RateSetpoint(0.0, np.zeros(3), math.inf, 1),
        RateSetpoint(0.0, np.ones(3), 0.4, 1, type_mask=7),
        RateSetpoint(0.0, np.ones(3), 0.4, 2),
    ],
)
def test_senseless_setpoints_are_ignored_and_are_no_stream(make_flight, bad):
    f = make_flight()
    offboard(f)
    f.setpoint = bad
    f.run(0.6)
    assert f.commander.mode is Mode.OFFBOARD
    assert np.abs(f.vehicles.omega[0]).max() < 0.1
    f.run(0.6)
    assert f.commander.mode is Mode.HOLD
    assert np.isfinite(f.vehicles.p).all()


def test_pilot_mode_change_wins_over_the_stream(make_flight):
    f = make_flight()
    offboard(f)
    f.send(SetMode(1, 1, 0x00030000))
    f.stream([0.5, 0, 0], HOVER)
    f.run(1.0)
    assert f.commander.mode is Mode.POSITION
    assert np.abs(f.vehicles.omega[0]).max() < 0.15


def test_return_climbs_flies_home_and_lands(make_flight):
    f = make_flight(parameters={"RTL_RETURN_ALT": 4.0})
    offboard(f)
    f.stream([0, 0.25, 0], 1.02 * HOVER)
    f.run(1.0)
    f.stream([0, 0, 0], 1.05 * HOVER)
    assert f.run(5.0, lambda: f.vehicles.p[0, 0] > 4.0)
    assert f.command(20) == 0
    f.setpoint = None
    heights = []
    assert f.run(60.0, lambda: heights.append(f.vehicles.p[0, 2]) or not f.commander.armed)
    assert max(heights) > 3.7
    assert np.linalg.norm(f.vehicles.p[0, :2]) < 0.5


# Arming.


@pytest.mark.parametrize("sensor", ["gyro", "accelerometer", "magnetometer", "gps"])
def test_arming_is_refused_with_a_reason(make_flight, sensor):
    f = make_flight()
    f.commander.failed.add(sensor)
    assert f.command(400, 1) == 1
    assert f.texts() == [f"Arming denied: {sensor} failure"]
    f.run(1.0)
    assert not f.last(SystemStatus).health & 0x10000000
    assert f.command(400, 1, 21196) == 0


def test_arming_is_refused_with_an_empty_battery_and_in_a_landing_mode(make_flight):
    f = make_flight(battery_ah=0.0005)
    f.command(400, 1)
    f.run(5.0)
    f.command(400, 0)
    assert f.command(400, 1) == 1
    assert f.texts()[-1] == "Arming denied: battery too low"
    g = make_flight()
    g.command(176, 1, 4, 6)
    assert g.command(400, 1) == 1
    assert "land mode" in g.texts()[-1]
    assert g.command(176, 1, 4, 4) == 1  # no mission there


def test_disarming_in_the_air_needs_force(make_flight):
    f = make_flight()
    f.in_the_air()
    assert f.command(400, 0) == 1
    assert f.commander.armed
    assert f.command(400, 0, 21196) == 0
    f.run(0.3)
    assert f.vehicles.v[0, 2] < -1.0


def test_disarms_when_nobody_takes_off(make_flight):
    f = make_flight()
    f.command(400, 1)
    f.run(9.5)
    assert f.commander.armed
    np.testing.assert_array_equal(f.vehicles.p[0], 0.0)
    f.run(1.0)
    assert not f.commander.armed


# Telemetry.


def test_attitude_and_position_come_together_at_50_hz(make_flight):
    f = make_flight(boot_offset=[7.1234])
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


def test_battery_runs_down(make_flight):
    f = make_flight()
    f.in_the_air()
    first = f.last(SystemStatus)
    f.run(20.0)
    last = f.last(SystemStatus)
    assert last.remaining < first.remaining
    assert 12.0 < last.voltage < first.voltage < 16.8
    assert 3.0 < last.current < 30.0


def test_own_frame_is_its_own(make_flight):
    """Origin and yaw of the frame change what is told, and nothing of what is flown."""
    yaw, origin = 0.7, np.array([[10.0, -4.0, 0.0]])
    f = make_flight(origin=origin, yaw_offset=[yaw], noise=SensorNoise.none())
    f.in_the_air()
    f.run(1.0)
    p, q = f.vehicles.p[0], f.vehicles.q[0]
    c, s = math.cos(yaw), math.sin(yaw)
    own = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ (p - origin[0])
    unit = f.autopilots.units[0]
    np.testing.assert_allclose(unit.frame.point(p), own, atol=1e-12)
    np.testing.assert_allclose(unit.frame.to_world(own), p, atol=1e-12)
    lat, lon, _ = unit.frame.to_geo(p)
    np.testing.assert_allclose(unit.frame.from_geo(lat, lon), p[:2], atol=1e-6)
    told = unit.frame.attitude(q)
    assert 2 * math.atan2(told[3], told[0]) == pytest.approx(-yaw, abs=0.02)
    np.testing.assert_allclose(f.vehicles.p[0], [0, 0, 2.5], atol=0.2)


def test_global_position_agrees_with_local_position(make_flight):
    f = make_flight(noise=SensorNoise.none())
    f.in_the_air()
    g = f.last(GlobalPosition)
    assert g.relative_altitude == pytest.approx(2.5, abs=0.2)
    assert g.altitude == pytest.approx(490.5, abs=0.2)
    assert g.heading == pytest.approx(math.pi / 2, abs=0.02)  # yaw 0 looks east


def test_estimate_is_wrong_by_what_was_asked(make_flight):
    f = make_flight(noise=replace(SensorNoise(), position_time=0.05, velocity_time=0.05))
    p, v = [], []
    for k in range(1, 1000):
        f.autopilots.advance(k * 0.02)
        for m in f.autopilots.telemetry(0, "companion"):
            if isinstance(m, LocalPosition):
                p.append(m.p)
                v.append(m.v)
    np.testing.assert_allclose(np.std(p, axis=0), 0.02, rtol=0.2)
    np.testing.assert_allclose(np.std(v, axis=0), 0.03, rtol=0.2)


# Many, and again.


def fly_three(step):
    vehicles = Vehicles(Airframe(), [[0, 0, 0], [3, 0, 0], [6, 0, 0]], 0.3)
    a = Autopilots(vehicles, [1, 2, 3], seed=5)
    nan = math.nan
    for i in range(3):
        a.receive(i, Received(Source(255, 190), Command(400, (1, 0, nan, nan, nan, nan, nan))))
        a.receive(i, Received(Source(255, 190), Command(22, (nan,) * 7)))
    t = 0.0
    while t < 2.9999:
        t = round(t + step, 6)
        a.advance(t)
    return vehicles


def test_same_seed_same_bytes_however_time_is_cut():
    a, b = fly_three(0.002), fly_three(0.1)
    for x, y in zip(a.state, b.state, strict=True):
        assert x.tobytes() == y.tobytes()
    assert not np.array_equal(a.p[0], a.p[1] - [3, 0, 0])  # each has its own noise


def test_two_vehicles_with_one_id_are_refused():
    with pytest.raises(ValueError, match="one system id"):
        Autopilots(Vehicles(Airframe(), np.zeros((2, 3)), 0.0), [4, 4])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"flavour": "px5"}, "choose one of .*px4"),
        ({"parameters": {"MPC_THR_HOVR": 0.3}}, "MPC_THR_HOVER"),
    ],
)
def test_errors_list_the_choices(make_flight, options, message):
    with pytest.raises(ValueError, match=message):
        make_flight(**options)


def test_texts_reach_both_links_once(make_flight):
    f = make_flight()
    f.command(400, 1, source=Source(1, 191))
    f.autopilots.advance(0.01)
    for link in ("companion", "gcs"):
        heard = f.autopilots.telemetry(0, link) + f.autopilots.telemetry(0, link)
        texts = [m.text for m in heard if isinstance(m, StatusText)]
        assert texts == ["Armed by external command"]
