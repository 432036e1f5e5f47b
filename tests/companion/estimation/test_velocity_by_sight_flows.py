"""What a flow of the ground tells of the velocity: how much it counts, and which say nothing."""

from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.height import Height
from companion.estimation.own_doubt import OwnDoubt
from companion.estimation.velocity_by_sight import VelocityFromGround
from companion.perception.ground_flow import GroundFlow
from mavlink_bridge.wire.messages import VehicleState
from tests.companion.estimation.ground_flows import (
    CALM,
    HEIGHT,
    KNOWN,
    LEVEL,
    QUIET,
    STILL,
    error_of,
    see,
    that_has_seen_ground,
    that_saw,
)


def test_flows_that_jump_from_one_to_the_next_move_little():
    """Three flows of the corners of a trunk, among those of the ground; or three that agree."""
    moved, v = [], np.array([1.5, 0.0, 0.0])
    for errors in ([0.8, 1.6, 0.5], [1.0, 1.0, 1.0]):
        ground, worst = that_has_seen_ground(), 0.0
        for k, error in enumerate([0.0, *errors, *10 * [None]]):
            t = 4.9 + 0.1 * k
            if error is not None:
                states = [VehicleState(s, np.zeros(3), v, LEVEL, np.zeros(3)) for s in (t, t + 0.1)]
                flow = GroundFlow(t, t + 0.1, np.array([0.15, 0.1 * error]), 2.0)
                ground.see(flow, *states, HEIGHT, OwnDoubt())
            worst = max(worst, abs(ground.decide(t + 0.1, v, OwnDoubt()).error[1]))
        moved.append((worst, abs(ground.decide(t + 0.1, v, OwnDoubt()).error[1])))
    (jumping, left), (agreeing, _) = moved
    assert jumping < 0.05
    assert left < 0.02
    assert agreeing > 4.0 * jumping


def test_where_ground_passes_its_doubt_bounds_that_of_the_told_velocity():
    ground, v = that_has_seen_ground(), np.array([1.5, 0.0, 0.0])
    assert ground.decide(5.0, v, OwnDoubt()).shown < 0.15
    assert ground.decide(8.0, v, OwnDoubt()).shown == np.inf
    assert VelocityFromGround().decide(0.0, v, OwnDoubt()).shown == np.inf


@pytest.mark.parametrize("degrees", [0.0, 90.0, 200.0, -30.0])
def test_a_flow_tells_of_error_turn_and_scale_by_how_far_each_is_in_doubt(degrees):
    """At 1.5 m/s, 2 m over ground known to 0.15 m; the flow is 0.1 m/s too long, and to the left.

    Along: the error of 0.1 m/s, the scale of 5 % and of the height's, and 0.0115 of 2 m in 0.1 s.
    Across: the error, the turn, and 0.0085 of 2 m in 0.1 s.
    """
    ahead = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), 0.0])
    left = np.array([-ahead[1], ahead[0], 0.0])
    ground = that_saw(0.1 * (ahead + left)[:2], v=1.5 * ahead, height=Height(2.0, 0.15))
    made = ground.decide(0.1, 1.5 * ahead, CALM)
    turn = (1.5 * 0.05) ** 2
    along = 0.01 + 1.5**2 * (0.05**2 + 0.075**2) + 0.23**2
    across = 0.01 + turn + 0.17**2
    assert made.error @ ahead == pytest.approx(0.1 * 0.01 / along)
    assert made.error @ left == pytest.approx(0.1 * 0.01 / across)
    assert made.turn == pytest.approx(0.1 * 1.5 * 0.05**2 / across)
    assert made.turn_sigma == pytest.approx(0.05 * np.sqrt(1.0 - turn / across))
    beside = (0.01 + turn) * 0.17**2 / across
    assert made.sigma == pytest.approx(np.sqrt(max(0.01 - 0.01**2 / along, beside)))
    assert made.shown == made.sigma


def test_what_one_flow_told_fades():
    """An error lasts for 1.5 s, a turn for 300 s."""
    ground = that_saw([0.1, 0.0], v=np.array([0.0, 1.5, 0.0]), height=Height(2.0, 0.15))
    first, later = (ground.decide(t, STILL, CALM) for t in (0.1, 1.1))
    assert later.error == pytest.approx(np.exp(-1.0 / 1.5) * first.error)
    assert later.turn == pytest.approx(np.exp(-1.0 / 300.0) * first.turn)
    left = np.exp(-2.0 / 1.5)
    assert later.sigma**2 == pytest.approx(left * first.sigma**2 + (1.0 - left) * 0.01)
    assert ground.decide(1.59, STILL, CALM).shown < 0.1
    assert ground.decide(1.61, STILL, CALM).shown == np.inf


def test_a_decision_before_the_last_flow_fades_nothing():
    ground = that_saw([0.1, 0.0])
    assert error_of(ground, 0.0) == pytest.approx(error_of(ground, 0.1))


@pytest.mark.parametrize(("dt", "counts"), [(0.24, True), (0.26, False), (0.0, False)])
def test_pictures_more_than_a_quarter_of_a_second_apart_say_nothing(dt, counts):
    ground = VelocityFromGround()
    states = [VehicleState(t, STILL, STILL, LEVEL, STILL) for t in (1.0 - dt, 1.0)]
    ground.see(GroundFlow(1.0 - dt, 1.0, np.array([0.02, 0.0]), 1.0), *states, KNOWN, CALM)
    assert error_of(ground, 1.0).any() == counts


def test_a_flow_that_ends_no_later_than_the_last_one_says_nothing():
    ground = that_saw([0.1, 0.0], after=0.2)
    before = error_of(ground, 0.2)
    for after in (0.15, 0.2):
        see(ground, np.array([0.1, 0.0]), after=after)
        assert error_of(ground, 0.2) == pytest.approx(before)
    see(ground, np.array([0.1, 0.0]), after=0.22)
    assert error_of(ground, 0.22)[0] > 1.1 * before[0]


def test_flows_that_are_off_by_more_than_60_cm_a_second_count_as_off_by_so_much():
    most = error_of(that_saw([0.36, 0.48]))
    assert error_of(that_saw([3.6, 4.8])) == pytest.approx(most)
    assert np.linalg.norm(error_of(that_saw([0.3, 0.4]))) < 0.99 * np.linalg.norm(most)


def test_a_flow_beyond_two_standard_deviations_counts_as_two_of_them():
    sigma = np.sqrt(0.01 + QUIET)
    most = 2.0 * 0.01 / sigma
    assert error_of(that_saw([0.0, 3.0 * sigma]))[1] == pytest.approx(most)
    assert error_of(that_saw([0.0, 1.9 * sigma]))[1] == pytest.approx(0.95 * most)


def test_a_jump_from_flow_to_flow_is_noise_as_far_as_it_is_beyond_two_standard_deviations():
    """Four times the noise of one flow: half of its square counts as two flows' noise."""
    ground = that_saw([0.0, 0.0])
    see(ground, np.array([4.0 * np.sqrt(QUIET), 0.0]), after=0.2)
    kept = np.exp(-0.2 / 1.5)
    p = kept * 0.01 * QUIET / (0.01 + QUIET) + (1.0 - kept) * 0.01
    expected = p / (p + 5.0 * QUIET) * 4.0 * np.sqrt(QUIET)
    assert error_of(ground, 0.2) == pytest.approx([expected, 0.0, 0.0])


def test_from_a_flow_of_long_ago_nothing_jumps():
    """After 0.65 s; it is beyond two standard deviations, and counts as two."""
    ground = that_saw([0.0, 0.0])
    see(ground, np.array([4.0 * np.sqrt(QUIET), 0.0]), after=0.75)
    kept = np.exp(-1.3 / 1.5)
    p = kept * 0.01 * QUIET / (0.01 + QUIET) + (1.0 - kept) * 0.01
    assert error_of(ground, 0.75)[0] == pytest.approx(2.0 * p / np.sqrt(p + QUIET))


def test_an_innovation_far_beyond_noise_tells_that_the_autopilot_does_not_know_its_error():
    """Of 0.6 m/s, where 0.066 are expected; a share of it is the mean over 0.6 s.

    That mean is 4.87 times its own noise; what is beyond twice that may be an error of twice it,
    which lasts for five seconds.
    """
    doubt, height = OwnDoubt(velocity=0.05, tilt=0.0, yaw=0.05), Height(0.5, 0.0)
    ground = that_saw([0.0, 0.6], height=height, doubt=doubt)
    noise = 0.25 * QUIET
    gain = 0.05**2 / (0.05**2 + noise)
    assert error_of(ground, 0.1, doubt)[1] == pytest.approx(0.6 * gain)
    share = 1.0 - np.exp(-0.1 / 0.6)
    square = share * (2.0 - share) * 0.36 / (0.05**2 + noise)
    wrong = (1.0 - 4.0 / square) * (2.0 * share * 0.6) ** 2
    later = ground.decide(1.1, STILL, doubt)
    kept = np.exp(-2.0 / 5.0)
    variance = kept * noise * gain + (1.0 - kept) * 0.05**2
    variance += wrong * (1.0 - np.exp(-2.0 / 1.5))
    assert later.error[1] == pytest.approx(np.exp(-1.0 / 5.0) * 0.6 * gain)
    assert later.sigma == pytest.approx(np.sqrt(variance))


def test_a_flow_is_compared_with_what_was_told_and_not_with_what_was_corrected():
    """The told velocity is 0: the correction of the tick before is in the states."""
    ground = that_saw([0.1, 0.0])
    made = ground.decide(0.1, STILL, CALM)
    see(ground, -made.error[:2], after=0.2, v=made.error)
    gain = 0.01 / (0.01 + QUIET)
    kept = np.exp(-0.1 / 1.5)
    p = kept**2 * QUIET * gain + (1.0 - kept**2) * 0.01
    assert error_of(ground, 0.2)[0] == pytest.approx(kept * 0.1 * gain * QUIET / (p + QUIET))


@pytest.mark.parametrize(("yaw", "axis"), [(0.0, 0), (np.pi / 2, 1), (-np.pi, 0)])
@pytest.mark.parametrize(("shift", "ahead"), [(1.65, True), (1.27, False)])
def test_an_attitude_in_doubt_takes_weight_from_the_flow_while_the_drone_turns(
    yaw, axis, shift, ahead
):
    """It turns by 0.2 rad; a tilt of 0.02 rad shifts the ground 1 m below by 1.65 and 1.27 times.

    The difference of two shifts half of the turn to the left and right is across of it.
    """
    axis = axis if ahead else 1 - axis
    off = 0.1 * np.eye(2)[axis]
    doubt = replace(CALM, tilt=0.02)
    ground = that_saw(off, doubt=doubt, yaws=(yaw - 0.1, yaw + 0.1))
    leaning = (shift * 2.0 * np.sin(0.1) * 0.02 / 0.1) ** 2
    expected = 0.1 * 0.01 / (0.01 + leaning + QUIET)
    assert error_of(ground, 0.1, doubt)[axis] == pytest.approx(expected)


def test_a_flow_of_a_slow_drone_has_no_direction():
    """At 0.1 m/s, half of what tells a direction: a quarter of what is along it, and no more."""
    ground = that_saw([0.1, 0.0], v=np.array([0.1, 0.0, 0.0]), doubt=replace(CALM, yaw=0.0))
    noise = QUIET + 0.25 * (0.115**2 - QUIET)
    expected = 0.1 * 0.01 / (0.01 + 0.1**2 * 0.05**2 + noise)
    assert error_of(ground, 0.1)[0] == pytest.approx(expected)


def test_a_flow_is_compared_by_the_correction_that_held_amid_its_time():
    """One that was made later, and differs, changes nothing of what was told then."""
    found = []
    for decides in (False, True):
        ground = that_saw([0.1, 0.0])
        made = ground.decide(0.1, STILL, CALM)
        see(ground, np.array([0.3, 0.2]), after=0.15)
        if decides:
            assert error_of(ground, 0.16)[1] > 0.01
        see(ground, -made.error[:2], after=0.2, v=made.error)
        found.append(error_of(ground, 0.2))
    assert found[1] == pytest.approx(found[0])
