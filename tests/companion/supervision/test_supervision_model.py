"""Guard and phases together, in every state that they reach by what may befall a flight."""

import copy
import itertools
from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.delay import Delay
from companion.estimation.hover_thrust import HoverEstimate
from companion.estimation.motion import MotionEstimate
from companion.estimation.own_doubt import OwnDoubt
from companion.estimation.vehicle import VehicleEstimate
from companion.guidance.fence import FenceConfig
from companion.guidance.mission import MissionConfig
from companion.perception.camera_health import CameraFault
from companion.perception.frontend import Detections
from companion.supervision import supervision as module
from companion.supervision.certify import CertificateConfig, Certifier
from companion.supervision.guard import AutopilotRequest, Broken, Reaction
from companion.supervision.guard_config import GuardConfig
from companion.supervision.phases import GiveBack
from companion.supervision.supervision import Supervision
from companion.types import Phase
from mavlink_bridge.autopilots.px4 import Px4
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.messages import Heartbeat
from tests.companion.supervision.exploring import explore
from tests.companion.supervision.test_guard_model import PLANS, SLOW, WRONG
from tests.companion.supervision.test_guard_model import Checked as CheckedGuard
from tests.companion.supervision.test_phases_model import Checked as CheckedPhases

DT = 0.5
ADAPTER = Px4(1)
MOTION = MotionEstimate(None, HoverEstimate(ThrustMap(), 0.01), Delay(0.05, 0.003))
SEEN = Detections(started=True)
FINE = {"plan": "good", "vehicle": {}, "seen": SEEN, "more": {}}
# What befalls a tick: (plan, vehicle, detections, more).
EVENTS = {
    "nothing": {},
    "no plan": {"plan": "none"},
    "a plan of NaN": {"plan": "not a number"},
    "telemetry is late": {"vehicle": {"age": 0.5}},
    "telemetry is silent": {"vehicle": {"age": 3.0, "mode_known": False}},
    "only heartbeats": {"vehicle": {"age": 3.0}},
    "no state": {"vehicle": {"state": None, "age": float("inf")}},
    "a state of NaN": {"vehicle": {"state": WRONG["not a number"]}},
    "cannot be": {"vehicle": {"plausible": False}},
    "late tick": {"vehicle": {"tick_gap": 0.4}},
    "lossy": {"vehicle": {"packet_loss": 0.5}},
    "blind": {"seen": replace(SEEN, fault=CameraFault.DEAD, blind=5.1)},
    "a stage failed": {"more": {"failure": "see: x"}},
    "grave": {"more": {"broken": Broken("found", Reaction.HOLD)}},
    "told to leave": {"more": {"leave": True}},
    "told to land": {"more": {"give_back": GiveBack.LAND}},
}
# These end in HOLD or LAND, at once.
GRAVE = {"telemetry is late", "cannot be", "blind", "a stage failed", "grave", "told to leave",
         "told to land"}  # fmt: skip


class Both:
    """Supervision and its clock."""

    def __init__(self, auto):
        fence, mission = FenceConfig(), MissionConfig(auto=auto)
        self.supervision = Supervision(
            GuardConfig(),
            mission,
            fence,
            ADAPTER,
            Certifier(CertificateConfig(), GuardConfig(), 0.2),
        )
        self.now = 0.0

    def __copy__(self):
        other = object.__new__(Both)
        other.now, other.supervision = self.now, copy.copy(self.supervision)
        other.supervision._guard = copy.copy(self.supervision._guard)
        other.supervision._phases = copy.copy(self.supervision._phases)
        return other

    def key(self):
        guard, phases = self.supervision._guard, object.__new__(CheckedPhases)
        phases.machine, phases.now = self.supervision._phases, self.now
        phases.resumed = False  # nobody asks for that here
        memory = CheckedGuard(
            guard,
            self.now,
            guard._bad_ticks,
            guard._bad_since,
            guard._late_ticks,
            guard._lossy_since,
        )
        return phases.key(), memory.key()

    def tick(self, told):
        event, mode, armed = told
        self.now += DT
        told = FINE | EVENTS[event]
        heartbeat = Heartbeat(12, 2, armed, ADAPTER.modes.get(mode, 12345), 4)
        vehicle = VehicleEstimate(
            **{"state": SLOW, "age": 0.02, "tick_gap": 0.1, "heartbeat": heartbeat,
               "mode_known": True} | told["vehicle"]
        )  # fmt: skip
        before = self.supervision.phase
        s = self.supervision.decide(
            self.now, vehicle, told["seen"], None, PLANS[told["plan"]], MOTION,
            **{"self_tested": True, "leave": False} | told["more"],
        )  # fmt: skip
        self.check(event, mode, armed, before, vehicle, s)
        return s

    def check(self, event, mode, armed, before, vehicle, s):
        name = (event, mode, armed, before)
        streams = s.verdict is not None
        if streams:
            assert s.phase in (Phase.ENGAGE, Phase.FLY, Phase.LAND), name
            assert armed, name
            assert np.isfinite([*s.verdict.command.omega, s.verdict.command.c]).all(), name
        silent = s.verdict is None or s.verdict.request is AutopilotRequest.SILENCE
        assert (s.command is None) == silent, name
        if before in (Phase.FLY, Phase.LAND) and vehicle.mode_known and vehicle.state is not None:
            assert streams == (mode == "offboard" and armed), name
        if event in GRAVE and before.flying and mode == "offboard" and armed:
            assert self.supervision._phases._releasing, name


def search(auto):
    modes = ["hold", "offboard", "land", "other"] + ["takeoff"] * auto
    vehicle = [*((mode, True) for mode in modes), ("offboard", False)]
    told = [(event, *shown) for event, shown in itertools.product(EVENTS, vehicle)]
    found = explore(Both(auto), Both.key, told, Both.tick)
    for state in found.states.values():
        a_way_out(state)
    return found


def a_way_out(state):
    """Each grave event, while the vehicle obeys nothing, makes the requests go out again."""
    if not state.supervision.phase.flying:
        return
    for event in GRAVE:
        both = copy.copy(state)
        ticks = [both.tick((event, "offboard", True)) for _ in range(3)]
        asked = [set(s.requests) & {*ADAPTER.hold(), *ADAPTER.land()} for s in ticks]
        assert all(asked), (event, state.supervision.phase)
        assert all(s.command is not None for s in ticks), event
        ended = both.tick((event, "hold", True))
        assert ended.verdict is None, event


@pytest.mark.parametrize("auto", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_whatever_befalls_a_flight_it_can_be_given_back(auto, capsys):
    found = search(auto)
    assert {s.supervision.phase for s in found.states.values()} >= {Phase.FLY, Phase.PASSIVE}
    with capsys.disabled():
        print(f"\nboth, auto {auto}: {len(found.states)} states, {found.transitions} transitions")


def _deaf(patch):
    patch.setattr(module.PhaseMachine, "release", lambda *a: None)


def _repeats_the_last(patch):
    patch.setattr(module.Guard, "_known", lambda self, s: s.own)


def _speaks_on(patch):
    patch.setattr(module.Supervised, "command", property(lambda s: s.verdict and s.verdict.command))


@pytest.mark.parametrize("rule", [_deaf, _repeats_the_last, _speaks_on])
def test_the_search_fails_without(rule, monkeypatch):
    rule(monkeypatch)
    with pytest.raises(AssertionError):
        search(False)


@pytest.mark.parametrize(("sigma", "way"), [(0.1, ADAPTER.hold()), (0.6, ADAPTER.land())])
@pytest.mark.parametrize("event", ["blind", "a stage failed", "grave"])
def test_a_drone_that_does_not_know_its_place_lands_instead_of_holding(
    sigma, way, event, monkeypatch
):
    befallen = EVENTS[event] | {"vehicle": {"doubt": OwnDoubt(position=sigma)}}
    monkeypatch.setitem(EVENTS, event, befallen)
    both = Both(auto=False)
    for mode in ("hold", "hold", "offboard", "offboard"):
        both.tick(("nothing", mode, True))
    assert both.supervision.phase.flying
    asked = [r for _ in range(3) for r in both.tick((event, "offboard", True)).requests]
    assert set(way) <= set(asked)
    assert not set(asked) & ({*ADAPTER.hold(), *ADAPTER.land()} - {*way})
