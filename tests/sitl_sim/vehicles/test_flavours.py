"""Where the emulated ArduCopter and Betaflight differ from PX4, and faults of any of them."""

import math

import numpy as np
import pytest

from mavlink_bridge.wire.messages import (
    Attitude,
    AutopilotVersion,
    Command,
    GlobalPosition,
    Heartbeat,
    LocalPosition,
    MissionAck,
    MissionCount,
    MissionItem,
    MissionItemReached,
    MissionRequest,
    ParamRequestList,
    ParamSet,
    RateSetpoint,
    SetMode,
    Source,
    SystemStatus,
)
from sitl_sim.vehicles.firmware.flavour import Mode
from sitl_sim.vehicles.rigid_body import Airframe

HOVER = Airframe().hover_thrust
GUIDED, AUTO = 4, 3


def guided(make_flight, **options):
    """An ArduCopter in guided mode at 5 m."""
    f = make_flight(flavour="ardupilot", **options)
    assert f.command(176, 1, GUIDED) == 0
    assert f.command(400, 1) == 0
    assert f.command(22, 0, 0, 0, 0, 0, 0, 5.0) == 0
    f.run(8.0)
    assert f.vehicles.p[0, 2] == pytest.approx(5.0, abs=0.3)
    return f


def tilt(f):
    _, x, y, _ = f.vehicles.q[0]
    return math.acos(1 - 2 * (x * x + y * y))


# ArduCopter.


def test_ardupilot_sends_heartbeats_alone_until_asked(make_flight):
    f = make_flight(flavour="ardupilot")
    f.run(3.0)
    assert {type(m) for m in f.heard[0]} == {Heartbeat}
    assert f.last(Heartbeat).autopilot == 3
    assert f.last(Heartbeat).custom_mode == 0
    assert f.command(511, 32, 20000) == 0
    f.run(1.0)
    assert sum(isinstance(m, LocalPosition) for m in f.heard[0]) == pytest.approx(50, abs=2)


def test_ardupilot_takes_off_only_armed_and_guided(make_flight):
    f = make_flight(flavour="ardupilot")
    assert f.command(22, 0, 0, 0, 0, 0, 0, 5.0) == 4
    assert f.command(400, 1) == 0  # in stabilize
    assert f.command(22, 0, 0, 0, 0, 0, 0, 5.0) == 4


def test_ardupilot_arms_not_in_auto(make_flight):
    f = make_flight(flavour="ardupilot")
    f.send(SetMode(1, 1, 9))
    assert f.command(400, 1) == 4
    assert f.texts()[-1].startswith("Arm: land mode")


def test_ardupilot_guided_takes_thrust_as_climb_rate(make_flight):
    f = guided(make_flight)
    f.stream([0, 0, 0], 0.5)
    f.run(2.0)
    assert abs(f.vehicles.v[0, 2]) < 0.15
    f.stream([0, 0, 0.5], 0.75)
    f.run(2.0)
    assert f.vehicles.v[0, 2] == pytest.approx(1.25, abs=0.2)
    assert f.vehicles.omega[0, 2] == pytest.approx(0.5, abs=0.1)


def test_ardupilot_option_makes_thrust_thrust(make_flight):
    f = guided(make_flight, parameters={"GUID_OPTIONS": 8})
    f.stream([0, 0, 0], HOVER * 1.2)
    f.run(0.8)
    assert f.vehicles.specific_force[0, 2] == pytest.approx(1.2 * 9.81, rel=0.05)


def test_ardupilot_levels_after_guid_timeout_and_stays_guided(make_flight):
    f = guided(make_flight)
    f.stream([0, 0.3, 0], 0.5)
    f.run(0.8)
    f.stream([0, 0, 0], 0.5)
    f.run(0.2)
    f.setpoint = None
    f.run(2.7)
    assert tilt(f) > math.radians(8)
    f.run(1.0)
    assert tilt(f) < math.radians(3)
    assert f.commander.mode is Mode.OFFBOARD
    f.run(2.0)
    assert abs(f.vehicles.v[0, 2]) < 0.2


def test_ardupilot_stops_on_a_partial_mask(make_flight):
    f = guided(make_flight, parameters={"GUID_OPTIONS": 8})
    f.stream([0, 0, 0.8], HOVER)
    f.run(1.0)
    f.setpoint = RateSetpoint(0.0, np.array([0, 0, 0.8]), HOVER, 1, type_mask=128 | 4)
    f.run(2.0)
    assert abs(f.vehicles.omega[0, 2]) < 0.1


def test_ardupilot_positive_thrust_on_the_ground_takes_off(make_flight):
    f = make_flight(flavour="ardupilot")
    f.command(176, 1, GUIDED)
    f.command(400, 1)
    f.stream([0, 0, 0], 0.5)
    f.run(1.0)
    assert f.vehicles.p[0, 2] == 0.0
    f.stream([0, 0, 0], 0.8)
    f.run(2.0)
    assert f.vehicles.p[0, 2] > 0.5


def test_ardupilot_parameters_cross_by_value(make_flight):
    f = make_flight(flavour="ardupilot")
    values = {v.name: v for v in f.send(ParamRequestList(1, 1))}
    assert values["DISARM_DELAY"].value == 10.0
    assert values["DISARM_DELAY"].param_type == 2
    (echo,) = f.send(ParamSet(1, 1, "GUID_OPTIONS", 8.0, 6))
    assert echo.value == 8.0
    (echo,) = f.send(ParamSet(1, 1, "DISARM_DELAY", 1000.0, 2))
    assert echo.value == 10.0  # does not fit
    _, version = f.send(Command(512, (148, 0, 0, 0, 0, 0, 0), 1))
    assert isinstance(version, AutopilotVersion)
    assert version.capabilities & 0x20000


def test_ardupilot_lands_and_disarms(make_flight):
    f = guided(make_flight)
    assert f.command(21) == 0
    assert f.run(20.0, lambda: not f.commander.armed)
    assert f.last(Heartbeat).custom_mode == 9


def test_ardupilot_mission_begins_behind_home(make_flight):
    f = guided(make_flight)
    ref = f.autopilots.units[0].frame.reference
    points = [(22, 0, 0), (16, 4, 0), (16, 4, 4), (16, 0, 4)]
    items = [(16, 0.0, 0.0), *points]
    f.send(MissionCount(1, 1, len(items)))
    for k, (number, x, y) in enumerate(items):
        (reply,) = f.send(
            MissionItem(1, 1, k, 3, number, 0, 1, (0, 0, 0, 0), *ref.to_degrees(x, y), 4.0)
        )
        assert isinstance(reply, MissionRequest | MissionAck)
    assert reply.result == 0
    assert f.command(300, 0, 0) == 0
    assert f.run(40.0, lambda: MissionItemReached(4) in f.heard[0][-20:])
    f.run(1.5)
    assert f.last(Heartbeat).custom_mode == AUTO


@pytest.mark.parametrize(("flavour", "asked"), [("ardupilot", 16), ("px4", 1 << 16)])
def test_modes_that_fly_as_another_keep_their_number(make_flight, flavour, asked):
    f = make_flight(flavour=flavour)
    f.send(SetMode(1, 1, asked))
    f.run(1.5)
    assert f.last(Heartbeat).custom_mode == asked
    f.send(SetMode(1, 1, 77))
    f.run(1.5)
    assert f.last(Heartbeat).custom_mode == asked


# Betaflight.


def channels(roll=1500, pitch=1500, throttle=1000, yaw=1500, arm=1000):
    return [float(c) for c in (roll, pitch, throttle, yaw, arm, 1000, 1000, 1000)]


def fly_sticks(f, seconds, **positions):
    for _ in range(round(seconds / 0.02)):
        f.autopilots.sticks(0, channels(**positions))
        f.run(0.02)


def test_betaflight_flies_by_sticks(make_flight):
    f = make_flight(flavour="betaflight")
    fly_sticks(f, 0.2)
    fly_sticks(f, 0.2, arm=1900)
    assert f.commander.armed
    fly_sticks(f, 0.6, arm=1900, throttle=1750)
    assert f.vehicles.p[0, 2] > 0.5
    fly_sticks(f, 0.15, arm=1900, throttle=1650, roll=1600)  # 80°/s
    assert f.vehicles.omega[0, 0] == pytest.approx(math.radians(80), rel=0.05)
    fly_sticks(f, 0.15, arm=1900, throttle=1650, roll=1400, pitch=1550)  # up is nose down
    assert f.vehicles.omega[0, 1] == pytest.approx(math.radians(40), rel=0.1)
    fly_sticks(f, 0.3, arm=1900, throttle=1650, yaw=1600)  # right
    assert f.vehicles.omega[0, 2] == pytest.approx(-math.radians(80), rel=0.1)
    fly_sticks(f, 0.1, arm=1000)
    assert not f.commander.armed


def test_betaflight_arms_only_by_a_fresh_switch_and_low_throttle(make_flight):
    f = make_flight(flavour="betaflight")
    fly_sticks(f, 0.2, arm=1900)
    assert not f.commander.armed
    fly_sticks(f, 0.1)
    fly_sticks(f, 0.1, arm=1900, throttle=1300)
    assert not f.commander.armed
    fly_sticks(f, 0.1, arm=1900)
    assert f.commander.armed


def test_betaflight_drops_when_rc_is_lost(make_flight):
    f = make_flight(flavour="betaflight")
    fly_sticks(f, 0.1)
    fly_sticks(f, 0.1, arm=1900)
    fly_sticks(f, 0.5, arm=1900, throttle=1700)
    f.run(1.4)
    assert f.commander.armed
    f.run(0.2)
    assert not f.commander.armed
    fly_sticks(f, 0.2, arm=1900)
    assert not f.commander.armed


def test_betaflight_telemetry_has_its_quirks(make_flight):
    f = make_flight(flavour="betaflight", yaw=0.3, boot_offset=[2.0])
    f.vehicles.omega[:] = 1.0
    f.run(1.0)
    kinds = {type(m) for m in f.heard[0]}
    assert LocalPosition not in kinds
    assert f.last(Heartbeat).autopilot == 0
    a = f.last(Attitude)
    np.testing.assert_array_equal(a.omega, 0.0)
    yaw = math.degrees(2 * math.atan2(a.q_wb[3], a.q_wb[0]))
    assert yaw * 10 == pytest.approx(round(yaw * 10), abs=1e-6)
    g = f.last(GlobalPosition)
    assert 2000.0 < g.time <= 3000.0  # µs where ms belong
    heading = math.degrees(g.heading)
    assert heading == pytest.approx(round(heading), abs=1e-9)


def test_betaflight_is_deaf_to_commands_and_setpoints(make_flight):
    f = make_flight(flavour="betaflight")
    assert f.send(Command(400, (1, 0, 0, 0, 0, 0, 0), 1)) == []
    assert f.send(ParamRequestList(1, 1)) == []
    f.stream([0, 0, 0], 0.9)
    f.run(1.0)
    np.testing.assert_array_equal(f.vehicles.p[0], 0.0)
    assert not f.commander.armed


# Mixed fleets and faults.


def test_mixed_fleet_takes_parameters_where_they_are_known(make_flight):
    f = make_flight(2, flavour=["px4", "ardupilot"], parameters={"COM_OF_LOSS_T": 0.5})
    assert f.autopilots.units[0].parameters["COM_OF_LOSS_T"] == 0.5
    with pytest.raises(ValueError, match="NONSENSE"):
        make_flight(2, flavour=["px4", "ardupilot"], parameters={"NONSENSE": 0.5})


def test_position_lost_in_hold_levels_and_lands(make_flight):
    f = make_flight()
    f.in_the_air()
    f.autopilots.fail(0, "gps")
    f.heard[0].clear()
    f.run(1.0)
    assert f.commander.mode is Mode.LAND
    assert not [m for m in f.heard[0] if isinstance(m, LocalPosition)]
    assert tilt(f) < math.radians(5)
    assert f.run(15.0, lambda: not f.commander.armed)
    assert not f.last(SystemStatus).health & 0x20
    with pytest.raises(ValueError, match="choose one of gyro"):
        f.autopilots.fail(0, "nose")


def test_reboot_sets_the_clock_back_and_disarms(make_flight):
    f = make_flight(boot_offset=[100.0])
    f.in_the_air()
    before = f.last(LocalPosition).time
    f.autopilots.reboot(0)
    f.run(0.5)
    assert before > 100.0
    assert f.last(LocalPosition).time < 0.6
    assert not f.commander.armed
    f.run(5.0)
    assert f.vehicles.p[0, 2] == 0.0


def test_position_jump_and_gyro_bias(make_flight):
    f = make_flight()
    f.in_the_air()
    f.autopilots.shift_position(0, [2.0, 0.0, 0.0])
    f.run(0.1)
    assert f.last(LocalPosition).p[0] == pytest.approx(2.0, abs=0.2)
    f.autopilots.bias_gyro(0, [0.05, 0.05, 0.0])
    f.run(5.0)
    assert f.vehicles.p[0, 0] == pytest.approx(-2.0, abs=0.5)


def test_gust_weak_motor_and_thrust_scale_keep_it_flying(make_flight):
    f = make_flight()
    f.in_the_air()
    f.vehicles.body.thrust_max[:] *= 0.85
    f.vehicles.body.thrust_max[0, 2] *= 0.8
    f.run(2.0, wind=[5.0, 0.0, 0.0])
    f.run(5.0)
    np.testing.assert_allclose(f.vehicles.p[0], [0, 0, 2.5], atol=0.4)


def test_sources_do_not_matter_but_targets_do(make_flight):
    f = make_flight(2)
    assert f.send(Command(400, (1, 0, 0, 0, 0, 0, 0), 2), i=0, source=Source(7, 7)) == []
    assert f.send(Command(400, (1, 0, 0, 0, 0, 0, 0), 2), i=1, source=Source(7, 7)) != []
