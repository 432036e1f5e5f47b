"""The bridge with a controller that answers and does not fly: modes, arming, watchdog."""

import math
import struct
from dataclasses import replace

import numpy as np
import pytest

from mavlink_bridge.autopilots.betaflight import MODES
from mavlink_bridge.betaflight.config import BridgeConfig
from mavlink_bridge.betaflight.msp import Msp, Reply
from mavlink_bridge.betaflight.polling import POLLED
from mavlink_bridge.betaflight.process import BridgeLoop, MspLine
from mavlink_bridge.shared.frames import euler_from_quaternion
from mavlink_bridge.wire.messages import (
    Attitude,
    AttitudeTarget,
    Command,
    CommandAck,
    CommandId,
    CommandResult,
    Heartbeat,
    LocalPosition,
    RateSetpoint,
)
from tests.mavlink_bridge.betaflight.bench import STEP, Bench


def test_telemetry_at_50_hz_with_body_rates():
    b = Bench()
    b.fc.gyro = (164, 0, -328)  # 10 and −20 °/s
    b.messages.clear()
    b.run(1.0)
    attitudes = [m for m in b.messages if isinstance(m, Attitude)]
    assert len(attitudes) >= 50
    assert len([m for m in b.messages if isinstance(m, LocalPosition)]) >= 50
    assert np.degrees(attitudes[-1].omega) == pytest.approx([10, 0, -20], abs=0.1)


@pytest.mark.parametrize("empty", POLLED)
def test_an_answer_with_an_empty_part_is_ignored(empty):
    """A busy Betaflight sends such answers; firmware without GPS has no RAW_GPS at all."""
    b = Bench()
    parts = [b"" if c == empty else b.fc.answer(c) for c in POLLED]
    payload = b"".join(bytes([len(p)]) + p for p in parts)
    b.bridge.cycle(b.t)
    b.bridge.read(b.t, Reply(Msp.MULTIPLE_MSP, payload))
    sent = any(isinstance(m, LocalPosition) for m in b.bridge.cycle(b.t).messages)
    assert sent == (empty is Msp.RAW_GPS)
    b.run(0.1)
    assert isinstance(b.messages[-1], LocalPosition)


def test_attitude_is_enu_and_flu():
    b = Bench()
    b.fc.attitude = (100, 50, 90)  # right, nose down, east
    b.run(3.0)
    roll, pitch, yaw = np.degrees(euler_from_quaternion(b.last(Attitude).q_wb))
    assert (roll, pitch) == pytest.approx((10, 5), abs=0.2)
    assert yaw == pytest.approx(-0.5, abs=0.6)


def test_arms_by_the_switch_and_reports_why_arming_is_denied():
    b = Bench()
    b.fc.reasons = 1 << 2 | 1 << 12
    b.run(0.1)
    b.send(b.adapter.arm())
    b.run(0.1)
    assert b.last(CommandAck).result == 1
    assert b.texts() == ["Arming denied: RXLOSS CALIB"]
    assert b.rc[4] == 1000
    b.fc.reasons = 0
    b.run(0.1)
    b.send(b.adapter.arm())
    b.run(1.0)
    assert b.last(CommandAck).result == 0
    assert b.last(Heartbeat).armed
    assert b.rc[2] == 1000  # throttle stays down


def test_setpoints_give_stick_deflections():
    b = Bench()
    b.fly(np.radians([40.0, -80.0, 20.0]), 0.6)
    assert b.rc[:6] == (1550, 1400, 1600, 1475, 1900, 1000)
    assert b.last(Heartbeat).custom_mode == MODES["offboard"]


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_setpoint_that_is_not_finite_is_ignored(bad):
    b = Bench()
    b.fly()
    b.setpoint = RateSetpoint(0.0, np.array([bad, 0, 0]), 0.5, 1)
    b.run(1.2)
    assert b.bridge.mode == "hold"


@pytest.mark.parametrize(
    ("system", "component", "mode"),
    [(1, 1, "offboard"), (0, 1, "offboard"), (1, 0, "offboard"), (2, 1, "hold"), (1, 154, "hold")],
)
def test_setpoints_for_another_vehicle_or_component_are_ignored(system, component, mode):
    b = Bench()
    b.fly()
    b.setpoint = RateSetpoint(0.0, np.radians([40.0, 0.0, 0.0]), 0.5, system, component)
    b.run(1.2)
    assert b.bridge.mode == mode
    assert (b.rc[0] == 1550) == (mode == "offboard")


def test_commands_for_another_vehicle_are_neither_obeyed_nor_answered():
    b = Bench()
    arm = b.adapter.arm()
    b.messages.clear()
    b.send([replace(m, target_system=2) for m in arm])
    b.run(1.0)
    assert not b.fc.armed
    assert not [m for m in b.messages if isinstance(m, CommandAck)]
    b.send(arm)
    b.run(1.2)
    assert b.fc.armed


def test_offboard_needs_a_stream_of_setpoints():
    b = Bench()
    b.send(b.adapter.offboard())
    b.run(0.1)
    assert b.last(CommandAck).result == 1
    assert b.bridge.mode == "hold"


def test_watchdog_levels_at_once_and_lands_where_there_is_no_pilot():
    b = Bench()
    b.fly(np.radians([200.0, 0.0, 0.0]), 0.6)
    b.setpoint = None
    b.run(0.3)
    assert b.bridge.mode == "offboard"
    assert b.rc[5] > 1700  # ANGLE
    assert abs(b.rc[0] - 1500) < 130  # a gentle tilt at most
    assert b.rc[3] == 1500
    assert "Setpoints stopped: level" in b.texts()
    assert b.last(Heartbeat).system_status == 5
    b.run(0.8)
    assert b.bridge.mode == "hold"
    b.run(8.0)  # its height does not change, so landing ends at once
    beats = [m for m in b.messages if isinstance(m, Heartbeat)]
    assert MODES["land"] in {m.custom_mode for m in beats}
    assert 5 in {m.system_status for m in beats}
    assert not beats[-1].armed


def test_a_companion_that_is_held_up_for_a_moment_flies_on():
    """A tick of 90 ms on a busy board once ended a mission: two of its setpoints were missing."""
    b = Bench()
    b.fly(np.radians([200.0, 0.0, 0.0]), 0.6)
    flown, setpoint = b.rc[:4], b.setpoint
    b.setpoint = None
    b.run(0.9)
    assert abs(b.rc[0] - 1500) < 130
    b.setpoint = setpoint
    b.run(0.6)
    assert (b.bridge.mode, b.rc[:4]) == ("offboard", flown)
    assert b.rc[5] < 1700  # rates
    assert b.last(Heartbeat).system_status == 4
    b.setpoint = None
    b.run(1.2)
    b.setpoint = setpoint
    b.run(0.2)
    assert b.bridge.mode == "hold"  # from now on only a new request begins offboard


def test_take_off_climbs_and_not_in_the_first_second_after_arming():
    b = Bench()
    b.send(b.adapter.arm())
    b.run(0.3)
    b.send(b.adapter.takeoff(2.0))
    b.run(0.1)
    assert b.last(CommandAck).result == 1
    b.run(1.0)
    b.send(b.adapter.takeoff(2.0))
    b.run(0.5)
    assert b.bridge.mode == "takeoff"
    assert b.rc[2] > 1500
    assert b.rc[5] > 1700
    told = b.last(AttitudeTarget).thrust  # from which the companion learns the hover thrust
    assert b.rc[2] == pytest.approx(1000 + 1000 * told, abs=10)


@pytest.mark.parametrize("component", [100, 154, 191])
def test_messages_for_another_component_are_ignored(component):
    b = Bench()
    b.send([Command(CommandId.COMPONENT_ARM_DISARM, (1.0, *(0.0,) * 6), 1, component)])
    b.setpoint = RateSetpoint(0.0, np.zeros(3), 0.5, 1, component)
    b.run(1.0)
    assert not b.fc.armed
    assert not [m for m in b.messages if isinstance(m, CommandAck)]
    b.send(b.adapter.offboard())
    b.run(STEP)
    assert "Offboard refused: no setpoints" in b.texts()
    assert b.command(CommandId.COMPONENT_ARM_DISARM, 1.0, component=0) == CommandResult.ACCEPTED


@pytest.mark.parametrize("system", [2, 255])
def test_messages_for_another_vehicle_are_ignored(system):
    b = Bench()
    b.send([Command(CommandId.COMPONENT_ARM_DISARM, (1.0, *(0.0,) * 6), system, 1)])
    b.setpoint = RateSetpoint(0.0, np.zeros(3), 0.5, system, 1)
    b.run(1.0)
    assert not b.fc.armed
    assert not [m for m in b.messages if isinstance(m, CommandAck)]
    b.send(b.adapter.offboard())
    b.run(STEP)
    assert "Offboard refused: no setpoints" in b.texts()
    b.setpoint = RateSetpoint(0.0, np.zeros(3), 0.5, 0, 1)  # for every vehicle
    b.run(0.1)
    b.send(b.adapter.offboard())
    b.run(STEP)
    assert b.bridge.mode == "offboard"


class Stream:
    """A line that keeps the bytes sent."""

    problem = ""

    def __init__(self):
        self.sent = []

    def send(self, data):
        self.sent.append(data)
        return True

    def close(self):
        pass


@pytest.mark.parametrize("only_receiver", [True, False])
def test_the_final_frame_has_level_sticks(only_receiver):
    b = Bench(only_receiver)
    b.fc.override = True
    b.run(0.2)
    b.fly(np.radians([100.0, 50.0, 0.0]), 0.6)
    config, stream = BridgeConfig.model_validate({"link": {"ground": None}}), Stream()
    loop = BridgeLoop(config, MspLine(stream), b.bridge._controller)
    loop._bridge = b.bridge
    loop.run(lambda: True)
    rc = struct.unpack("<16H", stream.sent[-1][5:-1])
    assert rc[:6] == (1500, 1500, 1500, 1500, 1900, 1900)  # at hover thrust, armed, ANGLE on
