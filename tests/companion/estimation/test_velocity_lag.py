"""The lag of a reported velocity, from motions whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from companion.estimation.velocity_lag import VelocityLag
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
