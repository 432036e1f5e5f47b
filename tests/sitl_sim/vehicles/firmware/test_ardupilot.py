"""Where the emulated ArduCopter differs from PX4."""

import math

import numpy as np
import pytest

from mavlink_bridge.wire.messages import (
    AutopilotVersion,
    Command,
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
)
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.firmware.flavour import Mode

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


def test_it_sends_heartbeats_alone_until_requested(make_flight):
    f = make_flight(flavour="ardupilot")
    f.run(3.0)
    assert {type(m) for m in f.heard[0]} == {Heartbeat}
    assert f.last(Heartbeat).autopilot == 3
    assert f.last(Heartbeat).custom_mode == 0
    assert f.command(511, 32, 20000) == 0
    f.run(1.0)
    assert sum(isinstance(m, LocalPosition) for m in f.heard[0]) == pytest.approx(50, abs=2)


def test_it_takes_off_only_armed_and_guided(make_flight):
    f = make_flight(flavour="ardupilot")
    assert f.command(22, 0, 0, 0, 0, 0, 0, 5.0) == 4
    assert f.command(400, 1) == 0  # in stabilize
    assert f.command(22, 0, 0, 0, 0, 0, 0, 5.0) == 4


def test_it_does_not_arm_in_land(make_flight):
    f = make_flight(flavour="ardupilot")
    f.send(SetMode(1, 1, 9))
    assert f.command(400, 1) == 4
    assert f.texts()[-1] == "Arm: LAND mode not armable"


def test_its_motors_stand_still_for_two_seconds_once_armed(make_flight):
    """Measured on 4.7: 2 m up 2.7 s after the request, which came 1.2 s after arming."""
    f = make_flight(flavour="ardupilot")
    assert f.command(176, 1, GUIDED) == 0
    assert f.command(400, 1) == 0
    f.run(1.2)
    assert f.command(22, 0, 0, 0, 0, 0, 0, 3.0) == 0
    f.run(0.7)
    assert f.vehicles.p[0, 2] < 0.01
    asked = f.autopilots.t
    assert f.run(5.0, lambda: f.vehicles.p[0, 2] > 2.0)
    assert f.autopilots.t + 0.7 - asked == pytest.approx(2.7, abs=0.7)
    assert f.command(22, 0, 0, 0, 0, 0, 0, 3.0) == 4  # in the air


def test_what_is_for_a_companion_is_left_to_it_once_it_is_heard(make_flight):
    """Before that the vehicle itself lands, as ArduPilot's routing has it."""
    f = make_flight(flavour="ardupilot")
    land = Command(21, (0.0,) * 7, 1, 191)
    assert [m.result for m in f.send(land)] == [0]
    assert f.commander.mode is Mode.LAND
    assert f.command(176, 1, GUIDED) == 0
    f.send(Command(512, (148.0,) + (0.0,) * 6, 1), source=Source(1, 191), link="companion")
    assert f.send(land) == []
    assert f.commander.mode is Mode.OFFBOARD


def test_a_command_with_nan_is_never_answered(make_flight):
    """The real SITL ends with a floating point exception."""
    f = make_flight(flavour="ardupilot")
    assert f.send(Command(22, (math.nan,) * 6 + (3.0,), 1)) == []


def test_guided_takes_thrust_as_climb_rate(make_flight):
    f = guided(make_flight)
    f.stream([0, 0, 0], 0.5)
    f.run(2.0)
    assert abs(f.vehicles.v[0, 2]) < 0.15
    f.stream([0, 0, 0.5], 0.75)
    f.run(2.0)
    assert f.vehicles.v[0, 2] == pytest.approx(1.25, abs=0.2)
    assert f.vehicles.omega[0, 2] == pytest.approx(0.5, abs=0.1)


def test_an_option_makes_thrust_thrust(make_flight):
    f = guided(make_flight, parameters={"GUID_OPTIONS": 8})
    f.stream([0, 0, 0], HOVER * 1.2)
    f.run(0.8)
    assert f.vehicles.specific_force[0, 2] == pytest.approx(1.2 * 9.81, rel=0.05)


def test_it_levels_after_guid_timeout_and_stays_guided(make_flight):
    f = guided(make_flight)
    f.stream([0, 0.3, 0], 0.5)
    f.run(0.8)
    f.stream([0, 0, 0], 0.5)
    f.run(0.2)
    f.setpoint = None
    f.run(2.7)
    assert f.tilt > math.radians(8)
    f.run(1.0)
    assert f.tilt < math.radians(3)
    assert f.commander.mode is Mode.OFFBOARD
    f.run(2.0)
    assert abs(f.vehicles.v[0, 2]) < 0.2


def test_it_stops_on_a_partial_mask(make_flight):
    f = guided(make_flight, parameters={"GUID_OPTIONS": 8})
    f.stream([0, 0, 0.8], HOVER)
    f.run(1.0)
    f.setpoint = RateSetpoint(0.0, np.array([0, 0, 0.8]), HOVER, 1, type_mask=128 | 4)
    f.run(2.0)
    assert abs(f.vehicles.omega[0, 2]) < 0.1


def test_positive_thrust_on_the_ground_takes_off(make_flight):
    f = make_flight(flavour="ardupilot")
    f.command(176, 1, GUIDED)
    f.command(400, 1)
    f.stream([0, 0, 0], 0.5)
    f.run(1.0)
    assert f.vehicles.p[0, 2] == 0.0
    f.stream([0, 0, 0], 0.8)
    f.run(2.0)
    assert f.vehicles.p[0, 2] > 0.5


def test_parameters_cross_by_value(make_flight):
    f = make_flight(flavour="ardupilot")
    values = {v.name: v for v in f.send(ParamRequestList(1, 1))}
    assert values["DISARM_DELAY"].value == 10.0
    assert values["DISARM_DELAY"].param_type == 2
    (echo,) = f.send(ParamSet(1, 1, "GUID_OPTIONS", 8.0, 6))
    assert echo.value == 8.0
    _, version = f.send(Command(512, (148, 0, 0, 0, 0, 0, 0), 1))
    assert isinstance(version, AutopilotVersion)
    assert version.capabilities & 0x20000


def test_it_lands_and_disarms(make_flight):
    f = guided(make_flight)
    assert f.command(21) == 0
    assert f.run(20.0, lambda: not f.commander.armed)
    assert f.last(Heartbeat).custom_mode == 9


def test_a_mission_begins_behind_home(make_flight):
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


def test_refusals_as_recorded_from_arducopter(make_flight):
    """4.7-dev: an unknown mode or message fails (4), an unknown interval is denied (2)."""
    f = make_flight(flavour="ardupilot")
    assert f.command(176, 1, 99) == 4
    assert f.command(512, 999) == 4
    assert f.command(511, 999, 1e6) == 2
    assert f.texts() == ["No such mode 99", "No ap_message for mavlink id (999)"]
    assert f.command(512, 24) == 0
