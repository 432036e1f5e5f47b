"""Arming, modes, offboard control and failsafes of the emulated PX4, over messages."""

import math

import numpy as np
import pytest

from mavlink_bridge.wire.messages import (
    Heartbeat,
    LocalPosition,
    RateSetpoint,
    SetMode,
    SystemStatus,
)
from sitl_sim.vehicles.firmware.flavour import Mode
from sitl_sim.vehicles.firmware.px4 import PX4
from sitl_sim.vehicles.rigid_body import Airframe
from sitl_sim.vehicles.sensor_noise import SensorNoise

HOVER = Airframe().hover_thrust


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
    assert f.last(Heartbeat).custom_mode == PX4.modes[Mode.OFFBOARD]


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


def test_offboard_follows_body_rates_and_thrust(make_flight):
    f = make_flight(noise=SensorNoise.none())
    f.in_offboard()
    f.stream([0.3, -0.2, 0.5], 1.3 * HOVER)
    f.run(0.4)
    np.testing.assert_allclose(f.vehicles.omega[0], [0.3, -0.2, 0.5], atol=0.05)
    assert f.vehicles.specific_force[0, 2] == pytest.approx(1.3 * 9.81, rel=0.03)


def test_offboard_loss_holds_level_then_lands(make_flight):
    f = make_flight(parameters={"COM_OF_LOSS_T": 0.5})
    f.in_offboard()
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
    f.in_offboard()
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
def test_invalid_setpoints_are_ignored_and_are_no_stream(make_flight, bad):
    f = make_flight()
    f.in_offboard()
    f.setpoint = bad
    f.run(0.6)
    assert f.commander.mode is Mode.OFFBOARD
    assert np.abs(f.vehicles.omega[0]).max() < 0.1
    f.run(0.6)
    assert f.commander.mode is Mode.HOLD
    assert np.isfinite(f.vehicles.p).all()


def test_pilot_mode_change_wins_over_the_stream(make_flight):
    f = make_flight()
    f.in_offboard()
    f.send(SetMode(1, 1, 0x00030000))
    f.stream([0.5, 0, 0], HOVER)
    f.run(1.0)
    assert f.commander.mode is Mode.POSITION
    assert np.abs(f.vehicles.omega[0]).max() < 0.15


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


def test_disarms_without_a_takeoff(make_flight):
    f = make_flight()
    f.command(400, 1)
    f.run(9.5)
    assert f.commander.armed
    np.testing.assert_array_equal(f.vehicles.p[0], 0.0)
    f.run(1.0)
    assert not f.commander.armed


@pytest.mark.parametrize(("flavour", "asked"), [("ardupilot", 16), ("px4", 1 << 16)])
def test_an_alias_of_a_mode_keeps_its_own_number(make_flight, flavour, asked):
    f = make_flight(flavour=flavour)
    f.send(SetMode(1, 1, asked))
    f.run(1.5)
    assert f.last(Heartbeat).custom_mode == asked
    f.send(SetMode(1, 1, 77))
    f.run(1.5)
    assert f.last(Heartbeat).custom_mode == asked


def test_position_lost_in_hold_levels_and_lands(make_flight):
    f = make_flight()
    f.in_the_air()
    f.autopilots.fail(0, "gps")
    f.heard[0].clear()
    f.run(1.0)
    assert f.commander.mode is Mode.LAND
    assert not [m for m in f.heard[0] if isinstance(m, LocalPosition)]
    assert f.tilt < math.radians(5)
    assert f.run(15.0, lambda: not f.commander.armed)
    assert not f.last(SystemStatus).health & 0x20
    with pytest.raises(ValueError, match="choose one of gyro"):
        f.autopilots.fail(0, "nose")
