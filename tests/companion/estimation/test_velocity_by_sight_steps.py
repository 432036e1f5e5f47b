"""Steps of the told velocity, and turns of the told heading without the gyro, are taken back."""

from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.own_doubt import OwnDoubt
from companion.estimation.turns import Turn
from companion.estimation.velocity_by_sight import VelocityFromGround
from companion.estimation.velocity_lag import Step
from companion.perception.ground_flow import GroundFlow
from mavlink_bridge.wire.messages import VehicleState
from tests.companion.estimation.ground_flows import (
    CALM,
    HEIGHT,
    LEVEL,
    QUIET,
    STILL,
    error_of,
    see,
    that_has_seen_ground,
    that_saw,
)

STEP = Step(np.array([0.3, -0.4]), 4.9, 5.0)  # m/s, s


def of_the_gyro(angle, seconds=2.0, begin=0.0):
    """A heading that turns by `angle` [rad], and the gyro does not."""
    dt = 0.02
    return [
        Turn(begin + k * dt, dt, True, (0.0, 0.0, 0.0), 0.0, angle * dt / seconds)
        for k in range(round(seconds / dt))
    ]


@pytest.mark.parametrize("degrees", [-20.0, 10.0])
def test_a_heading_that_turns_without_the_gyro_turns_the_velocity(degrees):
    ground = that_has_seen_ground()
    ground.turn(of_the_gyro(np.radians(degrees), begin=5.0))
    made = ground.decide(7.0, np.array([1.5, 0.0, 0.0]), OwnDoubt())
    assert np.degrees(made.turn) == pytest.approx(degrees, abs=3.0)
    assert made.turn_sigma > np.radians(1.0)


def test_a_heading_that_is_reset_before_ground_was_seen_turns_nothing():
    ground = VelocityFromGround()
    ground.turn(of_the_gyro(np.radians(20.0)))
    assert ground.decide(2.0, np.array([1.5, 0.0, 0.0]), OwnDoubt()).turn == 0.0


def test_what_sparse_samples_leave_open_of_a_turn_does_not_count():
    ground = that_has_seen_ground()
    turns = [replace(turn, spread=0.02) for turn in of_the_gyro(np.radians(4.0), begin=5.0)]
    ground.turn(turns)
    assert ground.decide(7.0, np.array([1.5, 0.0, 0.0]), OwnDoubt()).turn == pytest.approx(0.0)


def test_a_gyro_that_drifts_turns_nothing():
    ground = that_has_seen_ground()
    ground.turn(of_the_gyro(np.radians(30.0), seconds=60.0, begin=5.0))  # 0.5 °/s
    turn = ground.decide(65.0, np.array([1.5, 0.0, 0.0]), OwnDoubt()).turn
    assert turn == pytest.approx(0.0, abs=1e-6)


def turn_of(up, dt=0.02, spread=0.0):
    return Turn(0.0, dt, True, (0.0, 0.0, 0.0), spread, up)


@pytest.mark.parametrize(
    ("turns", "whole"),
    [
        ([turn_of(0.029)], 0.0),
        ([turn_of(0.031)], 0.031),
        ([turn_of(-0.031)], -0.031),
        ([turn_of(0.039, spread=0.02)], 0.0),  # half of the spread is open
        ([turn_of(0.041, spread=0.02)], 0.041),
        ([turn_of(0.02), turn_of(0.02, dt=1.0)], 0.02 + 0.02 * np.exp(-1.0 / 3.0)),
        ([turn_of(0.02), turn_of(0.02, dt=3.0)], 0.0),
        ([turn_of(0.0, spread=0.02), turn_of(0.0365, dt=3.0)], 0.0365),
        ([turn_of(0.0, spread=0.02), turn_of(0.0365, dt=0.3)], 0.0),
        ([turn_of(0.04), turn_of(0.02), turn_of(0.05)], 0.04 + 0.05 + 0.02 * np.exp(-0.02 / 3.0)),
    ],
)
def test_turns_count_from_a_sum_of_three_hundredths_on_within_three_seconds(turns, whole):
    assert VelocityFromGround().turn(turns) == pytest.approx(whole)


@pytest.mark.parametrize("up", [0.2, -0.1])
def test_half_of_a_turn_that_the_gyro_does_not_show_is_doubted(up):
    ground = that_saw([0.0, 0.0])
    ground.turn([turn_of(up)])
    made = ground.decide(0.1, STILL, CALM)
    assert made.turn == pytest.approx(up)
    assert made.turn_sigma == pytest.approx(np.hypot(0.05, 0.5 * up))


def test_a_step_of_the_told_velocity_is_taken_back_at_once_and_fades():
    ground, v = that_has_seen_ground(), np.array([1.5, 0.0, 0.0])
    before = ground.decide(5.0, v, OwnDoubt())
    assert ground.step(STEP)
    made = ground.decide(5.0, v, OwnDoubt())
    assert made.error - before.error == pytest.approx([-0.3, 0.4, 0.0], abs=0.01)
    assert made.sigma > before.sigma + 0.1
    later = ground.decide(9.0, v, OwnDoubt())  # no ground in view since
    assert np.linalg.norm(later.error) < 0.1


def test_a_step_before_ground_was_seen_does_not_count():
    ground = VelocityFromGround()
    assert not ground.step(STEP)
    assert not ground.decide(1.0, np.zeros(3), OwnDoubt()).error.any()


def test_half_of_a_step_is_doubted():
    ground = that_saw([0.1, 0.0])
    before = ground.decide(0.1, STILL, CALM)
    ground.step(Step(np.array([0.24, -0.32]), 0.1, 0.2))
    after = ground.decide(0.1, STILL, CALM)
    assert after.error - before.error == pytest.approx([-0.24, 0.32, 0.0])
    assert after.sigma == pytest.approx(np.hypot(before.sigma, 0.2))


def test_a_flow_over_a_step_does_not_count():
    ground, v = that_has_seen_ground(), np.array([1.5, 0.0, 0.0])
    ground.step(STEP)
    made = ground.decide(5.0, v, OwnDoubt())
    states = [VehicleState(t, np.zeros(3), v, LEVEL, np.zeros(3)) for t in (4.95, 5.02)]
    flow = GroundFlow(4.95, 5.02, np.array([0.3, 0.0]), 2.0)
    ground.see(flow, *states, HEIGHT, OwnDoubt())
    assert ground.decide(5.0, v, OwnDoubt()).error == pytest.approx(made.error)


@pytest.mark.parametrize(
    ("after", "counts"), [(0.4, True), (0.45, False), (0.55, False), (0.6, True)]
)
def test_flows_before_and_after_a_step_count_and_those_over_a_part_of_it_do_not(after, counts):
    ground = that_saw([0.0, 0.0])
    ground.step(Step(np.zeros(2), 0.4, 0.5))
    see(ground, np.array([0.1, 0.0]), after=after)
    assert error_of(ground, after).any() == counts


def test_a_step_of_what_is_told_is_no_jump_of_the_flow():
    """The flow shows the step that was taken out: it confirms it, to its noise and no more."""
    sigmas = []
    for change in ([0.0, 0.0], [0.5, 0.0]):
        ground = that_saw([0.0, 0.0])
        ground.step(Step(np.array(change), 0.1, 0.19))
        see(ground, -np.array(change), after=0.3)
        assert error_of(ground, 0.3)[0] == pytest.approx(-change[0], abs=0.07)
        sigmas.append(ground.decide(0.3, STILL, CALM).sigma)
    assert sigmas[1] < np.sqrt(QUIET)


def test_a_step_leaves_what_the_flow_showed_before_it_to_compare_with():
    found = []
    for steps in (False, True):
        ground = that_saw([0.0, 0.0])
        if steps:
            ground.step(Step(np.zeros(2), 0.05, 0.1))
        see(ground, np.array([4.0 * np.sqrt(QUIET), 0.0]), after=0.2)
        found.append(error_of(ground, 0.2))
    assert found[1] == pytest.approx(found[0])
