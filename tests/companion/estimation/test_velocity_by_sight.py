"""A velocity that is wrong with its position is corrected by the ground; a right one is not."""

from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.height import Height
from companion.estimation.odometry_frame import OdometryFrame
from companion.estimation.own_doubt import OwnDoubt
from companion.estimation.turns import Turn
from companion.estimation.velocity_by_sight import VelocityBySight, VelocityFromGround
from companion.estimation.velocity_lag import Step
from companion.perception.ground_flow import GroundFlow, way_over_ground
from mavlink_bridge.shared.frames import quaternion_from_euler, rotation_matrix
from mavlink_bridge.wire.messages import LocalPosition, VehicleState

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
HEIGHT = Height(2.0, 0.15)
STEP = Step(np.array([0.3, -0.4]), 4.9, 5.0)  # m/s, s


def true_velocity(t):
    """A weaving drone at 1.5 m/s."""
    return np.array([1.5 * np.cos(0.5 * np.sin(0.4 * t)), 1.5 * np.sin(0.5 * np.sin(0.4 * t)), 0.0])


def fly(
    wrong, seconds=20.0, noise=0.2, scale=1.05, sees=lambda t: True, seed=4, turn=0.0, yaw=0.006
):
    """Fly with telemetry at 50 Hz and a tick and a picture each 0.1 s.

    wrong(t): (3,) m/s that velocity and position are off. noise: m/s, 1 σ of each flow's error.
    scale: of the flow, by a wrong height. sees(t): whether the picture shows
    ground. turn: rad, that the told heading is wrong. yaw: rad, 1 σ of it as told. Return times
    (T,), the errors (T,2) m/s of the velocity that is used, and (T,2) m of the place, both in the
    frame of what is seen, and what was made of the last picture.
    """
    rng, frame, ground = np.random.default_rng(seed), OdometryFrame(), VelocityFromGround()
    place, slid = np.zeros(3), np.zeros(3)
    doubt = OwnDoubt(yaw=yaw)
    states, found, before, shown = {}, [], 0.0, np.zeros(3)
    for k in range(1, round(seconds * 50) + 1):
        t = k / 50
        v = true_velocity(t)
        place, slid = place + v / 50, slid + wrong(t) / 50
        told = LocalPosition(t, place + slid, v + wrong(t) + rng.normal(0.0, 0.03, 3))
        (local,) = frame.localised([told], 0.05)
        states[k] = VehicleState(t, local.p, local.v, LEVEL, np.zeros(3))
        v, seen = turned(v, turn), turned(place, turn)
        found.append((t, *(local.v - v)[:2], *(local.p - seen)[:2]))
        if k % 5:
            continue
        off = noise * rng.normal(size=2)
        if before and sees(t):
            way = scale * turned(place - shown, turn)[:2] + 0.1 * off
            flow = GroundFlow(before, t, way, HEIGHT.value)
            ground.see(flow, states[k - 5], states[k], HEIGHT, doubt)
        before, shown = t, place
        frame.by_sight = ground.decide(t, states[k].v, doubt)
    rows = np.array(found)
    return rows[:, 0], rows[:, 1:3], rows[:, 3:], frame.by_sight


def slide(size, begin=5.0, end=12.0):
    """A velocity that goes wrong at once, and is right again."""
    return lambda t: np.array([0.0, size, 0.0]) if begin <= t < end else np.zeros(3)


def turned(v, angle):
    """Return a vector (3,) turned left by `angle` [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]])


def rms(errors):
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


@pytest.mark.parametrize("seed", range(5))
def test_a_wrong_velocity_is_corrected_within_a_second_and_let_go_again(seed):
    t, v, *_ = fly(slide(0.8), seed=seed)
    assert rms(v[(t > 6.0) & (t < 12.0)]) < 0.3
    assert np.abs(v[(t > 5.95) & (t < 6.05), 1]).mean() < 0.4
    assert rms(v[t > 14.0]) < 0.15
    assert rms(v[t > 16.0]) < 0.1


@pytest.mark.parametrize("seed", range(5))
def test_a_right_velocity_is_left_alone(seed):
    _, v, p, _ = fly(lambda t: np.zeros(3), seconds=60.0, seed=seed)
    _, alone, *_ = fly(lambda t: np.zeros(3), seconds=60.0, sees=lambda t: False, seed=seed)
    assert rms(v - alone) < 0.05
    assert np.linalg.norm(p[250:] - p[:-250], axis=1).max() < 0.3  # within five seconds


def test_what_is_seen_stays_where_it_is_in_odometry():
    t, _, p, _ = fly(slide(0.8))
    moved = np.linalg.norm(p[np.searchsorted(t, 11.9)] - p[np.searchsorted(t, 5.0)])
    assert moved < 1.9  # of 5.5 m


def test_a_camera_that_sees_no_ground_any_more_lets_the_correction_fade():
    t, v, *_ = fly(slide(0.8, end=40.0), seconds=30.0, sees=lambda t: t < 8.0)
    assert abs(v[np.searchsorted(t, 8.2), 1]) < 0.4
    assert v[-1, 1] == pytest.approx(0.8, abs=0.15)


def test_nothing_is_corrected_before_a_picture_came():
    v = np.array([1.0, -0.5, 0.2])
    by_sight = VelocityFromGround().decide(3.0, v, OwnDoubt(velocity=0.1, yaw=0.05))
    assert by_sight.corrected(v) == pytest.approx(v)
    assert by_sight.turn_sigma == pytest.approx(0.05)
    assert by_sight.sigma == pytest.approx(np.hypot(0.1, 0.05 * np.hypot(1.0, 0.5)))


def test_a_correction_is_taken_back():
    made = VelocityBySight(turn=0.3, error=np.array([0.2, -0.1, 0.0]))
    v = np.array([1.0, -0.5, 0.2])
    assert made.told(made.corrected(v)) == pytest.approx(v)
    assert VelocityBySight(turn=np.pi / 2).corrected(v) == pytest.approx([0.5, 1.0, 0.2])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("degrees", [-5.0, -2.0, 0.0, 5.0])
def test_a_wrong_heading_is_found_to_its_doubt(degrees, seed):
    turn = np.radians(degrees)
    *_, made = fly(lambda t: np.zeros(3), seconds=40.0, turn=turn, yaw=0.05, seed=seed)
    assert made.turn_sigma < np.radians(1.5)
    assert abs(made.turn - turn) < 3.0 * made.turn_sigma


@pytest.mark.parametrize("degrees", [5.0, 20.0])
def test_what_is_seen_stays_where_it_is_with_a_wrong_heading(degrees):
    *_, alone, _ = fly(lambda t: np.zeros(3), turn=np.radians(degrees), sees=lambda t: False)
    *_, p, _ = fly(lambda t: np.zeros(3), turn=np.radians(degrees), yaw=0.05)
    assert np.linalg.norm(p[-1] - p[-200]) < 0.3 * np.linalg.norm(alone[-1] - alone[-200])


def of_the_gyro(angle, seconds=2.0, begin=0.0):
    """A heading that turns by `angle` [rad], and the gyro does not."""
    dt = 0.02
    return [
        Turn(begin + k * dt, dt, True, (0.0, 0.0, 0.0), 0.0, angle * dt / seconds)
        for k in range(round(seconds / dt))
    ]


def that_has_seen_ground():
    """A filter to which the ground has passed as told for five seconds, at 1.5 m/s."""
    ground, v = VelocityFromGround(), np.array([1.5, 0.0, 0.0])
    for k in range(1, 51):
        before, after = (
            VehicleState(0.1 * j, 0.1 * j * v, v, LEVEL, np.zeros(3)) for j in (k - 1, k)
        )
        flow = GroundFlow(before.time, after.time, 0.1 * v[:2], HEIGHT.value)
        ground.see(flow, before, after, HEIGHT, OwnDoubt())
    return ground


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


def test_a_step_of_the_told_velocity_is_taken_back_at_once_and_fades():
    ground, v = that_has_seen_ground(), np.array([1.5, 0.0, 0.0])
    before = ground.decide(5.0, v, OwnDoubt())
    assert ground.step(STEP)
    made = ground.decide(5.0, v, OwnDoubt())
    assert made.error - before.error == pytest.approx([-0.3, 0.4, 0.0], abs=0.01)
    assert made.sigma > before.sigma + 0.1
    later = ground.decide(9.0, v, OwnDoubt())  # no ground in view since
    assert np.linalg.norm(later.error) < 0.1


def test_a_flow_over_a_step_does_not_count():
    ground, v = that_has_seen_ground(), np.array([1.5, 0.0, 0.0])
    ground.step(STEP)
    made = ground.decide(5.0, v, OwnDoubt())
    states = [VehicleState(t, np.zeros(3), v, LEVEL, np.zeros(3)) for t in (4.95, 5.02)]
    flow = GroundFlow(4.95, 5.02, np.array([0.3, 0.0]), 2.0)
    ground.see(flow, *states, HEIGHT, OwnDoubt())
    assert ground.decide(5.0, v, OwnDoubt()).error == pytest.approx(made.error)


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


def test_a_step_before_ground_was_seen_does_not_count():
    ground = VelocityFromGround()
    assert not ground.step(STEP)
    assert not ground.decide(1.0, np.zeros(3), OwnDoubt()).error.any()


def test_where_ground_passes_its_doubt_bounds_that_of_the_told_velocity():
    ground, v = that_has_seen_ground(), np.array([1.5, 0.0, 0.0])
    assert ground.decide(5.0, v, OwnDoubt()).shown < 0.15
    assert ground.decide(8.0, v, OwnDoubt()).shown == np.inf
    assert VelocityFromGround().decide(0.0, v, OwnDoubt()).shown == np.inf


def flow_as_it_looks(t, v, rate, lean, rng):
    """The flow from `t` on, of ground before a camera; told attitudes lean by `lean` (2,) rad.

    The drone turns at `rate` [rad/s]; lean: about its axes ahead and to the left.
    """
    yaws = rate * t, rate * (t + 0.1)
    off, away = rng.uniform(-1.3, 1.3, 60), 5.0 * np.sqrt(rng.random(60))
    ground = np.column_stack([away * np.cos(off + yaws[0]), away * np.sin(off + yaws[0])])
    rays = []
    for k, yaw in enumerate(yaws):
        points = np.column_stack([ground - 0.1 * k * v[:2], np.full(60, -HEIGHT.value)])
        seen = points @ rotation_matrix(quaternion_from_euler(0.0, 0.0, yaw))  # in the body
        told = rotation_matrix(quaternion_from_euler(*lean, yaw))
        rays.append(seen @ told.T / np.linalg.norm(points, axis=1)[:, None])
    way = way_over_ground(*rays, HEIGHT.value, HEIGHT.value)
    return None if way is None else GroundFlow(t, t + 0.1, way, HEIGHT.value)


@pytest.mark.parametrize("lean", [[0.05, 0.0], [0.0, -0.05], [-0.035, 0.035]])
@pytest.mark.parametrize("rate", [2.0, -1.0])
def test_an_attitude_that_leans_moves_the_velocity_little_while_the_drone_turns(lean, rate):
    ground, v, rng = VelocityFromGround(), np.array([0.3, 0.0, 0.0]), np.random.default_rng(3)
    doubt = OwnDoubt(velocity=0.15, tilt=0.025, yaw=0.05)
    errors, shown = [], []
    for k in range(150):
        t = 0.1 * k
        flow = flow_as_it_looks(t, v, rate, lean, rng)
        if flow is not None:
            states = [
                VehicleState(s, np.zeros(3), v, quaternion_from_euler(*lean, rate * s), np.zeros(3))
                for s in (t, t + 0.1)
            ]
            ground.see(flow, *states, HEIGHT, doubt)
            shown.append(np.linalg.norm(flow.way / 0.1 - v[:2]))
        errors.append(np.linalg.norm(ground.decide(t + 0.1, v, doubt).corrected(v) - v))
    assert np.mean(shown) > 0.05 * abs(rate)  # so wrong is what the ground shows
    assert np.mean(errors[50:]) < 0.12


STILL = np.zeros(3)
CALM = OwnDoubt(velocity=0.1, tilt=0.0, yaw=0.05)
QUIET = 0.085**2  # m²/s², of a flow without motion, 1 m over ground, in a tenth of a second
KNOWN = Height(1.0, 0.0)


def see(ground, off, after=0.1, dt=0.1, v=STILL, height=KNOWN, doubt=CALM, yaws=(0.0, 0.0)):
    """Show a flow that is (2,) m/s `off` the velocity, between two headings [rad]."""
    states = [
        VehicleState(t, STILL, v, quaternion_from_euler(0.0, 0.0, yaw), STILL)
        for t, yaw in zip((after - dt, after), yaws, strict=True)
    ]
    flow = GroundFlow(after - dt, after, dt * (v[:2] + off), height.value)
    ground.see(flow, *states, height, doubt)


def that_saw(off, **how):
    """A filter that has seen one flow, `off` (2,) m/s."""
    ground = VelocityFromGround()
    see(ground, np.array(off), **how)
    return ground


def error_of(ground, time=0.1, doubt=CALM):
    """The error (3,) m/s that is found of a velocity of 0."""
    return ground.decide(time, STILL, doubt).error


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


@pytest.mark.parametrize(
    ("after", "counts"), [(0.4, True), (0.45, False), (0.55, False), (0.6, True)]
)
def test_flows_before_and_after_a_step_count_and_those_over_a_part_of_it_do_not(after, counts):
    ground = that_saw([0.0, 0.0])
    ground.step(Step(np.zeros(2), 0.4, 0.5))
    see(ground, np.array([0.1, 0.0]), after=after)
    assert error_of(ground, after).any() == counts


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


def test_half_of_a_step_is_doubted():
    ground = that_saw([0.1, 0.0])
    before = ground.decide(0.1, STILL, CALM)
    ground.step(Step(np.array([0.24, -0.32]), 0.1, 0.2))
    after = ground.decide(0.1, STILL, CALM)
    assert after.error - before.error == pytest.approx([-0.24, 0.32, 0.0])
    assert after.sigma == pytest.approx(np.hypot(before.sigma, 0.2))


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


def test_a_step_leaves_what_the_flow_showed_before_it_to_compare_with():
    found = []
    for steps in (False, True):
        ground = that_saw([0.0, 0.0])
        if steps:
            ground.step(Step(np.zeros(2), 0.05, 0.1))
        see(ground, np.array([4.0 * np.sqrt(QUIET), 0.0]), after=0.2)
        found.append(error_of(ground, 0.2))
    assert found[1] == pytest.approx(found[0])
