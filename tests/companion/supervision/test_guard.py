"""The guard's rules, one by one and where several apply."""

from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.input_history import InputHistory, SentInput
from companion.estimation.prediction import StatePredictor
from companion.model import predict
from companion.supervision.braking import brake, brake_late
from companion.supervision.guard import (
    AutopilotRequest,
    Broken,
    Guard,
    GuardInputs,
    Reaction,
    Reason,
)
from companion.supervision.guard_config import GuardConfig
from companion.types import Plan, PlanStatus
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import RateCommand, VehicleState

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def own(v=(0.0, 0.0, 0.0), time=0.0):
    return VehicleState(time, np.array([0.0, 0.0, 2.0]), np.array(v), LEVEL, np.zeros(3))


def plan(usable=True, u=(9.81, 0.1, 0.2, 0.3)):
    x, inputs = np.zeros((21, 10)), np.tile(u, (20, 1))
    return Plan(x, inputs, PlanStatus.SOLVED, usable, 1, 0.0, 0.0, 0.0, 0.0, 0.0, (), 0.0)


def inputs(time=0.0, v=(0.0, 0.0, 0.0), **more):
    return GuardInputs(time, **({"plan": plan(), "own": own(v, time), "age": 0.02} | more))


@pytest.mark.parametrize(
    ("more", "reason", "asked"),
    [
        ({}, Reason.PLAN, AutopilotRequest.NONE),
        ({"age": 0.29}, Reason.PLAN, AutopilotRequest.NONE),
        ({"age": 0.0}, Reason.PLAN, AutopilotRequest.NONE),
        ({"age": -0.01}, Reason.NO_STATE, AutopilotRequest.HOLD),
        ({"age": -3600.0}, Reason.NO_STATE, AutopilotRequest.HOLD),
        ({"age": 0.31}, Reason.NO_STATE, AutopilotRequest.HOLD),
        ({"age": 1.01}, Reason.NO_STATE, AutopilotRequest.LAND),
        ({"age": 2.01}, Reason.NO_STATE, AutopilotRequest.SILENCE),
        ({"age": np.nan}, Reason.NO_STATE, AutopilotRequest.SILENCE),
        ({"own": None}, Reason.NO_STATE, AutopilotRequest.HOLD),
        ({"plausible": False}, Reason.BAD_STATE, AutopilotRequest.LAND),
        ({"plan": plan(usable=False)}, Reason.SHIFTED_PLAN, AutopilotRequest.NONE),
        ({"plan": plan(u=(np.nan, 0, 0, 0))}, Reason.BRAKE, AutopilotRequest.NONE),
        ({"plan": None}, Reason.BRAKE, AutopilotRequest.NONE),
        ({"outside": 0.5, "outward": 1.0}, Reason.FENCE, AutopilotRequest.NONE),
        ({"outside": 0.5, "outward": 0.0}, Reason.PLAN, AutopilotRequest.NONE),
        ({"outside": 1.1, "outward": 0.0}, Reason.FENCE, AutopilotRequest.LAND),
        ({"blind": 0.1, "v": (1.5, 0, 0)}, Reason.BLIND, AutopilotRequest.NONE),
        ({"blind": 6.0}, Reason.BLIND, AutopilotRequest.HOLD),
        ({"tick_gap": 0.2}, Reason.PLAN, AutopilotRequest.NONE),
        ({"tick_gap": 0.31}, Reason.LATE, AutopilotRequest.NONE),
        ({"tick_gap": 0.31, "blind": 6.0}, Reason.LATE, AutopilotRequest.HOLD),
        ({"tick_gap": np.inf}, Reason.LATE, AutopilotRequest.NONE),
    ],
)
def test_each_rule_gives_its_reason_and_request(more, reason, asked):
    verdict = Guard(GuardConfig()).judge(inputs(**more))
    assert (verdict.reason, verdict.request) == (reason, asked)


def test_bad_solves_brake_then_land_and_a_good_one_flies_again():
    guard = Guard(GuardConfig())
    bad = [guard.judge(inputs(0.1 * k, plan=plan(usable=False))) for k in range(22)]
    assert [v.reason for v in bad[:4]] == [Reason.SHIFTED_PLAN] * 2 + [Reason.BRAKE] * 2
    assert [v.request for v in bad].index(AutopilotRequest.LAND) == 20
    assert [v.bad_ticks for v in bad] == list(range(1, 23))
    good = guard.judge(inputs(2.2))
    assert (good.reason, good.bad_ticks, good.request) == (Reason.PLAN, 0, AutopilotRequest.NONE)


def test_braking_tilts_against_the_motion():
    command = brake(own((2.0, 0.0, 0.0)), GuardConfig())
    assert command.omega[1] < -1.0  # nose up
    assert brake(own(), GuardConfig()).c == pytest.approx(9.80665)


def test_the_second_late_tick_brakes_gently():
    guard = Guard(GuardConfig())
    reasons = [guard.judge(inputs(tick_gap=gap)).reason for gap in (0.1, 0.2, 0.2, 0.2, 0.1)]
    assert reasons == [Reason.PLAN, Reason.PLAN, Reason.LATE, Reason.LATE, Reason.PLAN]
    fast = own((2.0, 0.0, 0.0))
    turns = [abs(brake_late(fast, GuardConfig(), gap).omega[1]) for gap in (0.2, 0.3, 0.5)]
    assert turns == sorted(turns, reverse=True)
    assert turns[0] < 0.25 * abs(brake(fast, GuardConfig()).omega[1])


def test_a_loss_of_half_the_setpoints_flies_the_plan_and_then_holds():
    guard = Guard(GuardConfig())
    # A loss that began above 0.4 is over below 0.2.
    said = [guard.judge(inputs(0.1 * k, packet_loss=0.21 if k % 3 else 0.5)) for k in range(13)]
    assert {v.reason for v in said} == {Reason.LOSSY}
    assert [v.request for v in said].index(AutopilotRequest.HOLD) == 10
    assert all(v.command.omega.tolist() == [0.1, 0.2, 0.3] for v in said)
    assert guard.judge(inputs(1.3, packet_loss=0.2)).reason is Reason.PLAN
    again = guard.judge(inputs(1.4, packet_loss=0.39))
    assert (again.reason, again.request) == (Reason.PLAN, AutopilotRequest.NONE)
    braking = guard.judge(inputs(1.5, packet_loss=0.5, blind=1.5))
    assert (braking.reason, braking.request) == (Reason.BLIND, AutopilotRequest.NONE)
    assert guard.judge(inputs(2.5, packet_loss=0.5, blind=1.5)).request is AutopilotRequest.HOLD


EACH_RULE = [
    ({"age": 0.31}, Reason.NO_STATE),
    ({"plausible": False}, Reason.BAD_STATE),
    ({"tick_gap": 0.31}, Reason.LATE),
    ({"plan": None}, Reason.BRAKE),
    ({"outside": 1.1}, Reason.FENCE),
    ({"blind": 6.0}, Reason.BLIND),
    ({}, Reason.PLAN),
]


@pytest.mark.parametrize("first", range(len(EACH_RULE)))
def test_of_all_rules_that_apply_the_first_of_the_table_gives_the_command(first):
    every = {key: value for more, _ in EACH_RULE[first:] for key, value in more.items()}
    assert Guard(GuardConfig()).judge(inputs(**every)).reason is EACH_RULE[first][1]


def test_a_late_tick_keeps_the_request_of_the_rules_below_it():
    late = {"tick_gap": 0.31, "outside": 1.1}
    verdict = Guard(GuardConfig()).judge(inputs(**late))
    assert (verdict.reason, verdict.request) == (Reason.LATE, AutopilotRequest.LAND)


def test_a_plan_that_rests_on_a_camera_which_does_not_fit_is_not_flown():
    blind = Guard(GuardConfig()).judge(inputs(blind=0.1))
    assert blind.command.c == pytest.approx(9.81)
    assert blind.command.omega == pytest.approx([0.1, 0.2, 0.3])
    misled = Guard(GuardConfig()).judge(inputs(blind=0.1, misled=True))
    assert misled.reason is Reason.BLIND
    assert misled.command.omega == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)


def braked(delay, known, lag=0.03, wind=0.0, told_of=True):
    """Brake from 1.6 m/s; commands act `delay` [s] after their tick, rates follow with a lag [s].

    known: s, the delay that the prediction knows; None: braked from the state of the tick. wind:
    m/s², to the east; told_of: the guard knows what the prediction says of it. Return the largest
    tilt [rad] and speed [m/s] of the last two of six seconds: the wind that is estimated while the
    drone brakes hard is none, and is forgotten within two.
    """
    x, omega = np.array([0.0, 0.0, 2.0, 1.6, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), np.zeros(3)
    history = InputHistory(known or 0.0)
    predictor, guard = StatePredictor(history), Guard(GuardConfig())
    waiting, acts, late = [], RateCommand(np.zeros(3), 9.80665), []
    for step in range(1200):
        time = 0.005 * step
        if step % 20 == 0:
            now = VehicleState(time, x[:3], x[3:6], x[6:10], omega)
            ahead = predictor.update(now)
            p, v, q = np.split(ahead.x0, [3, 6])
            acting = None if known is None else replace(now, p=p, v=v, q_wb=q)
            blows = ahead.disturbance if told_of else None
            bad = plan(u=(np.nan, 0, 0, 0))
            told = inputs(time, own=now, acting=acting, plan=bad, wind=blows)
            command = guard.judge(told).command
            history.add(SentInput(time, np.array([command.c, *command.omega]), 0.3))
            waiting.append((time + delay, command))
        while waiting and waiting[0][0] <= time:
            acts = waiting.pop(0)[1]
        omega = omega + 0.005 / lag * (acts.omega - omega)
        x = predict(x, np.array([acts.c, *omega]), 0.005, np.array([wind, 0.0, 0.0]))
        if step >= 800:
            late.append((np.arccos(rotation_matrix(x[6:10])[2, 2]), abs(x[3])))
    return np.max(late, axis=0)


@pytest.mark.parametrize("delay", [0.02, 0.05, 0.08, 0.12, 0.16])
def test_braking_does_not_swing_whatever_the_delay_that_is_known(delay):
    tilt, speed = braked(delay, known=delay + 0.03)
    assert tilt < 0.02
    assert speed < 0.02


def test_braking_from_the_state_of_the_tick_swings():
    tilt, speed = braked(0.08, known=None)  # what the prediction is for
    assert tilt > 0.2
    assert speed > 0.2


def test_braking_stands_still_in_the_wind_that_is_known():
    """A drone that knows nothing of the wind drifts."""
    for delay in (0.05, 0.12):
        tilt, speed = braked(delay, known=delay + 0.03, wind=2.0)
        assert tilt == pytest.approx(np.arctan(2.0 / 9.80665), abs=0.03)
        assert speed < 0.05
    assert braked(0.05, known=0.08, wind=2.0, told_of=False)[1] > 0.3


BRAKES = [
    {"failure": "see: no"},
    {"plan": None},
    {"outside": 0.5, "outward": 1.0},
    {"outside": 1.5},
    {"blind": 0.1, "v": (1.5, 0.0, 0.0)},
    {"blind": 0.1, "misled": True},
    {"broken": Broken("speed: …", Reaction.SLOW), "v": (1.5, 0.0, 0.0)},
    {"broken": Broken("speed: …", Reaction.HOVER)},
    {"broken": Broken("height: …", Reaction.CLIMB)},
    {"broken": Broken("speed: …", Reaction.HOLD)},
]


@pytest.mark.parametrize("more", BRAKES)
def test_whatever_brakes_makes_up_for_the_wind(more):
    calm = Guard(GuardConfig()).judge(inputs(**more)).command
    for wind in (None, np.full(3, np.nan)):
        command = Guard(GuardConfig()).judge(inputs(**more, wind=wind)).command
        assert (command.omega.tolist(), command.c) == (calm.omega.tolist(), calm.c)
    windy = Guard(GuardConfig()).judge(inputs(**more, wind=np.array([-3.0, 0.0, 1.0]))).command
    assert windy.omega[1] > calm.omega[1] + 0.2  # it leans forward, against it
    assert windy.c < calm.c - 0.5


@pytest.mark.parametrize("doubt", [{"blind": 0.1}, {"broken": Broken("speed: …", Reaction.SLOW)}])
@pytest.mark.parametrize(("speed", "follows"), [(0.4, True), (0.4001, False)])
def test_in_doubt_the_plan_flies_up_to_the_blind_speed(doubt, speed, follows):
    command = Guard(GuardConfig()).judge(inputs(v=(0.0, speed, 0.0), **doubt)).command
    assert (command.omega.tolist() == [0.1, 0.2, 0.3]) is follows


@pytest.mark.parametrize("more", [{"tick_gap": 0.4}, {"plausible": False}, {"own": None}])
def test_where_commands_are_late_or_the_state_is_wrong_no_wind_is_believed(more):
    calm, windy = (
        Guard(GuardConfig()).judge(inputs(**more, wind=wind)).command
        for wind in (None, np.array([-3.0, 0.0, 1.0]))
    )
    assert (windy.omega.tolist(), windy.c) == (calm.omega.tolist(), calm.c)
