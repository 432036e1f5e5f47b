"""Arming, modes, offboard control and failsafes of the emulated PX4, over messages."""

import math

import numpy as np
import pytest

from mavlink_bridge.autopilots.px4_events import Px4Events
from mavlink_bridge.wire.messages import (
    Command,
    Event,
    Heartbeat,
    LocalPosition,
    RateSetpoint,
    SetMode,
    SystemStatus,
)
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.firmware.flavour import Mode
from sitl_sim.vehicles.firmware.px4 import PX4
from sitl_sim.vehicles.sensor_noise import SensorNoise

HOVER = Airframe().hover_thrust
NAN = math.nan
HOLD, ARM = (1.0, 4.0, 3.0, 0.0, 0.0, 0.0, 0.0), (1.0, *(0.0,) * 6)


def results(f, *params):
    """All acknowledgements of DO_SET_MODE, in order."""
    return [m.result for m in f.send(Command(176, (1.0, *params, 0, 0, 0, 0), 1))]


def test_px4_acknowledges_a_mode_on_arrival_and_then_what_came_of_it(make_flight):
    """Recorded from PX4 1.17: 0 and 0; 0 and 1 in the air without a stream, or for no mode."""
    f = make_flight()
    assert results(f, 4.0, 3.0) == [0, 0]
    assert results(f, 99.0, 99.0) == [0, 1]
    f.in_the_air()
    assert results(f, 6.0, 0.0) == [0, 1]
    f.run(0.5)
    assert f.commander.mode is Mode.HOLD
    f.stream([0, 0, 0], HOVER)
    f.run(0.5)
    assert results(f, 6.0, 0.0) == [0, 0]
    f.run(1.0)
    assert f.last(Heartbeat).custom_mode == PX4.modes[Mode.OFFBOARD]


def test_px4_on_the_ground_shows_offboard_without_a_stream_and_does_not_arm_in_it(make_flight):
    """Recorded from PX4 1.17: HEARTBEAT 0x00060000 with MAV_STATE 0, ARM refused with 1."""
    f = make_flight()
    assert results(f, 6.0, 0.0) == [0, 0]
    f.run(1.1)
    assert f.last(Heartbeat).custom_mode == 0x00060000
    assert f.last(Heartbeat).system_status == 0
    assert f.command(400, 1) == 1
    hold, arm = (Command(n, p, 1) for n, p in ((176, HOLD), (400, ARM)))
    assert [m.result for m in f.send(hold) + f.send(arm)] == [0, 0, 0]
    f.run(1.1)
    assert f.last(Heartbeat).custom_mode == 0x03040000
    assert f.commander.armed


def test_px4_is_back_in_offboard_after_a_landing_and_arms_again_from_hold(make_flight):
    f = make_flight()
    f.in_offboard()
    f.setpoint = None
    f.command(176, 1, 4, 6)
    assert f.run(20.0, lambda: not f.commander.armed)
    f.run(1.1)
    assert f.last(Heartbeat).custom_mode == 0x00060000
    assert f.command(400, 1) == 1
    f.command(176, 1, 4, 3)
    assert f.command(400, 1) == 0


def test_px4_is_in_hold_after_a_flight_without_offboard(make_flight):
    f = make_flight()
    f.in_the_air()
    f.command(21)
    assert f.run(20.0, lambda: not f.commander.armed)
    assert f.commander.mode is Mode.HOLD


def test_a_command_int_of_a_local_frame_is_refused(make_flight):
    f = make_flight()
    (ack,) = f.send(Command(176, HOLD, 1, frame=0))
    assert ack.result == 9
    assert [m.result for m in f.send(Command(176, HOLD, 1, frame=5))] == [0, 0]


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


@pytest.mark.parametrize(
    ("action", "mode"), [(0, Mode.RETURN), (3, Mode.RETURN), (4, Mode.LAND), (5, Mode.HOLD)]
)
def test_when_the_stream_ends_px4_does_what_its_parameter_says(make_flight, action, mode):
    """PX4 1.17: 1.07 s after the last setpoint, at once; 0, for a pilot's sticks, returns."""
    f = make_flight(parameters={"COM_OBL_RC_ACT": action})
    f.in_offboard()
    f.stream([0.2, 0.3, 0.0], HOVER)
    f.run(0.6)
    f.setpoint = None
    last = f.autopilots.units[0].guidance.setpoint_at
    assert f.run(1.3, lambda: f.commander.mode is mode)
    assert 0.96 <= f.autopilots.t - last <= 1.10
    f.run(2.0)
    assert f.commander.mode is mode
    assert f.last(Heartbeat).system_status == 5
    assert f.run(25.0, lambda: not f.commander.armed) is (mode is not Mode.HOLD)


def test_by_default_px4_climbs_to_return_from_far_away(make_flight):
    f = make_flight()
    f.in_the_air()
    f.autopilots.fly_to(0, [35.0, 0.0, 2.5], 10.0)
    f.run(8.0)
    f.stream([0, 0, 0], HOVER)
    f.run(0.2)
    f.command(176, 1, 6, 0)
    f.setpoint = None
    assert f.run(15.0, lambda: f.vehicles.p[0, 2] > 29.0)
    assert f.commander.mode is Mode.RETURN


def test_offboard_is_not_retaken_when_the_stream_comes_back(make_flight):
    f = make_flight(parameters={"COM_OF_LOSS_T": 0.5, "COM_OBL_RC_ACT": 5})
    f.in_offboard()
    f.setpoint = None
    f.run(1.0)
    f.stream([0, 0, 0], HOVER)
    f.run(1.0)
    assert f.commander.mode is Mode.HOLD


@pytest.mark.parametrize(
    "bad",
    [
        RateSetpoint(0.0, np.zeros(3), HOVER, 1, type_mask=3 | 128),
        RateSetpoint(0.0, np.ones(3), 0.4, 2),
        RateSetpoint(0.0, np.ones(3), 0.4, 1, 191),
    ],
)
def test_a_setpoint_of_another_or_of_nothing_is_no_stream(make_flight, bad):
    f = make_flight()
    f.in_offboard()
    f.setpoint = bad
    f.run(0.6)
    assert f.commander.mode is Mode.OFFBOARD
    assert np.abs(f.vehicles.omega[0]).max() < 0.1
    f.run(0.6)
    assert f.commander.mode is Mode.RETURN


@pytest.mark.parametrize(
    ("sent", "omega"),
    [
        (RateSetpoint(0.0, np.array([NAN, 0.0, 0.5]), HOVER, 1), [0, 0, 0.5]),
        (RateSetpoint(0.0, np.array([0.0, 0.0, NAN]), HOVER, 1), [0, 0, 0]),
        (RateSetpoint(0.0, np.zeros(3), NAN, 1), [0, 0, 0]),
        (RateSetpoint(0.0, np.zeros(3), 0.0, 1, type_mask=192), [0, 0, 0]),
    ],
)
def test_what_is_not_finite_or_not_given_keeps_the_stream_alive(make_flight, sent, omega):
    """PX4 1.17: that axis holds rate 0, or the thrust stays; it remains in offboard for ever."""
    f = make_flight(noise=SensorNoise.none())
    f.in_offboard()
    f.run(0.2)
    f.setpoint = sent
    f.run(1.5)
    assert f.commander.mode is Mode.OFFBOARD
    np.testing.assert_allclose(f.vehicles.omega[0], omega, atol=0.05)
    assert f.vehicles.specific_force[0, 2] == pytest.approx(9.81, rel=0.1)


def test_px4_limits_the_yaw_rate(make_flight):
    f = make_flight()
    f.in_offboard()
    f.stream([0, 0, 8.0], HOVER)
    f.run(0.9)
    assert f.vehicles.omega[0, 2] == pytest.approx(math.radians(200.0), abs=0.2)


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
@pytest.mark.parametrize("mask", [0, 7])
def test_an_attitude_that_is_not_masked_is_flown(make_flight, flavour, mask):
    """A companion that leaves bit 128 out turns the vehicle to the attitude in its message."""
    options = {"parameters": {"GUID_OPTIONS": 8}} if flavour == "ardupilot" else {}
    f = make_flight(flavour=flavour, **options)
    if flavour == "px4":
        f.in_offboard()
    else:
        f.command(176, 1, 4)
        f.command(400, 1)
        f.command(22, 0, 0, 0, 0, 0, 0, 5.0)
        f.run(8.0)
    north = np.array([math.cos(math.pi / 4), 0.0, 0.0, math.sin(math.pi / 4)])
    f.setpoint = RateSetpoint(0.0, np.zeros(3), HOVER, 1, type_mask=mask, q_wb=north)
    f.run(2.5)
    assert f.commander.mode is Mode.OFFBOARD
    np.testing.assert_allclose(np.abs(f.vehicles.q[0]), np.abs(north), atol=0.05)


def test_pilot_mode_change_wins_over_the_stream(make_flight):
    f = make_flight()
    f.in_offboard()
    f.send(SetMode(1, 1, 0x00030000))
    f.stream([0.5, 0, 0], HOVER)
    f.run(1.0)
    assert f.commander.mode is Mode.POSITION
    assert np.abs(f.vehicles.omega[0]).max() < 0.15


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        ("gyro", "no gyro"),
        ("accelerometer", "no accelerometer"),
        ("magnetometer", "no compass"),
        ("gps", "no global position"),
    ],
)
def test_arming_is_refused_with_a_reason(make_flight, sensor, words):
    f = make_flight()
    f.commander.failed.add(sensor)
    f.run(0.1)
    assert f.command(400, 1) == 1
    assert f.texts() == ["Arming denied: Resolve system health failures firs"]
    checks = Px4Events()
    told = [checks.hear(m, "hold") for m in f.commander.said if isinstance(m, Event)]
    assert told[-1] == f"arming denied: {words}"
    f.run(1.0)
    assert not f.last(SystemStatus).health & 0x10000000
    assert f.command(400, 1, 21196) == 0


def test_arming_is_refused_with_an_empty_battery_and_in_a_landing_mode(make_flight):
    f = make_flight()
    f.autopilots.set_battery(0, 0.01)
    f.run(0.5)
    assert f.command(400, 1) == 1
    assert f.texts()[-1].startswith("Arming denied")
    g = make_flight()
    assert results(g, 4.0, 6.0) == [0, 0]
    assert g.command(400, 1) == 1
    assert results(g, 4.0, 4.0) == [0, 0]  # without a mission: entered, and not armed in
    assert g.command(400, 1) == 1
    g.command(176, 1, 4, 3)
    g.command(400, 1)
    assert results(g, 4.0, 4.0) == [0, 1]


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
