"""The emulated Betaflight: RC channels in, telemetry with its quirks out."""

import math

import numpy as np
import pytest

from mavlink_bridge.wire.messages import (
    Attitude,
    Command,
    GlobalPosition,
    Heartbeat,
    LocalPosition,
    ParamRequestList,
)


def channels(roll=1500, pitch=1500, throttle=1000, yaw=1500, arm=1000):
    return [float(c) for c in (roll, pitch, throttle, yaw, arm, 1000, 1000, 1000)]


def fly_sticks(f, seconds, **positions):
    for _ in range(round(seconds / 0.02)):
        f.autopilots.sticks(0, channels(**positions))
        f.run(0.02)


def test_it_flies_by_sticks(make_flight):
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


def test_it_arms_only_by_a_fresh_switch_and_low_throttle(make_flight):
    f = make_flight(flavour="betaflight")
    fly_sticks(f, 0.2, arm=1900)
    assert not f.commander.armed
    fly_sticks(f, 0.1)
    fly_sticks(f, 0.1, arm=1900, throttle=1300)
    assert not f.commander.armed
    fly_sticks(f, 0.1, arm=1900)
    assert f.commander.armed


def test_it_drops_when_rc_is_lost(make_flight):
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


def test_its_telemetry_has_its_quirks(make_flight):
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


def test_it_ignores_commands_and_setpoints(make_flight):
    f = make_flight(flavour="betaflight")
    assert f.send(Command(400, (1, 0, 0, 0, 0, 0, 0), 1)) == []
    assert f.send(ParamRequestList(1, 1)) == []
    f.stream([0, 0, 0], 0.9)
    f.run(1.0)
    np.testing.assert_array_equal(f.vehicles.p[0], 0.0)
    assert not f.commander.armed
