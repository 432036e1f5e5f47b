"""Hand-over between a pilot and the bridge; arming and disarming by either."""

import math

import numpy as np
import pytest

from mavlink_bridge.autopilots.betaflight import MODES, PILOT
from mavlink_bridge.betaflight.bridge import BetaflightBridge
from mavlink_bridge.betaflight.controller import query_controller
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.messages import (
    CommandId,
    CommandResult,
    Heartbeat,
    LocalPosition,
    RateSetpoint,
)
from tests.mavlink_bridge.betaflight.bench import STEP, Bench


def flown_by_the_pilot():
    """Return a bench whose pilot flies at 1.5 m; the bridge sends no RC frames."""
    b = Bench(only_receiver=False)
    b.pilot = (True, 1000)
    b.run(1.5)
    b.pilot = (True, 1500)
    b.climb()
    assert b.fc.armed
    return b


def test_the_pilot_hands_over_in_flight():
    b = flown_by_the_pilot()
    assert b.last(LocalPosition).p[2] == pytest.approx(1.5, abs=0.4)
    b.fc.override = True
    b.run(1.0)
    assert b.bridge.mode == "hold"
    assert b.fc.armed
    assert b.rc[4] > 1700
    assert b.rc[2] > 1300  # thrust that holds the height
    b.fly(thrust=0.6)
    assert b.rc[2] == 1600
    b.fc.override = False
    b.run(1.0)
    assert b.rc is None
    assert b.fc.armed


def test_after_a_hand_over_on_the_ground_the_motors_idle_until_the_first_throttle():
    b = Bench(only_receiver=False)
    b.pilot = (True, 1000)
    b.run(1.5)
    b.fc.override = True
    b.run(1.0)
    assert b.fc.armed
    assert (b.rc[2], b.rc[4]) == (1000, 1900)
    b.fly(thrust=0.6)
    assert b.rc[2] == 1600


def test_after_a_landing_by_the_pilot_the_motors_idle_until_the_first_throttle():
    b = flown_by_the_pilot()
    for _ in range(round(1.5 / STEP)):
        b.fc.altitude -= 2
        b.run(STEP)
    b.pilot = (True, 1000)
    b.run(3.0)
    b.fc.override = True
    b.run(1.0)
    assert b.fc.armed
    assert (b.rc[2], b.rc[4]) == (1000, 1900)


def test_a_dive_by_the_pilot_is_not_a_landing():
    b = flown_by_the_pilot()
    b.climb(6.0)
    b.pilot = (True, 1000)
    b.run(3.0)
    b.fc.override = True
    b.run(0.5)
    assert b.rc[2] > 1300


def test_a_bridge_restarted_in_flight_keeps_flying():
    b = Bench()
    b.hover()
    anew = Bench()
    anew.fc, anew.bridge = (
        b.fc,
        BetaflightBridge(1, query_controller(b.fc.answer), ThrustMap(0.5, 1.75), math.radians(60)),
    )
    anew.run(0.5)
    assert anew.fc.armed
    assert anew.rc[2] > 1300


@pytest.mark.parametrize("mode", ["hold", "takeoff", "offboard", "land"])
def test_in_flight_only_a_forced_command_disarms(mode):
    b = Bench()
    if mode == "takeoff":
        b.send(b.adapter.arm())
        b.run(1.4)
        b.send(b.adapter.takeoff(2.0))
        b.climb(0.5)
    else:
        b.hover()
        if mode == "offboard":
            b.fly()
        if mode == "land":
            b.send(b.adapter.land())
            b.run(STEP)
    assert b.bridge.mode == mode
    assert b.command(CommandId.COMPONENT_ARM_DISARM, 0.0) == CommandResult.DENIED
    assert b.texts()[-1] == "Disarming denied: in flight"
    assert b.fc.armed
    assert b.command(CommandId.COMPONENT_ARM_DISARM, 0.0, 21196.0) == CommandResult.ACCEPTED
    b.run(STEP)
    assert not b.fc.armed


def test_on_the_ground_a_command_disarms():
    b = Bench()
    b.send(b.adapter.arm())
    b.run(0.5)
    assert b.command(CommandId.COMPONENT_ARM_DISARM, 0.0) == CommandResult.ACCEPTED
    b.run(STEP)
    assert not b.fc.armed


def test_commands_are_refused_while_the_pilot_flies_and_have_no_later_effect():
    b = flown_by_the_pilot()
    rejected = CommandResult.TEMPORARILY_REJECTED
    assert b.command(CommandId.NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 2.0) == rejected
    assert b.command(CommandId.NAV_LAND) == rejected
    assert b.command(CommandId.COMPONENT_ARM_DISARM, 0.0, 21196.0) == rejected
    assert b.rc is None
    assert b.last(Heartbeat).custom_mode == PILOT
    b.fc.override = True
    b.run(1.0)
    assert b.fc.armed


def test_after_a_release_only_the_pilots_switch_hands_over_again():
    b = flown_by_the_pilot()
    b.fc.override = True
    b.run(0.2)
    b.fly()
    b.setpoint = None
    b.run(1.0)
    assert (
        b.command(CommandId.DO_SET_MODE, 1.0, MODES["hold"]) == CommandResult.TEMPORARILY_REJECTED
    )
    assert b.rc is None
    assert b.fc.armed
    b.fc.override = False
    b.run(0.2)
    b.fc.override = True
    b.run(0.2)
    assert b.bridge.mode == "hold"
    assert b.fc.armed


def test_watchdog_ends_the_rc_frames_after_300_ms_so_that_the_pilot_has_control():
    b = Bench(only_receiver=False)
    assert b.rc is None  # the pilot flies
    b.fc.override = True
    b.run(0.2)
    b.fly(np.radians([100.0, 0.0, 0.0]))
    b.setpoint, stopped = None, b.t
    b.run(1.0)
    assert b.rc_at - stopped <= 0.3
    assert b.rc is None
    assert b.last(Heartbeat).custom_mode == PILOT
    # New setpoints take no control: only the pilot's switch hands over again.
    b.setpoint = RateSetpoint(0.0, np.zeros(3), 0.5, 1)
    b.run(0.5)
    assert b.rc is None


def test_the_pilots_switch_takes_back_at_once():
    b = Bench(only_receiver=False)
    b.fc.override = True
    b.run(0.2)
    b.fly()
    b.fc.override = False
    b.run(2 * STEP)
    assert b.rc is None
    b.send(b.adapter.offboard())
    b.run(0.1)
    assert b.bridge.mode == "pilot"


def test_a_bridge_that_ends_sends_no_frame_while_the_pilot_flies():
    assert flown_by_the_pilot().bridge.final_frame() == b""
