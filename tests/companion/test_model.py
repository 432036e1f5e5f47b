"""The model: the CasADi twins agree, the physics holds, prediction composes."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.control.nmpc.casadi_model import casadi_f, casadi_step
from companion.model import HOVER, f, normalise, observed_disturbance, predict, step, yaw_of
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import multiply, quaternion_from_euler, rotation_matrix


def random_state(rng, n=None):
    x = rng.normal(size=10 if n is None else (n, 10))
    x[..., 6:10] = normalise(x[..., 6:10])
    return x


def level(yaw):
    return quaternion_from_euler(0.0, 0.0, yaw)


def random_input(rng):
    return np.concatenate([rng.uniform(2, 20, 1), rng.uniform(-3, 3, 3)])


@given(st.integers(0, 10_000))
def test_numpy_equals_casadi(seed):
    rng = np.random.default_rng(seed)
    x, u, d = random_state(rng), random_input(rng), rng.normal(size=3)
    symbols = [ca.SX.sym("x", 10), ca.SX.sym("u", 4), ca.SX.sym("d", 3)]
    rate = ca.Function("f", symbols, [casadi_f(*symbols)])
    after = ca.Function("s", symbols, [casadi_step(symbols[0], symbols[1], 0.1, symbols[2])])
    np.testing.assert_allclose(np.array(rate(x, u, d)).ravel(), f(x, u, d), atol=1e-12)
    np.testing.assert_allclose(np.array(after(x, u, d)).ravel(), step(x, u, 0.1, d), atol=1e-12)


@pytest.mark.parametrize("yaw", [-3.0, 0.0, 1.2])
def test_a_hovering_drone_stays(yaw):
    x = np.concatenate([[1, 2, 3], np.zeros(3), level(yaw)])
    np.testing.assert_allclose(predict(x, HOVER, 3.0), x, atol=1e-12)
    assert yaw_of(x[6:10]) == pytest.approx(yaw)


def test_free_fall():
    x = np.concatenate([np.zeros(3), [1, 0, 2], level(0.3)])
    later = predict(x, np.zeros(4), 1.0)
    np.testing.assert_allclose(later[:3], [1, 0, 2 - GRAVITY / 2], atol=1e-9)
    np.testing.assert_allclose(later[3:6], [1, 0, 2 - GRAVITY], atol=1e-9)


def test_positive_rates_turn_as_in_flu():
    """Positive roll rate leans right (y falls), pitch leans forward, yaw turns left: FLU."""
    rest = np.concatenate([np.zeros(6), level(0.0)])
    roll = predict(rest, np.array([GRAVITY, 1.0, 0, 0]), 0.3)
    pitch = predict(rest, np.array([GRAVITY, 0, 1.0, 0]), 0.3)
    turn = predict(rest, np.array([GRAVITY, 0, 0, 1.0]), 0.3)
    assert roll[4] < -0.1
    assert pitch[3] > 0.1
    assert yaw_of(turn[6:10]) == pytest.approx(0.3)


def test_constant_rotation_is_exact():
    x = np.concatenate([np.zeros(6), level(0.0)])
    omega = np.array([0.5, -1.0, 2.0])
    later = predict(x, np.concatenate([[GRAVITY], omega]), 1.0)
    angle = np.linalg.norm(omega)
    exact = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * omega / angle])
    np.testing.assert_allclose(later[6:10], exact, atol=1e-6)


def test_rk4_is_of_fourth_order():
    rng = np.random.default_rng(2)
    x, u = random_state(rng), random_input(rng)
    exact = x
    for _ in range(1000):
        exact = step(exact, u, 1e-4)

    def error(n):
        y = x
        for _ in range(n):
            y = step(y, u, 0.1 / n)
        return np.abs(np.subtract(y, exact)).max()

    assert error(1) < 1e-4
    assert 12 < error(1) / error(2) < 20


@given(st.integers(0, 10_000), st.floats(-np.pi, np.pi))
def test_the_model_is_the_same_in_every_heading(seed, yaw):
    """A state turned about the vertical axis is predicted as the turned prediction."""
    rng, turn = np.random.default_rng(seed), level(yaw)
    x, u = random_state(rng), random_input(rng)

    def turned(state):
        r = rotation_matrix(turn)
        return np.concatenate([r @ state[:3], r @ state[3:6], multiply(turn, state[6:10])])

    np.testing.assert_allclose(predict(turned(x), u, 0.1), turned(predict(x, u, 0.1)), atol=1e-9)


def test_prediction_composes_and_may_be_empty():
    rng = np.random.default_rng(3)
    x, u = random_state(rng), random_input(rng)
    np.testing.assert_allclose(predict(x, u, 0.0), x, atol=1e-15)
    two = predict(predict(x, u, 0.05), u, 0.1)
    np.testing.assert_allclose(two, predict(x, u, 0.15), atol=1e-12)
    assert np.linalg.norm(predict(x, u, 1.7)[6:10]) == pytest.approx(1.0, abs=1e-12)


def test_normalise_of_zero_is_the_identity():
    np.testing.assert_allclose(normalise(np.zeros(4)), [1, 0, 0, 0])


def test_the_disturbance_is_found():
    """With the estimate, the model's error by drag and wind goes away."""
    truth, estimate = np.array([0.4, -0.3, 0.2]), np.zeros(3)
    x = np.concatenate([np.zeros(6), level(0.0)])
    for _ in range(60):
        after = predict(x, HOVER, 0.1, truth)
        expected = predict(x, HOVER, 0.1, estimate)
        estimate = observed_disturbance(estimate, expected[3:6], after[3:6], 0.1)
        x = after
    np.testing.assert_allclose(estimate, truth, atol=2e-3)


def test_a_broken_estimate_of_the_disturbance_is_bounded():
    bad = observed_disturbance(np.zeros(3), np.zeros(3), np.array([np.nan, 1e9, -1e9]), 0.1)
    assert np.all(np.abs(bad) <= 3.0)
