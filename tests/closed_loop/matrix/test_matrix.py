"""The fault matrix: each row holds, and fails without its mechanism."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from companion.estimation import own_state, vehicle
from companion.estimation.delay import Delay, DelayEstimator
from companion.estimation.height import HeightEstimator
from companion.estimation.hover_thrust import HoverEstimate, HoverThrust
from companion.estimation.obstacle_map import ObstacleMap
from companion.estimation.own_state import OwnState
from companion.estimation.tracker import Tracker
from companion.estimation.velocity_by_sight import VelocityFromGround
from companion.guidance.fence import FenceConfig
from companion.perception import camera_health
from companion.perception.camera_alignment import CameraAlignment
from companion.perception.camera_health import CameraHealth
from companion.process import pace
from companion.stage_clock import StageClock
from companion.supervision.certify import Certifier
from companion.supervision.guard import AutopilotRequest, Guard
from companion.supervision.phases import PhaseMachine
from companion.types import Phase
from mavlink_bridge.shared.settings import SettingsError
from mavlink_bridge.wire import allowance, codec, framing
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.messages import Attitude, Received, Source
from mavlink_bridge.wire.signing import Signing
from tests.closed_loop.matrix import (
    attack_checks,
    checks,
    inprocess,
    power_checks,
    thrust_checks,
    world_checks,
)

# Rows that the forest cannot show, with more seeds: they are flown with one above.
ALONE = ("32", "32_late", "36", "36_in_flight", "39_trunk", "39_attack")
# Rows of many seconds of flight, left to `make faults`.
LONG = ("33_seen", "34_drift_on_slopes", "34_pixels", "34_range", "37_vibration")


def marked(row):
    return [pytest.mark.row(row), *([pytest.mark.slow] if row in LONG else [])]


@pytest.mark.timeout(900)
@pytest.mark.parametrize("row", [pytest.param(r, marks=marked(r)) for r in checks.ROWS])
def test_row(row, note, record_property):
    if row in ALONE:
        record_property("alone", inprocess.SEED)
    checks.ROWS[row](note)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("seed", range(2, 11))
@pytest.mark.parametrize("row", [pytest.param(r, marks=pytest.mark.row(r)) for r in ALONE])
def test_row_of_another_seed(row, seed, note, monkeypatch, record_property):
    monkeypatch.setattr(inprocess, "SEED", seed)
    record_property("alone", seed)
    checks.ROWS[row](note)


@pytest.mark.slow
@pytest.mark.row("43")
@pytest.mark.parametrize("seed", range(11, 21))
def test_the_estimate_slides(seed, note, record_property):
    record_property("alone", seed)
    world_checks.slides(seed, note)


@pytest.mark.row("18")
@pytest.mark.parametrize("skew", [2e-4, -2e-4])
def test_a_skewed_clock_is_followed(skew, monkeypatch, note):
    now = 0.0
    monkeypatch.setattr(pace.time, "monotonic", lambda: now)
    follower, worst = pace.ClockPace(None, None, 0.1, Source(1, 1)), 0.0
    for k in range(50 * 600):
        now = 0.02 * k
        stamp = 5.0 + now * (1.0 + skew)
        attitude = Attitude(stamp, np.array([1.0, 0, 0, 0]), np.zeros(3))
        follower._hear_clock([Received(Source(1, 1), attitude)])
        worst = max(worst, abs(follower._clock.estimate.vehicle(now) - stamp))
    assert worst < 0.001
    note("s off at 200 ppm, in 10 minutes", worst)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.row("42")
def test_power_is_lost_at_every_step(note):
    power_checks.row_42(note, stride=1)


def overridden(**sections):
    return lambda patch: patch.setattr(inprocess, "OVERRIDES", sections)


def ignore_the_pilot(patch):
    advance = PhaseMachine._advance

    def stubborn(self, *args):
        flying = self.phase is Phase.FLY
        advance(self, *args)
        if flying and self.phase is Phase.PASSIVE:
            self.phase = Phase.FLY

    patch.setattr(PhaseMachine, "_advance", stubborn)


def never_start_over(patch):
    patch.setattr(own_state, "_REBOOTED", (1e9, 3))
    patch.setattr(vehicle, "_CLOCK_BACK", 1e9)


def never_land(patch):
    without_plan = Guard._without_plan
    patch.setattr(
        Guard, "_without_plan", lambda *a: replace(without_plan(*a), request=AutopilotRequest.NONE)
    )


def never_learn(patch):
    patch.setattr(HoverThrust, "_observe", lambda *a: None)
    patch.setattr(HoverEstimate, "known", True)
    patch.setattr(thrust_checks, "abs", lambda x: 0.0, raising=False)  # of what is learnt


def without_triage(patch):
    """Read every datagram to its end, byte by byte where it is garbage."""
    patch.setattr(Codec, "claim", lambda *a: allowance.Claim.ACCEPTED)
    patch.setattr(allowance, "_KEPT_PACKETS", 10**9)
    patch.setattr(allowance, "_KEPT_BYTES", 10**9)
    patch.setattr(codec, "_FALSE_STARTS", 10**9)
    patch.setattr(framing, "start_pattern", lambda allow: re.compile(rb"[\xfd\xfe]"))


def _deaf_to_failures(judge):
    return lambda self, inputs: judge(self, replace(inputs, failure=""))


def catch_nothing(patch):
    def run(self, name, instead, stage, *args, **kwargs):
        return stage(*args, **kwargs)

    patch.setattr(StageClock, "__call__", run)


WITHOUT = {
    "3: the shifted plan": overridden(guard={"shifted_max": 0}),
    "4: the brake": overridden(guard={"shifted_max": 10**6}),
    "5: the limit on bad solves": never_land,
    "6: the refusal of NaN": lambda p: p.setattr(OwnState, "_sane_attitude", lambda *a: True),
    "7: the age of telemetry": overridden(
        guard={"stale_stop": 1e9, "stale_land": 2e9, "stale_silent": 3e9}
    ),
    "7_silence: the end of the stream": overridden(guard={"stale_silent": 1e9}),
    "8: disbelief": lambda p: p.setattr(OwnState, "plausible", lambda *a: True),
    "8_on_ground: the check of the quaternion": lambda p: p.setattr(
        own_state, "norm", _length_one(own_state.norm)
    ),
    "9: the watch over the link": overridden(guard={"lost": 1.0}),
    "13: the pilot's last word": ignore_the_pilot,
    "14: noticing a reboot": never_start_over,
    "15: camera health": lambda p: p.setattr(CameraHealth, "blind", lambda *a: 0.0),
    "32: the comparison of picture and gyro": lambda p: p.setattr(
        CameraAlignment, "update", lambda *a: None
    ),
    "32_late: the comparison of picture and gyro": lambda p: p.setattr(
        CameraAlignment, "update", lambda *a: None
    ),
    "17: neighbours": lambda p: p.setattr(Tracker, "tracks", lambda *a: []),
    "39_trunk: the certificate": lambda p: p.setattr(Certifier, "certify", attack_checks.believe),
    "43: the flow of the ground": lambda p: p.setattr(VelocityFromGround, "see", lambda *a: None),
    "19: the law for late ticks": overridden(guard={"late": 1e9}),
    "40: neighbours": lambda p: p.setattr(Tracker, "tracks", lambda *a: []),
    "31: the refusal of stamps of the future": lambda p: p.setattr(
        own_state, "STAMP_AHEAD", math.inf
    ),
    "36: learning the hover thrust": never_learn,
    "26: the memory of what was sent": lambda p: p.setattr(Signing, "_was_sent", lambda *a: False),
    "26: strictly rising timestamps": lambda p: p.setattr(Signing, "_newest", lambda *a: 0),
    "27: the look at a packet's first bytes": without_triage,
    "28: the check of the detector's numbers": lambda p: p.setattr(
        CameraHealth, "searched", lambda self, *a, **k: self.fault
    ),
    "28_neighbour: tracks": lambda p: p.setattr(Tracker, "tracks", lambda *a: []),
    "28_unseen: looking for the others": overridden(mission={"others": False}),
    "28_trunk: eyes that are known to fail": lambda p: p.setattr(
        ObstacleMap, "_for_good", lambda *a: False
    ),
    "29: the boundary round each stage": catch_nothing,
    "29: the guard's answer to a failure": lambda p: p.setattr(
        Guard, "judge", _deaf_to_failures(Guard.judge)
    ),
    "42: the journal, read at the start": lambda p: p.setattr(
        power_checks, "recover", lambda root: None
    ),
    "33_in_flight: the contrast of pictures": lambda p: p.setattr(
        camera_health, "contrast", lambda image: 255.0
    ),
    "34: the height over ground": lambda p: p.setattr(HeightEstimator, "_look", lambda *a: None),
    "34_pixels: the height by pictures": lambda p: p.setattr(
        HeightEstimator, "see", lambda *a, **k: None
    ),
    "37: the delay's estimate": lambda p: p.setattr(
        DelayEstimator, "_best", lambda self: Delay(0.1, 0.0)
    ),
    "41: the pilot's last word": ignore_the_pilot,
    "30: signatures": lambda p: p.setattr(Codec, "_signed", lambda *a: True),
    "21: the brake outside the fence": overridden(guard={"fence_drift": 1e9}),
    "21: the way back": lambda p: p.setattr(FenceConfig, "back", lambda *a: np.zeros(3)),
    "21: the landing far outside the fence": overridden(guard={"fence_land": 1e9}),
}


def _length_one(norm):
    return lambda a: 1.0 if np.shape(a) == (4,) else norm(a)


@pytest.mark.slow
@pytest.mark.mutation
@pytest.mark.parametrize("name", WITHOUT)
def test_a_row_fails_without(name, monkeypatch, record_property):
    row, _, mechanism = name.partition(": ")
    WITHOUT[name](monkeypatch)
    said = ""
    try:
        with pytest.raises(
            (AssertionError, ValueError, StopIteration, RuntimeWarning, ArithmeticError)
        ) as failed:
            checks.ROWS[row](lambda what, value: None)
        assert not isinstance(failed.value, (SettingsError, ValidationError)), failed.value
        said = " ".join(str(failed.traceback[-1].statement).split())
    finally:
        record_property("without", (f"{mechanism} | {row}", f"`{said}`"))


def test_the_guard_is_used(monkeypatch):
    """The mutations above concern the flying code: without a guard there is no setpoint."""
    monkeypatch.setattr(Guard, "judge", lambda *a: pytest.fail("asked"))
    with pytest.raises(pytest.fail.Exception):
        inprocess.fly(mission__time_limit=6.0, world={})
