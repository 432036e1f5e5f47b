"""The bridge against a controller that answers and does not fly: modes, arming, watchdog."""

import math
import struct

import numpy as np
import pytest
from fake_controller import FakeController

from mavlink_bridge.betaflight import MODES, PILOT, Betaflight
from mavlink_bridge.betaflight_bridge import POLLED, BetaflightBridge
from mavlink_bridge.bridge_config import BridgeConfig
from mavlink_bridge.bridge_loop import BridgeLoop, MspLine
from mavlink_bridge.codec import Codec
from mavlink_bridge.controller import interview
from mavlink_bridge.frames import euler_from_quaternion
from mavlink_bridge.messages import (
    Attitude,
    Command,
    CommandAck,
    CommandId,
    CommandResult,
    GpsInput,
    Heartbeat,
    LocalPosition,
    RateSetpoint,
    Received,
    Source,
    StatusText,
)
from mavlink_bridge.msp import Msp, Reply
from mavlink_bridge.thrust import ThrustMap

COMPANION = Source(1, 191)
STEP = 0.02


class Bench:
    """A bridge, its controller, and simulated time.

    pilot: his arm switch and his throttle [µs], in effect where the bridge's frames are not: as
    Betaflight does it, they hold for 0.3 s, and while he has them overridden.
    """

    def __init__(self, sole=True):
        self.fc = FakeController(sole)
        self.bridge = BetaflightBridge(
            1, interview(self.fc.answer), ThrustMap(0.5, 1.75), math.radians(60)
        )
        self.ask = Betaflight(1)
        self.t = 100.0
        self.heard, self.rc, self.rc_at = [], None, -math.inf
        self.setpoint = None
        self.pilot = (False, 1000)
        self.run(0.5)

    def send(self, messages):
        for m in messages:
            self.bridge.receive(self.t, Received(COMPANION, m))

    def run(self, seconds):
        for _ in range(round(seconds / STEP)):
            self.t += STEP
            self.bridge.read(self.t, self.fc.several(POLLED))
            if self.setpoint is not None:
                self.send([self.setpoint])
            out = self.bridge.cycle(self.t)
            self.heard += out.messages
            self.rc = struct.unpack("<16H", out.rc[5:-1]) if out.rc else None
            if self.rc:
                self.rc_at, self.frame = self.t, self.rc
            self._obey()

    def _obey(self):
        """The controller follows whose channels are in effect."""
        fc, arm = self.fc, self.fc.armed
        if self.t - self.rc_at <= 0.3 and (self.bridge._controller.sole or fc.override):
            arm, fc.throttle = self.frame[4] > 1700, self.frame[2]
        elif not self.bridge._controller.sole:
            arm, fc.throttle = self.pilot
        fit = fc.armed or (fc.throttle < 1050 and not fc.reasons & ~(1 << 28))
        fc.armed = arm and fit

    def last(self, kind):
        return [m for m in self.heard if isinstance(m, kind)][-1]

    def texts(self):
        return [m.text for m in self.heard if isinstance(m, StatusText)]

    def asked(self, command, *params, component=1):
        """The answer to a command."""
        padded = (*params, *(0.0,) * (7 - len(params)))
        self.send([Command(command, padded, 1, component)])
        self.run(STEP)
        return self.last(CommandAck).result

    def climb(self, seconds=1.5):
        """Up at 1 m/s, by whoever flies."""
        for _ in range(round(seconds / STEP)):
            self.fc.altitude += 2
            self.run(STEP)

    def hover(self):
        """Armed and taken off by command; in hold."""
        self.send(self.ask.arm())
        self.run(1.4)
        self.send(self.ask.takeoff(1.5))
        self.climb(2.5)
        assert self.bridge.mode == "hold"

    def fly(self, omega=(0.0, 0.0, 0.0), thrust=0.5):
        """In offboard, with setpoints at every cycle."""
        if not self.fc.armed:
            self.send(self.ask.arm())
            self.run(1.2)
        self.setpoint = RateSetpoint(0.0, np.array(omega), thrust, 1)
        self.run(0.1)
        self.send(self.ask.offboard())
        self.run(0.5)
        assert self.bridge.mode == "offboard"


def test_telemetry_at_50_hz_with_body_rates():
    b = Bench()
    b.fc.gyro = (164, 0, -328)  # 10 and −20 °/s
    b.heard.clear()
    b.run(1.0)
    attitudes = [m for m in b.heard if isinstance(m, Attitude)]
    assert len(attitudes) >= 50
    assert len([m for m in b.heard if isinstance(m, LocalPosition)]) >= 50
    assert np.degrees(attitudes[-1].omega) == pytest.approx([10, 0, -20], abs=0.1)


@pytest.mark.parametrize("empty", POLLED)
def test_an_answer_without_content_counts_as_none(empty):
    """A busy Betaflight sends such (seen with three SITLs on two cores)."""
    b = Bench()
    parts = [b"" if c == empty else b.fc.answer(c) for c in POLLED]
    payload = b"".join(bytes([len(p)]) + p for p in parts)
    b.bridge.cycle(b.t)
    b.bridge.read(b.t, Reply(Msp.MULTIPLE_MSP, payload))
    told = any(isinstance(m, LocalPosition) for m in b.bridge.cycle(b.t).messages)
    assert told == (empty is Msp.RAW_GPS)  # which firmware without GPS leaves empty
    b.run(0.1)
    assert isinstance(b.heard[-1], LocalPosition)


def test_attitude_is_enu_and_flu():
    b = Bench()
    b.fc.attitude = (100, 50, 90)  # right, nose down, east
    b.run(3.0)
    roll, pitch, yaw = np.degrees(euler_from_quaternion(b.last(Attitude).q_wb))
    assert (roll, pitch) == pytest.approx((10, 5), abs=0.2)
    assert yaw == pytest.approx(-0.5, abs=0.6)


def test_arms_by_the_switch_and_says_why_not():
    b = Bench()
    b.fc.reasons = 1 << 2 | 1 << 12
    b.run(0.1)
    b.send(b.ask.arm())
    b.run(0.1)
    assert b.last(CommandAck).result == 1
    assert b.texts() == ["Arming denied: RXLOSS CALIB"]
    assert b.rc[4] == 1000
    b.fc.reasons = 0
    b.run(0.1)
    b.send(b.ask.arm())
    b.run(1.0)
    assert b.last(CommandAck).result == 0
    assert b.last(Heartbeat).armed
    assert b.rc[2] == 1000  # throttle stays down


def test_setpoints_become_sticks():
    b = Bench()
    b.fly(np.radians([40.0, -80.0, 20.0]), 0.6)
    assert b.rc[:6] == (1550, 1400, 1600, 1475, 1900, 1000)
    assert b.last(Heartbeat).custom_mode == MODES["offboard"]


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_setpoint_that_is_not_finite_is_none(bad):
    b = Bench()
    b.fly()
    b.setpoint = RateSetpoint(0.0, np.array([bad, 0, 0]), 0.5, 1)
    b.run(0.5)
    assert b.bridge.mode == "hold"


def test_offboard_wants_a_stream_first():
    b = Bench()
    b.send(b.ask.offboard())
    b.run(0.1)
    assert b.last(CommandAck).result == 1
    assert b.bridge.mode == "hold"


def test_watchdog_levels_at_once_and_lands_where_no_pilot_stands_by():
    b = Bench()
    b.fly(np.radians([200.0, 0.0, 0.0]), 0.6)
    b.setpoint, stopped = None, b.t
    while b.bridge.mode == "offboard":
        b.run(STEP)
    assert b.t - stopped <= 0.3
    assert b.rc[5] > 1700  # ANGLE
    assert abs(b.rc[0] - 1500) < 130  # no more than a gentle lean
    assert b.rc[3] == 1500
    assert "Setpoints stopped: level" in b.texts()
    b.run(8.0)  # this one stands on the ground, so landing ends at once
    beats = [m for m in b.heard if isinstance(m, Heartbeat)]
    assert MODES["land"] in {m.custom_mode for m in beats}
    assert 5 in {m.system_status for m in beats}
    assert not beats[-1].armed


def test_watchdog_is_silent_after_300_ms_so_that_the_pilot_has_it():
    b = Bench(sole=False)
    assert b.rc is None  # the pilot flies
    b.fc.override = True
    b.run(0.2)
    b.fly(np.radians([100.0, 0.0, 0.0]))
    b.setpoint, stopped = None, b.t
    b.run(1.0)
    assert b.rc_at - stopped <= 0.3
    assert b.rc is None
    assert b.last(Heartbeat).custom_mode == PILOT
    # Setpoints that come back take nothing: only the pilot's switch gives control again.
    b.setpoint = RateSetpoint(0.0, np.zeros(3), 0.5, 1)
    b.run(0.5)
    assert b.rc is None


def test_the_pilots_switch_wins_at_once():
    b = Bench(sole=False)
    b.fc.override = True
    b.run(0.2)
    b.fly()
    b.fc.override = False
    b.run(2 * STEP)
    assert b.rc is None
    b.send(b.ask.offboard())
    b.run(0.1)
    assert b.bridge.mode == "pilot"


def test_take_off_climbs_and_never_in_the_first_second():
    b = Bench()
    b.send(b.ask.arm())
    b.run(0.3)
    b.send(b.ask.takeoff(2.0))
    b.run(0.1)
    assert b.last(CommandAck).result == 1
    b.run(1.0)
    b.send(b.ask.takeoff(2.0))
    b.run(0.5)
    assert b.bridge.mode == "takeoff"
    assert b.rc[2] > 1500
    assert b.rc[5] > 1700


def flown_by_the_pilot():
    """In the air at 1.5 m by RC alone; the bridge stands by."""
    b = Bench(sole=False)
    b.pilot = (True, 1000)
    b.run(1.5)
    b.pilot = (True, 1500)
    b.climb()
    assert b.fc.armed
    return b


def test_a_vehicle_that_the_pilot_flies_is_taken_over_in_flight():
    b = flown_by_the_pilot()
    assert b.last(LocalPosition).p[2] == pytest.approx(1.5, abs=0.4)
    b.fc.override = True
    b.run(1.0)
    assert b.bridge.mode == "hold"
    assert b.fc.armed
    assert b.rc[4] > 1700
    assert b.rc[2] > 1300  # carried
    b.fly(thrust=0.6)
    assert b.rc[2] == 1600
    b.fc.override = False
    b.run(1.0)
    assert b.rc is None
    assert b.fc.armed


def test_handed_over_armed_on_the_ground_the_motors_idle_until_the_first_throttle():
    b = Bench(sole=False)
    b.pilot = (True, 1000)
    b.run(1.5)
    b.fc.override = True
    b.run(1.0)
    assert b.fc.armed
    assert (b.rc[2], b.rc[4]) == (1000, 1900)
    b.fly(thrust=0.6)
    assert b.rc[2] == 1600


def test_a_bridge_that_starts_anew_in_flight_goes_on():
    b = Bench()
    b.hover()
    anew = Bench()
    anew.fc, anew.bridge = (
        b.fc,
        BetaflightBridge(1, interview(b.fc.answer), ThrustMap(0.5, 1.75), math.radians(60)),
    )
    anew.run(0.5)
    assert anew.fc.armed
    assert anew.rc[2] > 1300


@pytest.mark.parametrize("mode", ["hold", "takeoff", "offboard", "land"])
def test_in_flight_it_disarms_by_force_only(mode):
    b = Bench()
    if mode == "takeoff":
        b.send(b.ask.arm())
        b.run(1.4)
        b.send(b.ask.takeoff(2.0))
        b.climb(0.5)
    else:
        b.hover()
        if mode == "offboard":
            b.fly()
        if mode == "land":
            b.send(b.ask.land())
            b.run(STEP)
    assert b.bridge.mode == mode
    assert b.asked(CommandId.COMPONENT_ARM_DISARM, 0.0) == CommandResult.DENIED
    assert b.texts()[-1] == "Disarming denied: in flight"
    assert b.fc.armed
    assert b.asked(CommandId.COMPONENT_ARM_DISARM, 0.0, 21196.0) == CommandResult.ACCEPTED
    b.run(STEP)
    assert not b.fc.armed


def test_armed_on_the_ground_it_disarms_on_request():
    b = Bench()
    b.send(b.ask.arm())
    b.run(0.5)
    assert b.asked(CommandId.COMPONENT_ARM_DISARM, 0.0) == CommandResult.ACCEPTED
    b.run(STEP)
    assert not b.fc.armed


def test_while_the_pilot_flies_nothing_is_taken_and_nothing_kept_for_later():
    b = flown_by_the_pilot()
    rejected = CommandResult.TEMPORARILY_REJECTED
    assert b.asked(CommandId.NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 2.0) == rejected
    assert b.asked(CommandId.NAV_LAND) == rejected
    assert b.asked(CommandId.COMPONENT_ARM_DISARM, 0.0, 21196.0) == rejected
    assert b.rc is None
    assert b.last(Heartbeat).custom_mode == PILOT
    b.fc.override = True
    b.run(1.0)
    assert b.fc.armed


def test_released_to_the_pilot_only_his_switch_hands_over_again():
    b = flown_by_the_pilot()
    b.fc.override = True
    b.run(0.2)
    b.fly()
    b.setpoint = None
    b.run(1.0)
    assert b.asked(CommandId.DO_SET_MODE, 1.0, MODES["hold"]) == CommandResult.TEMPORARILY_REJECTED
    assert b.rc is None
    assert b.fc.armed
    b.fc.override = False
    b.run(0.2)
    b.fc.override = True
    b.run(0.2)
    assert b.bridge.mode == "hold"
    assert b.fc.armed


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e38])
def test_a_fix_whose_velocity_is_none_is_refused(bad):
    b = Bench()
    b.hover()
    for k in range(50):
        v = np.zeros(3)
        v[k % 3] = bad
        b.send([GpsInput(0.0, 3, 47.4, 8.5, 488.0, v)])
        b.run(STEP)
    assert np.abs(b.last(LocalPosition).v).max() < 1.0
    assert b.rc[4] > 1700


def test_a_fix_without_velocity_does_not_stand_still():
    """It moves east at 2 m/s, and the receiver tells places only."""
    b = Bench()
    b.fc.gps = False
    b.run(0.5)
    east = 2.0 / (math.radians(1.0) * 6371008.8 * math.cos(math.radians(47.4)))
    for k in range(40):
        told = GpsInput(0.0, 3, 47.4, 8.5 + 0.1 * k * east, 488.0, None)
        b.send([r.message for r in Codec(1, 1).decode(Codec(1, 220).encode([told]))])
        b.run(0.1)
    assert b.last(LocalPosition).v[0] == pytest.approx(2.0, abs=0.3)


def drifting():
    """Taken off, in hold, told to drift east: the sticks lean against it."""
    b = Bench()
    b.hover()
    b.fc.gps = False
    for _ in range(20):
        b.send([GpsInput(0.0, 3, 47.4, 8.5, 488.0, np.array([0.8, 0.0, 0.0]))])
        b.run(0.1)
    assert abs(b.rc[1] - 1500) > 30
    return b


def test_without_a_fix_no_position_is_told_and_it_levels_and_lands_all_the_same():
    b = drifting()
    b.run(1.1)
    b.heard.clear()
    b.run(5.0)
    assert not [m for m in b.heard if isinstance(m, LocalPosition)]
    assert len([m for m in b.heard if isinstance(m, Attitude)]) >= 250
    assert b.rc[:2] == (1500, 1500)
    assert b.rc[2] > 1300  # its height is still seen to
    b.send(b.ask.land())
    b.run(3.0)  # nothing gives way, so it has landed
    assert not b.fc.armed
    b.send(b.ask.arm())
    b.run(0.5)
    assert "Arming denied: no position" in b.texts()


def test_a_controller_that_answers_no_more_is_flown_level():
    b = drifting()
    for _ in range(round(2.0 / STEP)):
        b.t += STEP
        out = b.bridge.cycle(b.t)
    rc = struct.unpack("<16H", out.rc[5:-1])
    assert rc[:2] == (1500, 1500)
    assert 1300 < rc[2] < 1700
    assert rc[4] > 1700


@pytest.mark.parametrize("component", [100, 154, 191])
def test_what_is_for_another_component_is_not_ours(component):
    b = Bench()
    b.send([Command(CommandId.COMPONENT_ARM_DISARM, (1.0, *(0.0,) * 6), 1, component)])
    b.setpoint = RateSetpoint(0.0, np.zeros(3), 0.5, 1, component)
    b.run(1.0)
    assert not b.fc.armed
    assert not [m for m in b.heard if isinstance(m, CommandAck)]
    b.send(b.ask.offboard())
    b.run(STEP)
    assert "Offboard refused: no setpoints" in b.texts()
    assert b.asked(CommandId.COMPONENT_ARM_DISARM, 1.0, component=0) == CommandResult.ACCEPTED


class Stream:
    """A line that keeps what is sent."""

    problem = ""

    def __init__(self):
        self.sent = []

    def send(self, data):
        self.sent.append(data)
        return True

    def close(self):
        pass


@pytest.mark.parametrize("sole", [True, False])
def test_the_last_thing_sent_is_level_sticks(sole):
    b = Bench(sole)
    b.fc.override = True
    b.run(0.2)
    b.fly(np.radians([100.0, 50.0, 0.0]), 0.6)
    config, stream = BridgeConfig.model_validate({"link": {"ground": None}}), Stream()
    loop = BridgeLoop(config, MspLine(stream), b.bridge._controller)
    loop._bridge = b.bridge
    loop.run(lambda: True)
    rc = struct.unpack("<16H", stream.sent[-1][5:-1])
    assert rc[:6] == (1500, 1500, 1500, 1500, 1900, 1900)  # at hover thrust, armed, ANGLE on


def test_a_bridge_that_ends_says_nothing_into_the_pilots_flight():
    assert flown_by_the_pilot().bridge.parting() == b""
