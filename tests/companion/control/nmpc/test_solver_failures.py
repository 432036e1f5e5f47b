"""Solvers that fail: numbers that are not finite or lead nowhere, and Ctrl-C in the reference."""

import dataclasses
import os
import signal
import threading

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from companion.control.nmpc import Neighbour, Nmpc
from companion.control.nmpc.ipopt import IpoptNmpc
from companion.model import HOVER
from companion.types import PlanStatus
from tests.companion.control.nmpc.scenes import CONFIG, random_scene, scene


@pytest.mark.parametrize("field", ["x0", "u_last", "goal", "yaw", "speed", "cylinders", "planes"])
def test_an_instance_that_is_not_finite_gives_the_shifted_plan(field, solver):
    good = random_scene(7)
    before = solver.solve(good)
    value = np.asarray(getattr(good, field), dtype=float).copy()
    value.flat[0] = np.nan
    bad = dataclasses.replace(good, **{field: value if value.ndim else float(value)})
    result = solver.solve(bad)
    assert result.status is PlanStatus.NOT_FINITE
    assert not result.usable
    np.testing.assert_array_equal(result.u[:-1], before.u[1:])
    assert np.isfinite(result.x).all()
    assert solver.solve(good).usable


def test_a_first_instance_that_is_not_finite_gives_hover(solver):
    result = solver.solve(scene(x0=np.full(10, np.nan)))
    assert not result.usable
    np.testing.assert_array_equal(result.u, np.tile(HOVER, (CONFIG.N, 1)))


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_the_solver_never_raises_and_all_numbers_are_finite(data):
    numbers = st.floats(width=32)
    vector = lambda n: data.draw(st.lists(numbers, min_size=n, max_size=n))  # noqa: E731
    instance = scene(
        x0=vector(10),
        u_last=vector(4),
        goal=vector(3),
        yaw=data.draw(numbers),
        cylinders=[vector(3)],
        planes=[vector(4)],
        neighbours=[Neighbour(vector(3), vector(3), tuple(vector(2)))],
    )
    for nmpc in FUZZED:
        result = nmpc.solve(instance)
        assert np.isfinite(result.x).all()
        assert np.isfinite(result.u).all()
        assert np.isfinite([result.cost, result.slack_agent, result.step_norm]).all()


FUZZED = (Nmpc(CONFIG), Nmpc(CONFIG, compiled=False))


def test_a_tick_whose_last_plan_leads_nowhere_starts_anew():
    nmpc, instance = Nmpc(CONFIG), scene()
    cold = nmpc.solve(instance)
    nmpc._plan = tuple(np.full_like(part, 1e200) for part in nmpc._plan)
    assert nmpc.solve(instance).cost == pytest.approx(cold.cost, rel=1e-6)


def test_ctrl_c_in_the_reference_solver_is_no_failed_solve():
    """CasADi catches the signal in its native loop and would report an infeasible problem."""
    solver, instance = IpoptNmpc(CONFIG), scene()

    def solve_again_and_again():
        for _ in range(1000):
            solver.reset()
            solver.solve(instance)

    threading.Timer(0.3, os.kill, [os.getpid(), signal.SIGINT]).start()
    with pytest.raises(KeyboardInterrupt):
        solve_again_and_again()
