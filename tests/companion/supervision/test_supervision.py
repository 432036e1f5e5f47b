"""Supervision: what of guard, phases and certificate reaches the wire and the log."""

from dataclasses import replace

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
from companion.perception.frontend import Detections
from companion.supervision.certificate import Scene
from companion.supervision.certify import CertificateConfig, Certifier, Flown
from companion.supervision.guard import AutopilotRequest, Broken, Reaction, Reason
from companion.supervision.guard_config import GuardConfig
from companion.supervision.supervision import Supervision
from companion.supervision.surroundings import Surroundings
from companion.types import Phase, Plan, PlanStatus
from mavlink_bridge.autopilots.px4 import Px4
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.messages import Heartbeat, VehicleState

PX4 = Px4(1)
FLYING = Heartbeat(12, 2, True, PX4.modes["offboard"], 4)
OWN = VehicleState(
    1.0, np.array([0.0, 0.0, 2.0]), np.array([1.6, 0.0, 0.0]), np.array([1.0, 0, 0, 0]), np.zeros(3)
)
HOVER = np.tile([GRAVITY, 0.0, 0.0, 0.0], (20, 1))
AHEAD = Prediction(
    np.array([0.0, 0.0, 2.0, 1.6, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), HOVER[0], np.zeros(3), 0.05
)
PLAN = Plan(np.zeros((21, 10)), HOVER, PlanStatus.SOLVED, True, 2, 0.001, 0.0, 0, 0, 0, (), 1.0)
FREE = Scene(
    np.zeros((0, 11)), np.zeros((0, 6)), np.zeros((0, 3)), np.zeros((0, 4)), np.full(36, 5.0)
)
SIDES = np.linspace(-1.5, 1.5, 31)
WALL = replace(FREE, points=np.array([[0.45, y, 2.0 + z] for y in SIDES for z in SIDES]))


def decide(scene=FREE, enforce=True, plan=PLAN, vehicle=None, ahead=AHEAD, **more):
    """One tick in flight, offboard, towards what is in the scene."""
    guard = GuardConfig()
    certifier = Certifier(CertificateConfig(enforce=enforce), guard, 0.2)
    supervision = Supervision(guard, MissionConfig(), FenceConfig(), PX4, certifier)
    supervision._phases.phase = Phase.FLY
    motion = MotionEstimate(ahead, HoverEstimate(ThrustMap(), 0.01), Delay(0.05, 0.003))
    told = {"state": OWN, "age": 0.02, "tick_gap": 0.1, "heartbeat": FLYING, "mode_known": True}
    return supervision.decide(
        1.0, VehicleEstimate(**told | (vehicle or {})), Detections(started=True), None, plan,
        motion, Surroundings(lambda: scene), self_tested=True, leave=False, **more,
    )  # fmt: skip


def test_a_plan_with_a_certificate_flies_as_it_is():
    s = decide()
    assert s.verdict.reason is Reason.PLAN
    assert s.certified.flown is Flown.COMMAND
    assert s.command.c == pytest.approx(GRAVITY)
    assert not s.command.omega.any()


def test_a_plan_without_one_gives_way_to_what_keeps_most_room():
    s = decide(WALL)
    assert s.verdict.reason is Reason.UNCERTIFIED
    assert s.certified.flown is Flown.NONE
    assert s.certified.cause == "surface"
    assert s.command.omega[1] < -1.0  # it pitches up, to brake
    assert s.command is s.certified.instead


def test_what_brakes_already_is_not_replaced():
    s = decide(WALL, plan=None)
    assert s.verdict.reason is Reason.BRAKE
    assert s.certified.margin < 0.0
    assert s.command is not s.certified.instead


def test_a_certificate_that_is_not_enforced_changes_nothing():
    s = decide(WALL, enforce=False)
    assert s.verdict.reason is Reason.PLAN
    assert s.certified is None  # one tick in five is judged


@pytest.mark.parametrize(("loss", "repeat"), [(0.04, False), (0.06, True)])
def test_setpoints_are_repeated_where_packets_are_lost(loss, repeat):
    assert decide(vehicle={"packet_loss": loss}).repeat is repeat


@pytest.mark.parametrize(("sigma", "mode"), [(0.3, "hold"), (0.5, "land")])
def test_a_drone_that_does_not_know_its_place_lands_instead_of_holding(sigma, mode):
    s = decide(
        vehicle={"doubt": replace(OwnDoubt(), position=sigma)},
        broken=Broken("found", Reaction.HOLD),
    )
    assert s.verdict.request is AutopilotRequest.HOLD
    wanted = {"hold": PX4.hold(), "land": PX4.land()}
    assert s.requests == wanted[mode]


@pytest.mark.parametrize(("known", "phase"), [(True, Phase.PASSIVE), (False, Phase.FLY)])
def test_a_mode_of_an_old_heartbeat_says_nothing(known, phase):
    holds = replace(FLYING, custom_mode=PX4.modes["hold"])
    assert decide(vehicle={"heartbeat": holds, "mode_known": known}).phase is phase


def test_the_brake_is_for_the_state_at_which_it_acts():
    """By then it flies the other way."""
    back = replace(AHEAD, x0=np.array([0.0, 0.0, 2.0, -1.6, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
    assert decide(plan=None).command.omega[1] < -1.0
    assert decide(plan=None, ahead=back).command.omega[1] > 1.0
