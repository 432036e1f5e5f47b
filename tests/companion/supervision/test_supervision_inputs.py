"""Supervision: what it asks guard, phases and certifier, each input by its own value."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from companion.estimation.delay import Delay
from companion.estimation.hover_thrust import HoverEstimate
from companion.estimation.motion import MotionEstimate
from companion.estimation.own_doubt import OwnDoubt
from companion.estimation.prediction import Prediction
from companion.estimation.vehicle import VehicleEstimate
from companion.guidance.fence import FenceConfig
from companion.guidance.mission import MissionConfig
from companion.perception.camera_health import CameraFault
from companion.perception.frontend import Detections
from companion.supervision.certify import CertificateConfig, Certified, Certifier, Flown
from companion.supervision.guard import AutopilotRequest, Broken, Reaction, Reason, Verdict
from companion.supervision.guard_config import GuardConfig
from companion.supervision.phases import Decision, GiveBack
from companion.supervision.supervision import Supervision
from companion.supervision.surroundings import Surroundings
from companion.types import Phase
from mavlink_bridge.autopilots.px4 import Px4
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.messages import Command, Heartbeat, RateCommand, VehicleState

PX4 = Px4(1)
FLYING = Heartbeat(12, 2, True, PX4.modes["offboard"], 4)
TURN = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
OWN = VehicleState(
    7.0, np.array([1.0, 2.0, 3.0]), np.array([0.4, 0.5, 0.6]), np.array([1.0, 0, 0, 0]), np.ones(3)
)
AHEAD = Prediction(
    np.array([1.1, 2.1, 3.1, 0.7, 0.8, 0.9, *TURN]), np.zeros(4), np.array([0.1, 0.2, 0.3]), 0.25
)
PLANNED = RateCommand(np.array([0.1, 0.2, 0.3]), 9.0)
SAFE = RateCommand(np.array([0.0, -1.0, 0.0]), 8.0)
PLAN = object()
REQUEST = Command(400, (1.0,) * 7)
FIT = {
    "state": OWN, "age": 0.02, "tick_gap": 0.11, "packet_loss": 0.03, "plausible": True,
    "heartbeat": FLYING, "mode_known": True, "map_offset": np.array([10.0, 0.0, 0.0]),
}  # fmt: skip
SEEN = {"started": True}


class Bench:
    """Supervision whose guard, phases and certifier answer as told, and keep what they were asked.

    verdict: the guard's. decision: of the phases. certified: the certifier's.
    """

    def __init__(self, phase=Phase.FLY, stream=True):
        self.verdict = Verdict(PLANNED, Reason.PLAN, 0)
        self.decision = Decision(phase, [REQUEST], stream)
        self.certified = None
        self.asked = SimpleNamespace(guard=[], phases=[], certifier=[], released=[], resumed=0)
        guard = GuardConfig()
        certifier = Certifier(CertificateConfig(), guard, 0.2)
        self.fence = FenceConfig(east=[-5.0, 8.0], north=[-20.0, 20.0], altitude_max=9.0)
        self.it = Supervision(guard, MissionConfig(), self.fence, PX4, certifier)
        phases = self.it._phases
        phases.phase = phase
        phases.waits_for_thrust = False
        self.it._guard.judge = lambda s: (self.asked.guard.append(s), self.verdict)[1]
        phases.release = lambda how=GiveBack.HOLD: self.asked.released.append(how)
        phases.resume = self._resume
        phases.update = self._update
        certifier.certify = lambda *a: (self.asked.certifier.append(a), self.certified)[1]

    def _resume(self):
        self.asked.resumed += 1

    def _update(self, time, heartbeat, own, *, ready, complete, known, airborne):
        told = {"ready": ready, "complete": complete, "known": known, "airborne": airborne}
        self.asked.phases.append(((time, heartbeat, own), told))
        return self.decision

    def tick(
        self, vehicle=(), seen=(), reference=None, plan=PLAN, motion=None, around=None, **more
    ):
        hover = HoverEstimate(ThrustMap(), 0.01)
        motion = motion or MotionEstimate(AHEAD, hover, Delay(0.05, 0.003))
        self.asked.guard.clear()
        self.asked.phases.clear()
        more = {"self_tested": True, "leave": False} | more
        return self.it.decide(
            7.5, VehicleEstimate(**FIT | dict(vehicle)), Detections(**SEEN | dict(seen)),
            reference, plan, motion, around, **more,
        )  # fmt: skip

    def ready(self, **told):
        self.tick(**told)
        ((_, answer),) = self.asked.phases
        return answer["ready"]


def reference(land=False, inhibit_reason=""):
    return SimpleNamespace(land=land, inhibit_reason=inhibit_reason, v_max=1.2)


def test_the_guard_judges_what_this_tick_knows():
    bench, broken = Bench(), Broken("speed: …", Reaction.SLOW)
    seen = {"blind": 0.7, "fault": CameraFault.MISALIGNED}
    bench.tick(seen=seen, failure="plan: no", broken=broken)
    (s,) = bench.asked.guard
    assert (s.time, s.plan, s.own, s.age) == (7.5, PLAN, OWN, 0.02)
    assert (s.plausible, s.tick_gap, s.packet_loss) == (True, 0.11, 0.03)
    assert (s.blind, s.misled, s.failure, s.broken) == (0.7, True, "plan: no", broken)
    # 11 m east on the map: 3 m beyond the fence, and it goes on at 0.4 m/s.
    assert (s.outside, s.outward) == pytest.approx((3.0, 0.4))
    bench.tick(vehicle={"plausible": False}, seen={"fault": CameraFault.FROZEN})
    (s,) = bench.asked.guard
    assert (s.plausible, s.misled, s.blind, s.failure, s.broken) == (False, False, 0.0, "", None)


def test_the_command_acts_on_the_predicted_state():
    bench = Bench()
    bench.tick()
    acting = bench.asked.guard[0].acting
    assert acting.time == pytest.approx(7.25)
    assert acting.p.tolist() == [1.1, 2.1, 3.1]
    assert acting.v.tolist() == [0.7, 0.8, 0.9]
    assert acting.q_wb.tolist() == TURN.tolist()
    assert acting.omega.tolist() == [1.0, 1.0, 1.0]
    assert bench.asked.guard[0].wind.tolist() == [0.1, 0.2, 0.3]


def test_without_a_state_or_a_prediction_the_command_acts_on_what_is_known():
    bench = Bench()
    bench.tick(motion=MotionEstimate(None, HoverEstimate(ThrustMap(), 0.01), Delay(0.05, 0.003)))
    assert (bench.asked.guard[0].acting, bench.asked.guard[0].wind) == (None, None)
    bench.tick(vehicle={"state": None})
    (s,) = bench.asked.guard
    assert (s.acting, s.own, s.outside, s.outward) == (None, None, -np.inf, 0.0)


def test_the_phases_know_the_vehicle_and_the_mission():
    bench = Bench()
    bench.tick(reference=reference(land=True))
    (((time, heartbeat, own), told),) = bench.asked.phases
    assert (time, heartbeat, own) == (7.5, FLYING, OWN)
    assert told == {"ready": True, "complete": True, "known": True, "airborne": False}
    bench.tick(reference=reference())
    assert not bench.asked.phases[0][1]["complete"]
    bench.tick()
    assert not bench.asked.phases[0][1]["complete"]


def test_a_mode_that_is_not_known_any_more_is_none():
    bench = Bench()
    bench.tick(vehicle={"mode_known": False})
    assert bench.asked.phases[0][0][1] is None


def test_the_phases_know_the_hover_thrust_and_the_take_off():
    bench = Bench()
    unknown = MotionEstimate(AHEAD, HoverEstimate(ThrustMap(), 0.5), Delay(0.05, 0.003))
    flown = VehicleEstimate(**FIT).thrust
    bench.tick(motion=unknown, vehicle={"thrust": replace(flown, airborne=True)})
    told = bench.asked.phases[0][1]
    assert (told["known"], told["airborne"]) == (False, True)


NOT_FIT = [
    {"self_tested": False},
    {"failure": "see: no"},
    {"vehicle": {"inhibit_reason": "no gyro"}},
    {"seen": {"inhibit_reason": "too dark"}},
    {"reference": reference(inhibit_reason="goal 1 is outside the fence")},
    {"seen": {"started": False}},
    {"seen": {"fault": CameraFault.DEAD}},
    {"vehicle": {"age": -0.001}},
    {"vehicle": {"age": 0.31}},
    {"vehicle": {"age": float("nan")}},
    {"vehicle": {"plausible": False}},
]


@pytest.mark.parametrize("what", NOT_FIT)
def test_a_drone_is_ready_where_nothing_speaks_against_it(what):
    assert GuardConfig().stale_stop == 0.3
    assert Bench().ready()
    assert Bench().ready(vehicle={"age": 0.0})
    assert Bench().ready(vehicle={"age": 0.3}, reference=reference())
    assert not Bench().ready(**what)


def test_the_first_reason_is_told():
    everything = {
        "vehicle": {"inhibit_reason": "b"},
        "seen": {"inhibit_reason": "c"},
        "reference": reference(inhibit_reason="d"),
    }
    assert Bench().tick(failure="a", **everything).inhibit_reason == "a"
    assert Bench().tick(**everything).inhibit_reason == "b"
    del everything["vehicle"]
    assert Bench().tick(**everything).inhibit_reason == "c"
    del everything["seen"]
    assert Bench().tick(**everything).inhibit_reason == "d"
    assert Bench().tick(reference=reference()).inhibit_reason == ""


def test_who_waits_says_for_what():
    unknown = MotionEstimate(AHEAD, HoverEstimate(ThrustMap(), 0.5), Delay(0.05, 0.003))
    bench = Bench(phase=Phase.WAIT, stream=False)
    assert bench.tick(motion=unknown).inhibit_reason == ""
    bench.it._phases.waits_for_thrust = True
    assert bench.tick(motion=unknown).inhibit_reason == unknown.hover.unknown_reason != ""
    assert bench.tick(motion=unknown, failure="a").inhibit_reason == "a"
    bench.it._phases.waits_for_thrust = False
    bench.it._phases._armed_by_pilot = bench.it._phases._found_in_offboard = True
    assert "another mode" in bench.tick().inhibit_reason
    assert bench.tick(failure="a").inhibit_reason == "a"


def test_control_is_given_back_as_asked_for():
    bench = Bench()
    bench.tick()
    assert (bench.asked.released, bench.asked.resumed) == ([], 0)
    bench.tick(leave=True)
    assert bench.asked.released == [GiveBack.HOLD]
    bench.tick(give_back=GiveBack.RETURN)
    assert bench.asked.released == [GiveBack.HOLD, GiveBack.RETURN]
    bench.tick(resume=True)
    assert bench.asked.resumed == 1


@pytest.mark.parametrize(("asked", "sigma", "how"), [
    (AutopilotRequest.HOLD, 0.4, GiveBack.HOLD),
    (AutopilotRequest.HOLD, 0.41, GiveBack.LAND),
    (AutopilotRequest.LAND, 0.05, GiveBack.LAND),
    (AutopilotRequest.SILENCE, 0.05, GiveBack.LAND),
    (AutopilotRequest.NONE, 9.0, None),
])  # fmt: skip
def test_what_the_guard_requests_is_given_back_by(asked, sigma, how):
    assert GuardConfig().hold_doubt == 0.4
    bench = Bench()
    bench.verdict = replace(bench.verdict, request=asked)
    bench.tick(vehicle={"doubt": OwnDoubt(position=sigma)})
    assert bench.asked.released == ([] if how is None else [how])


def test_the_guard_judges_once_a_tick_where_something_flies_or_is_streamed():
    for phase, stream, judged in (
        (Phase.FLY, True, 1),
        (Phase.FLY, False, 1),
        (Phase.WAIT, False, 0),
        (Phase.WAIT, True, 1),
    ):
        bench = Bench(phase, stream)
        s = bench.tick()
        assert len(bench.asked.guard) == judged
        assert (s.verdict is not None) is stream
        assert s.requests == [REQUEST]
        assert s.phase is phase


@pytest.mark.parametrize(("loss", "repeat"), [(0.05, False), (0.051, True)])
def test_a_setpoint_is_sent_again_from_a_share_of_lost_packets_on(loss, repeat):
    assert GuardConfig().lossy == 0.05
    assert Bench().tick(vehicle={"packet_loss": loss}).repeat is repeat


def certified(flown, instead=None):
    return Certified(flown, -0.1, "neighbour", instead)


def test_the_certifier_gets_the_command_and_where_it_acts():
    bench, around = Bench(), Surroundings()
    bench.tick(around=around)
    bench.tick(around=around, reference=reference())
    (command, prediction, scene, delay, v_max), told = bench.asked.certifier
    assert (command, prediction, scene) == (PLANNED, AHEAD, around.scene)
    assert delay == Delay(0.05, 0.003)
    assert (v_max, told[-1]) == (math.inf, 1.2)


def test_what_cannot_be_certified_flies_as_it_is():
    bench = Bench()
    assert bench.tick(around=None).verdict.command is PLANNED
    unknown = MotionEstimate(None, HoverEstimate(ThrustMap(), 0.01), Delay(0.05, 0.003))
    s = bench.tick(around=Surroundings(), motion=unknown)
    assert (s.verdict.command, s.certified) == (PLANNED, None)
    silent = Bench(stream=False).tick(around=Surroundings())
    assert (silent.verdict, silent.certified, silent.command) == (None, None, None)
    assert bench.asked.certifier == []


@pytest.mark.parametrize("reason", Reason)
def test_only_what_a_plan_wants_gives_way_to_a_certificate(reason):
    planned = (Reason.PLAN, Reason.LOSSY, Reason.SHIFTED_PLAN, Reason.BLIND, Reason.ASSUMPTION)
    bench = Bench()
    bench.verdict = replace(bench.verdict, reason=reason, bad_ticks=2)
    bench.certified = certified(Flown.WAY, SAFE)
    s = bench.tick(around=Surroundings())
    assert s.certified is bench.certified
    assert s.verdict.bad_ticks == 2
    if reason in planned:
        assert (s.command, s.verdict.reason) == (SAFE, Reason.UNCERTIFIED)
    else:
        assert (s.command, s.verdict.reason) == (PLANNED, reason)
    bench.certified = certified(Flown.COMMAND)
    s = bench.tick(around=Surroundings())
    assert (s.command, s.verdict.reason, s.certified.flown) == (PLANNED, reason, Flown.COMMAND)


def test_a_silenced_stream_has_no_command():
    bench = Bench()
    bench.verdict = replace(bench.verdict, request=AutopilotRequest.SILENCE)
    s = bench.tick()
    assert s.command is None
    assert s.in_control
    assert not Bench(Phase.ENGAGE).tick().in_control
    assert not Bench(stream=False).tick().in_control


def test_after_a_reboot_neither_phase_nor_way_is_kept():
    bench = Bench()
    bench.it._certifier._last = object()
    bench.it.reset()
    assert bench.it.phase is Phase.PASSIVE
    assert bench.it._certifier._last is None
