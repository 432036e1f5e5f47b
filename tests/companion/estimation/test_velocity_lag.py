"""The lag of a reported velocity, from motions whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from companion.estimation.velocity_lag import Lag, VelocityLag
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.wire.messages import VehicleState

DT = 0.1


def flight(lag, seconds=30.0, drag=0.2, noise=0.03, tilt=0.0, seed=1, wind=0.0):
    """Yield states as told and the true velocities (3,) of a drone that goes to and fro.

    wind: m/s², northwards, against which the drone leans.
    """
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0, 2 * np.pi, (2, 4))
    v, p, slow_v, slow_a = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    lift = np.array([0.0, 0.0, GRAVITY])
    for n in range(round(seconds / 0.01)):
        t = 0.01 * n
        rotors = np.zeros(3)
        rotors[:2] = [
            sum(np.sin(w * t + f) for w, f in zip((0.7, 1.3, 2.1, 3.7), row, strict=True))
            for row in phases
        ]
        rotors[1] -= wind
        a = rotors + np.array([0.0, wind, 0.0]) - drag * v
        v, p = v + 0.01 * a, p + 0.01 * v
        slow_a = slow_a + 0.02 * (a - slow_a)  # a low-pass of 0.5 s
        slow_v = slow_v + 0.02 * (v - slow_v)
        if n % 10:
            continue
        up = (rotors + lift) / np.linalg.norm(rotors + lift)
        turn, _ = Rotation.align_vectors([up], [[0, 0, 1.0]])
        x, y, z, w = (Rotation.from_rotvec([tilt, 0, 0]) * turn).as_quat()
        told = v - lag * slow_a + noise * rng.normal(size=3)
        yield VehicleState(t, p - lag * slow_v, told, np.array([w, x, y, z]), np.zeros(3)), v


@pytest.mark.parametrize("lag", [0.08, 0.14, 0.2])
@pytest.mark.parametrize("tilt", [0.0, 0.02])
def test_the_lag_is_found_and_made_up_for(lag, tilt):
    estimator, told, corrected = VelocityLag(), [], []
    for own, v in flight(lag, tilt=tilt):
        found = estimator.update(own, flying=True)
        if own.time > 10.0:
            told.append(own.v - v)
            corrected.append(found.made_up(own).v - v)
    assert found.value == pytest.approx(lag, abs=0.03)
    assert abs(found.value - lag) < 3.0 * found.sigma
    rms = [np.sqrt(np.mean(np.array(e)[:, :2] ** 2)) for e in (told, corrected)]
    assert rms[1] < 0.8 * rms[0]


@pytest.mark.parametrize("wind", [-2.0, 2.0])
def test_wind_that_the_drone_leans_against_is_no_acceleration(wind):
    """It was made up for as one: a quarter of a metre a second, which the pictures contradicted."""
    estimator, corrected = VelocityLag(), []
    for own, v in flight(0.14, wind=wind):
        found = estimator.update(own, flying=True)
        if own.time > 10.0:
            corrected.append((found.made_up(own).v - v)[1])
    assert found.value == pytest.approx(0.14, abs=0.03)
    assert abs(np.mean(corrected)) < 0.03


@pytest.mark.parametrize("seed", range(5))
def test_a_step_of_the_told_velocity_is_told_from_motion(seed):
    """From 20 s on 0.4 m/s are told that are not flown: a GPS signal takes another path."""
    estimator, steps = VelocityLag(), []
    wrong = np.array([0.32, -0.24, 0.0])
    for own, _ in flight(0.14, seed=seed):
        told = replace(own, v=own.v + wrong * (own.time >= 20.0))
        estimator.update(told, flying=True)
        if estimator.step is not None:
            steps.append(estimator.step)
    (step,) = steps
    assert step.since < step.until == pytest.approx(20.0)
    assert np.linalg.norm(step.change - wrong[:2]) < 0.15
    assert estimator.lag.value == pytest.approx(0.14, abs=0.03)


@pytest.mark.parametrize("noise", [0.0, 0.03])
def test_a_minute_straight_on_tells_nothing_and_spoils_nothing(noise):
    """Its doubts grow up to a bound, drag and wind together: the root of one became imaginary."""
    estimator, rng = VelocityLag(), np.random.default_rng(1)
    for k in range(600):
        v = np.array([1.65, 0.0, 0.0]) + noise * rng.normal(size=3)
        level = np.array([1.0, 0.0, 0.0, 0.0])
        lag = estimator.update(VehicleState(DT * k, v * DT * k, v, level, np.zeros(3)), flying=True)
        assert lag.value == 0.0
        assert 0.0 < lag.sigma <= 0.5
    for own, _ in flight(0.14):
        lag = estimator.update(replace(own, time=own.time + 60.0), flying=True)
    assert lag.value == pytest.approx(0.14, abs=0.03)


def test_a_velocity_without_lag_stays_as_it_is():
    estimator = VelocityLag()
    for own, _ in flight(0.0, drag=0.4):
        found = estimator.update(own, flying=True)
        assert found.value == 0.0
        assert found.made_up(own) is own


def test_on_the_ground_nothing_is_learnt():
    estimator = VelocityLag()
    for own, _ in flight(0.2, seconds=10.0):
        found = estimator.update(own, flying=False)
    assert found.value == 0.0
    assert found.sigma == pytest.approx(0.1)


def test_a_state_that_is_corrected_is_the_one_from_which_the_next_change_counts():
    """A step is taken out of the told velocity, and of all that follow: it shows once."""
    estimator, steps = VelocityLag(), []
    for own, _ in flight(0.0, seconds=12.0):
        stepped = own.time > 10.0
        told = replace(own, v=own.v + np.array([0.8 * stepped, 0.0, 0.0]))
        estimator.update(told, flying=True)
        if estimator.step is not None:
            steps.append(estimator.step)
            estimator.corrected(replace(told, v=told.v - np.array([*estimator.step.change, 0.0])))
    assert len(steps) >= 2  # what is told next is again a step from what was corrected
    assert steps[1].change == pytest.approx([0.8, 0.0], abs=0.25)


LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
STILL = np.zeros(3)


def told(time, v=STILL, q=LEVEL):
    return VehicleState(time, STILL, np.array(v), np.array(q), STILL)


def hover(seconds=0.0):
    """An estimator of a drone that hovers level, at 10 Hz up to 0 s."""
    estimator = VelocityLag()
    for k in range(round(10 * seconds), -1, -1):
        estimator.update(told(-0.1 * k), flying=True)
    return estimator


def test_what_a_lag_misses_is_added_to_a_state():
    lag = Lag(0.1, 0.01, np.array([0.1, 0.2, 0.3]), np.array([1.0, -2.0, 0.5]))
    state = lag.made_up(VehicleState(1.0, np.ones(3), np.ones(3), LEVEL, STILL))
    assert state.p == pytest.approx([1.1, 1.2, 1.3])
    assert state.v == pytest.approx([2.0, -1.0, 1.5])
    assert state.time == 1.0


def test_before_motion_there_is_no_lag_and_a_doubt_of_a_tenth_of_a_second():
    estimator = VelocityLag()
    assert (estimator.lag.value, estimator.lag.sigma) == (0.0, pytest.approx(0.1))
    assert estimator.step is None
    assert estimator.update(None, flying=True) is estimator.lag


@pytest.mark.parametrize("east", [1.0, -0.6])
@pytest.mark.parametrize(("size", "steps"), [(0.39, False), (0.43, True)])
def test_before_anything_was_learnt_a_change_of_41_cm_a_second_is_a_step(east, size, steps):
    """4.5 times the root of twice 0.04² m²/s² for noise and twice 0.05² for wind, and of the drag.

    0.5 m/s² of wind are 0.05 m/s in 0.1 s.
    """
    estimator = hover()
    change = size * np.array([east, np.sqrt(1.0 - east**2)])
    estimator.update(told(0.1, [*change, 0.0]), flying=True)
    assert (estimator.step is not None) is steps
    if steps:
        assert estimator.step.change == pytest.approx(change)
        assert (estimator.step.since, estimator.step.until) == (0.0, 0.1)
    estimator.update(told(0.2, [*change, 0.0]), flying=True)
    assert estimator.step is None


@pytest.mark.parametrize(("size", "steps"), [(0.253, False), (0.35, True)])
def test_after_a_long_hover_a_change_of_a_third_of_a_metre_a_second_is_a_step(size, steps):
    """4.5 times the root of twice 0.04² m²/s² are 0.2546 m/s; wind is hardly in doubt any more."""
    estimator = hover(30.0)
    estimator.update(told(0.1, [0.0, -size, 0.0]), flying=True)
    assert (estimator.step is not None) is steps


@pytest.mark.parametrize(("gap", "steps"), [(0.24, True), (0.26, False), (0.0, False)])
def test_states_more_than_a_quarter_of_a_second_apart_do_not_belong_together(gap, steps):
    estimator = hover()
    estimator.update(told(gap, [2.0, 0.0, 0.0]), flying=True)
    assert (estimator.step is not None) is steps


@pytest.mark.parametrize(
    ("climb", "steps"), [(0.95, True), (1.0, False), (-0.65, True), (-0.72, False)]
)
def test_a_lift_beyond_three_tenths_and_two_of_the_weight_tells_no_acceleration(climb, steps):
    """climb: of g, upwards, in the tenth of a second of the step."""
    estimator = hover()
    estimator.update(told(0.1, [2.0, 0.0, 0.1 * GRAVITY * climb + 1e-9]), flying=True)
    assert (estimator.step is not None) is steps


@pytest.mark.parametrize("axis", [0, 1])
def test_an_acceleration_that_the_tilt_explains_is_no_step(axis):
    """Leaning by 0.4 rad, it gains 0.41 m/s in a tenth of a second, without climbing."""
    half = 0.2
    q = [np.cos(half), -np.sin(half), 0.0, 0.0] if axis else [np.cos(half), 0, np.sin(half), 0]
    gained = 0.1 * GRAVITY * np.tan(0.4) * np.eye(3)[axis]
    for v, steps in ((gained, False), (-gained, True)):
        estimator = VelocityLag()
        estimator.update(told(0.0, q=q), flying=True)
        estimator.update(told(0.1, v, q), flying=True)
        assert (estimator.step is not None) is steps


def test_after_a_break_the_motion_is_forgotten_and_the_lag_is_not():
    estimator = VelocityLag()
    for own, _ in flight(0.14, noise=0.0):
        found = estimator.update(own, flying=True)
    assert np.linalg.norm(found.position) > 0.01
    after = estimator.update(None, flying=True)
    assert after.value == pytest.approx(0.14, abs=0.03)
    assert not after.position.any()


def test_what_a_lag_misses_is_the_motion_of_the_last_half_second_times_the_lag():
    estimator, slow, before = VelocityLag(), np.zeros(3), None
    for own, _ in flight(0.14, noise=0.0, seconds=20.0):
        found = estimator.update(own, flying=True)
        if before is not None:
            slow += (1.0 - np.exp(-0.1 / 0.5)) * (own.v - slow)
        before = own
    assert found.position == pytest.approx(found.value * slow)


def test_no_lag_of_more_than_three_tenths_of_a_second_is_made_up_for():
    estimator = VelocityLag()
    values = [estimator.update(own, flying=True).value for own, _ in flight(0.6, 15.0, noise=0.0)]
    assert max(values) == 0.3
    assert values[-1] == 0.3


def test_a_lag_is_believed_from_two_and_a_half_standard_deviations_on():
    estimator, ratios = VelocityLag(), []
    for own, _ in flight(0.08):
        found = estimator.update(own, flying=True)
        if found.value:
            ratios.append(found.value / found.sigma)
    assert 2.5 <= min(ratios) < 2.8


def test_a_lag_of_less_than_three_hundredths_of_a_second_does_no_harm():
    estimator = VelocityLag()
    for own, _ in flight(0.02, 20.0, noise=0.0):
        found = estimator.update(own, flying=True)
        assert found.value == 0.0 or found.value >= 0.03
    assert found.value == 0.0
    assert not found.position.any()


def manoeuvre(lag, drag, wind, seconds=2.0):
    """States of a drone that leans over to and fro, exactly as the model tells, from rest.

    Return them with the means of the slow acceleration and velocity (2,) at the end, and of each
    tick the changes (2,) that the tilt does not explain and what they may come of (2,4).
    """
    states, unexplained, causes = [told(0.0)], [], []
    v, slow_a, slow_v, before = np.zeros(2), np.zeros(2), np.zeros(2), np.array([0.0, 0.0, 1.0])
    share = 1.0 - np.exp(-0.1 / 0.5)
    for k in range(1, round(10 * seconds) + 1):
        lean = [0.4 * np.sin(0.9 * k), 0.25 * np.cos(0.7 * k)]
        x, y, z, w = Rotation.from_euler("xy", lean).as_quat()
        up = Rotation.from_quat([x, y, z, w]).apply([0.0, 0.0, 1.0])
        a = GRAVITY * (before + up)[:2] / (before + up)[2]
        change = share * (a - slow_a)
        last, v = v, (v + 0.1 * (a + wind) - lag * change) / (1.0 + 0.1 * drag)
        slow_a, slow_v, before = slow_a + change, slow_v + share * (v - slow_v), up
        states.append(told(0.1 * k, [*v, 0.0], [w, x, y, z]))
        unexplained.append(v - last - 0.1 * a)
        causes.append(np.column_stack([-change, -0.1 * v, 0.1 * np.eye(2)]))
    return states, slow_a, slow_v, np.concatenate(unexplained), np.concatenate(causes)


@pytest.mark.parametrize(("drag", "wind"), [(0.3, (0.6, -0.3)), (0.0, (-0.5, 0.0))])
def test_lag_drag_and_wind_are_those_of_least_squares(drag, wind):
    """1 σ before: 0.1 s, 0.3 1/s, 0.5 m/s²; of a change of velocity 0.04 m/s."""
    states, slow_a, slow_v, unexplained, causes = manoeuvre(0.2, drag, np.array(wind))
    estimator = VelocityLag()
    for state in states:
        found = estimator.update(state, flying=True)
        assert estimator.step is None
    rows = np.concatenate([causes / 0.04, np.diag(1.0 / np.array([0.1, 0.3, 0.5, 0.5]))])
    least, *_ = np.linalg.lstsq(rows, np.concatenate([unexplained / 0.04, np.zeros(4)]))
    assert found.value == pytest.approx(least[0], abs=0.001)
    assert found.sigma == pytest.approx(np.linalg.inv(rows.T @ rows)[0, 0] ** 0.5, rel=0.05)
    assert found.position == pytest.approx([*(found.value * slow_v), 0.0])
    gained = slow_a + least[2:] - least[1] * states[-1].v[:2]
    assert found.velocity == pytest.approx([*(found.value * gained), 0.0], abs=0.012)


def test_no_change_of_velocity_is_surer_after_a_long_hover():
    """What is known of the lag is of the two seconds after it: 1 σ of 0.04 m/s each."""
    states, *_, causes = manoeuvre(0.2, 0.0, np.zeros(2))
    estimator = hover(60.0)
    for state in states[1:]:
        found = estimator.update(state, flying=True)
    rows = np.concatenate([causes / 0.04, np.diag([0.0, 0.0, 2.0, 2.0])])
    assert found.sigma == pytest.approx(np.linalg.inv(rows.T @ rows)[0, 0] ** 0.5, rel=0.1)


@pytest.mark.parametrize(("seconds", "sigma"), [(20.0, 0.1 * np.exp(0.5)), (90.0, 0.5)])
def test_what_is_known_of_the_lag_is_forgotten_within_20_s_down_to_a_doubt_of_half_a_second(
    seconds, sigma
):
    assert hover(seconds).lag.sigma == pytest.approx(sigma, rel=0.005)


@pytest.mark.parametrize(("size", "steps"), [(0.51, False), (0.57, True)])
def test_a_velocity_that_shakes_takes_a_larger_step(size, steps):
    """To and fro by 0.15 m/s on both axes for 2 s, of 10 s in which both make up the noise.

    So 0.82 · 0.04² + 0.18 · 0.15² m²/s² an axis, and the drag that was mistaken for some of it.
    """
    estimator = hover()
    for k in range(1, 21):
        estimator.update(told(0.1 * k, [0.075 * (-1) ** k, -0.075 * (-1) ** k, 0.0]), flying=True)
        assert estimator.step is None
    estimator.update(told(2.1, [0.075, size - 0.075, 0.0]), flying=True)
    assert (estimator.step is not None) is steps


def wind_after(gust):
    """Wind [m/s²] north that is learnt from one change of velocity by a gust after a hover."""
    estimator = hover(30.0)
    estimator.update(told(0.1, [0.0, gust, 0.0]), flying=True)
    assert estimator.step is None
    estimator.corrected(told(0.1, [0.0, 2.0, 0.0]))
    estimator.update(told(0.2), flying=True)  # at a standstill, without drag
    return -(estimator.step.change[1] + 2.0) / 0.1


def test_a_gust_beyond_three_standard_deviations_counts_as_three():
    """Of 0.04 m/s, and a little for wind: 0.12 to 0.13 m/s."""
    assert wind_after(-0.1) == pytest.approx(-wind_after(0.1))
    for gust in (0.15, 0.23):
        assert wind_after(gust) / wind_after(0.06) == pytest.approx(0.125 / 0.06, rel=0.05)


def test_a_change_from_the_ground_into_the_air_counts():
    estimator = VelocityLag()
    estimator.update(told(0.0), flying=False)
    estimator.update(told(0.1, [2.0, 0.0, 0.0]), flying=True)
    assert estimator.step is not None
    assert estimator.step.since == 0.0
