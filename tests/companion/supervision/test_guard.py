"""The guard's rules one by one, and what own state refuses."""

import numpy as np
import pytest

from companion.estimation.own_state import OwnState
from companion.guidance.mission import MissionConfig
from companion.supervision.guard import (
    Ask,
    Guard,
    GuardConfig,
    Reason,
    Situation,
    brake,
    brake_late,
)
from companion.supervision.phases import PhaseMachine
from companion.types import Phase, Plan, PlanStatus
from mavlink_bridge.autopilots.px4 import MODES, Px4
from mavlink_bridge.wire.messages import Attitude, Heartbeat, LocalPosition, VehicleState

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def own(v=(0.0, 0.0, 0.0), time=0.0):
    return VehicleState(time, np.array([0.0, 0.0, 2.0]), np.array(v), LEVEL, np.zeros(3))


def plan(usable=True, u=(9.81, 0.1, 0.2, 0.3)):
    return Plan(np.zeros((21, 10)), np.tile(u, (20, 1)), PlanStatus.SOLVED, usable, 1, 0.0, 0.0, 0.0,
                  0.0, 0.0, (), 0.0)  # fmt: skip


def situation(time=0.0, v=(0.0, 0.0, 0.0), **more):
    return Situation(time, **({"result": plan(), "own": own(v, time), "age": 0.02} | more))


@pytest.mark.parametrize(
    ("more", "reason", "ask"),
    [
        ({}, Reason.PLAN, Ask.NOTHING),
        ({"age": 0.29}, Reason.PLAN, Ask.NOTHING),
        ({"age": 0.31}, Reason.NO_STATE, Ask.HOLD),
        ({"age": 1.01}, Reason.NO_STATE, Ask.LAND),
        ({"age": 2.01}, Reason.NO_STATE, Ask.SILENCE),
        ({"age": np.nan}, Reason.NO_STATE, Ask.SILENCE),
        ({"own": None}, Reason.NO_STATE, Ask.HOLD),
        ({"believable": False}, Reason.BAD_STATE, Ask.LAND),
        ({"result": plan(usable=False)}, Reason.SHIFTED_PLAN, Ask.NOTHING),
        ({"result": plan(u=(np.nan, 0, 0, 0))}, Reason.BRAKE, Ask.NOTHING),
        ({"result": None}, Reason.BRAKE, Ask.NOTHING),
        ({"outside": 0.5, "outward": 1.0}, Reason.FENCE, Ask.NOTHING),
        ({"outside": 0.5, "outward": 0.0}, Reason.PLAN, Ask.NOTHING),
        ({"outside": 1.1, "outward": 0.0}, Reason.FENCE, Ask.LAND),
        ({"blind": 0.1, "v": (1.5, 0, 0)}, Reason.BLIND, Ask.NOTHING),
        ({"blind": 6.0}, Reason.BLIND, Ask.HOLD),
        ({"held": 0.2}, Reason.PLAN, Ask.NOTHING),
        ({"held": 0.31}, Reason.LATE, Ask.NOTHING),
        ({"held": 0.31, "blind": 6.0}, Reason.LATE, Ask.HOLD),
        ({"held": np.inf}, Reason.LATE, Ask.NOTHING),
    ],
)
def test_each_rule(more, reason, ask):
    verdict = Guard(GuardConfig()).judge(situation(**more))
    assert (verdict.reason, verdict.ask) == (reason, ask)


def test_a_plan_comes_back_after_bad_solves_and_land_is_asked_for_after_two_seconds():
    guard = Guard(GuardConfig())
    bad = [guard.judge(situation(0.1 * k, result=plan(usable=False))) for k in range(22)]
    assert [v.reason for v in bad[:4]] == [Reason.SHIFTED_PLAN] * 2 + [Reason.BRAKE] * 2
    assert [v.ask for v in bad].index(Ask.LAND) == 20
    assert [v.bad_ticks for v in bad] == list(range(1, 23))
    good = guard.judge(situation(2.2))
    assert (good.reason, good.bad_ticks, good.ask) == (Reason.PLAN, 0, Ask.NOTHING)


def test_braking_tilts_against_the_motion():
    command = brake(own((2.0, 0.0, 0.0)), GuardConfig())
    assert command.omega[1] < -1.0  # nose up
    assert brake(own(), GuardConfig()).c == pytest.approx(9.80665)


def test_the_second_tick_that_is_missed_brakes_gently():
    guard = Guard(GuardConfig())
    reasons = [guard.judge(situation(held=held)).reason for held in (0.1, 0.2, 0.2, 0.2, 0.1)]
    assert reasons == [Reason.PLAN, Reason.PLAN, Reason.LATE, Reason.LATE, Reason.PLAN]
    fast = own((2.0, 0.0, 0.0))
    turns = [abs(brake_late(fast, GuardConfig(), held).omega[1]) for held in (0.2, 0.3, 0.5)]
    assert turns == sorted(turns, reverse=True)
    assert turns[0] < 0.25 * abs(brake(fast, GuardConfig()).omega[1])


def test_half_of_the_commands_lost_brakes_and_then_holds():
    guard = Guard(GuardConfig())
    said = [guard.judge(situation(0.1 * k, lost=0.5)) for k in range(13)]
    assert {v.reason for v in said} == {Reason.LATE}
    assert [v.ask for v in said].index(Ask.HOLD) == 10
    assert guard.judge(situation(1.3, lost=0.2)).reason is Reason.PLAN


def fed(*samples):
    state = OwnState()
    for n in range(10):
        state.add([Attitude(0.02 * n, LEVEL, np.zeros(3)),
                   LocalPosition(0.02 * n, np.zeros(3), np.zeros(3))])  # fmt: skip
    for sample in samples:
        state.add([sample])
    return state


def position(time, x):
    return LocalPosition(time, np.array([x, 0.0, 0.0]), np.zeros(3))


def without_position(seconds, *garbled):
    """Attitudes alone for some seconds, and positions that are no numbers at these times [s]."""
    samples = [Attitude(0.2 + t, LEVEL, np.zeros(3)) for t in np.arange(0.0, seconds, 0.02)]
    samples += [position(t, np.nan) for t in garbled]
    return fed(*sorted(samples, key=lambda s: s.time)).believable(0.2 + seconds)


def test_who_sends_no_position_any_more_is_lost_sooner_than_who_garbles_some():
    assert without_position(0.15)
    assert not without_position(0.25)
    assert without_position(0.25, *np.arange(0.2, 0.45, 0.04))
    assert not without_position(0.6, *np.arange(0.2, 0.8, 0.04))


def test_one_position_elsewhere_is_a_slip_and_five_are_a_jump():
    once = fed(position(0.2, 5.0), position(0.22, 0.0))
    assert once.believable(0.22)
    assert once.counters.jumps == 1
    assert not fed(*[position(0.2 + 0.02 * n, 5.0) for n in range(5)]).believable(0.3)
    assert fed(*[position(0.2 + 0.1 * n, 0.9 * (n + 1)) for n in range(5)]).believable(0.6)


def test_a_quaternion_that_is_none():
    bad = [Attitude(0.2 + 0.02 * n, 0.5 * LEVEL, np.zeros(3)) for n in range(5)]
    assert fed(*bad[:3]).believable(0.26)
    assert not fed(*bad).believable(0.3)


def test_a_clock_that_goes_back_is_a_reboot():
    late = fed()
    late.add([position(50.0, 0.0)])
    late.add([position(0.1, 0.0)])
    assert late.counters.reboots == 0
    late.add([position(0.12, 0.0), position(0.14, 0.0)])
    assert late.counters.reboots == 1
    assert late.at(0.14) is None  # attitude is to come


@pytest.mark.parametrize("auto", [True, False])
def test_who_starts_in_flight_takes_nothing_unasked(auto):
    phases = PhaseMachine(MissionConfig(auto=auto), Px4(1))

    def tick(time, mode, armed=True):
        heartbeat = Heartbeat(12, 2, armed, MODES[mode], 4)
        return phases.update(time, heartbeat, own(time=time), ready=True, complete=False)

    assert all(tick(0.1 * n, "offboard").phase is Phase.WAIT for n in range(5))
    if auto:
        assert tick(1.0, "hold").phase is Phase.ENGAGE  # streams, for a pilot to choose offboard
        requests = [m for n in range(30) for m in tick(1.1 + 0.1 * n, "hold").requests]
        assert requests == []
    assert tick(9.0, "land", armed=False).phase in (Phase.WAIT, Phase.PASSIVE)
    assert tick(9.1, "land", armed=False).phase is not Phase.ARM
