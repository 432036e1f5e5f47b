"""The problem's functions: derivatives, majorisation, the program against the functions."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from companion.control.nmpc.costs import Term, blind_motion
from companion.control.nmpc.layout import LOCAL
from companion.control.nmpc.parameters import ParameterVectors, weight_numbers, weight_symbols
from companion.control.nmpc.problem import build_stage
from companion.model import NU, NX
from tests.companion.control.nmpc.scenes import CONFIG, random_scene

STAGE = build_stage(CONFIG)


def arguments(instance, k, rng):
    vectors = ParameterVectors(CONFIG)
    vectors.fill(instance)
    x = instance.x0 - np.r_[instance.x0[:3], np.zeros(7)] + rng.normal(0, 0.2, NX)
    after = x + rng.normal(0, 0.1, NX)
    u = instance.u_last + rng.normal(0, 0.5, NU)
    return [
        x,
        instance.u_last,
        u,
        after,
        vectors.stages[k],
        vectors.scene,
        weight_numbers(CONFIG),
    ]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("k", [0, 7, 19])
def test_linearisation_against_finite_differences(seed, k):
    given = arguments(random_scene(seed), k, np.random.default_rng(seed))
    column = np.array(STAGE.linearise(*given)).ravel()
    local = np.concatenate(given[:4])
    lengths = np.cumsum([NX, NU, NU])

    def evaluate(z):
        out = STAGE.evaluate(*np.split(z, lengths), *given[4:])
        return [np.array(o).ravel() for o in out]

    reached, _, margins = evaluate(local)
    np.testing.assert_allclose(
        column[STAGE.gap.offset : STAGE.gap.offset + NX], reached - given[3], atol=1e-12
    )
    h = 1e-6
    differences = [
        [(a - b) / (2 * h) for a, b in zip(evaluate(local + e), evaluate(local - e), strict=True)]
        for e in np.eye(LOCAL) * h
    ]
    gradient = np.array([d[1][0] for d in differences])
    np.testing.assert_allclose(
        column[STAGE.gradient.offset :][:LOCAL], gradient, atol=1e-6, rtol=1e-5
    )
    dynamics = np.zeros((NX, NX + NU))
    dynamics[STAGE.dynamics.rows, STAGE.dynamics.columns] = column[STAGE.dynamics.offset :][
        : len(STAGE.dynamics.rows)
    ]
    by_x = np.array([d[0] for d in differences[:NX]]).T
    by_u = np.array([d[0] for d in differences[NX + NU : NX + 2 * NU]]).T
    np.testing.assert_allclose(dynamics, np.hstack([by_x, by_u]), atol=1e-7)
    slope = np.zeros((len(margins), 3))
    slope[STAGE.slope.rows, STAGE.slope.columns] = column[STAGE.slope.offset :][
        : len(STAGE.slope.rows)
    ]
    by_p = np.array([d[2] for d in differences[-NX:][:3]]).T
    np.testing.assert_allclose(slope, by_p, atol=1e-6)


def test_curvature_majorises_a_norm():
    """At any step the quadratic model lies above the term and touches it at the iterate."""
    r = ca.SX.sym("r", 3)
    term = Term(r, ca.SX(0.7), ca.SX(0.3))
    value = ca.Function("v", [r], [term.value()])
    curvature = ca.Function("c", [r], [term.curvature()])
    rng = np.random.default_rng(0)
    for _ in range(200):
        here, step = rng.normal(0, 1, 3), rng.normal(0, 2, 3)
        h = float(curvature(here))
        model = float(value(here)) + h * here @ step + 0.5 * h * step @ step
        assert model >= float(value(here + step)) - 1e-12


def test_curvature_of_a_hinge_is_at_least_its_own():
    """For the hinge of the blind side, pressed or not: the solver's steps rest on it."""
    v, sight = ca.SX.sym("v", 3), ca.SX.sym("sight", 2)
    weights, w = weight_symbols()
    term = blind_motion(v, SimpleNamespace(sight=sight), w)
    hessian = ca.Function("h", [v, sight, weights], [term.hessian(v)])
    value = ca.Function("v", [v, sight, weights], [term.value()])
    numbers = weight_numbers(CONFIG)
    rng = np.random.default_rng(0)
    pressed = 0
    for _ in range(200):
        speed, step = (np.append(rng.normal(0, 1, 2), 0.0) for _ in range(2))
        yaw, h = rng.uniform(-np.pi, np.pi), 1e-4
        look = np.array([np.cos(yaw), np.sin(yaw)])
        before, here, after = (float(value(speed + s * step, look, numbers)) for s in (-h, 0.0, h))
        model = float(step @ np.array(hessian(speed, look, numbers)) @ step)
        assert model >= (before - 2 * here + after) / h**2 - 1e-2
        pressed += here > 0.1
    assert pressed > 50


def test_position_and_velocity_are_a_double_integrator():
    """The kernel knows these columns of [A B], and multiplies by the others alone."""
    vectors = arguments(random_scene(5), 3, np.random.default_rng(5))
    entries = np.array(STAGE.linearise(*vectors)).ravel()[STAGE.dynamics.offset :]
    dynamics = np.zeros((NX, NX + NU))
    rows, columns = STAGE.dynamics.rows, STAGE.dynamics.columns
    dynamics[rows, columns] = entries[: len(rows)]
    eye = np.eye(3)
    integrator = np.block([[eye, CONFIG.dt * eye], [0 * eye, eye], [np.zeros((4, 6))]])
    np.testing.assert_allclose(dynamics[:, :6], integrator, atol=1e-12)
