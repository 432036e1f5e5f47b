"""The real-time solver: optimum, constraints, symmetry, fixed points, failures."""

import dataclasses
import os
import signal
import threading
from unittest import mock

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from companion.control.nmpc import Neighbour, Nmpc, NmpcConfig, make_instance
from companion.control.nmpc.instance_file import load, stored
from companion.control.nmpc.ipopt import IpoptNmpc
from companion.model import HOVER, yaw_of
from companion.types import PlanStatus
from tests.companion.control.nmpc.scenes import CONFIG, NAMED, random_scene, scene, state

EVERY = [*NAMED, *range(12)]
RECORDED = load(stored(), CONFIG)


def instance_of(name):
    return scene(**NAMED[name]) if isinstance(name, str) else random_scene(name)


def again(nmpc, instance):
    """One more solve at the same tick: the previous plan is not shifted."""
    with mock.patch("companion.control.nmpc.rti.shifted", lambda plan, dt: plan):
        return nmpc.solve(instance)


def check_bounds(instance, result, config=CONFIG):
    """Check that a plan is finite and within every bound of the input and of its change."""
    assert np.isfinite(result.x).all()
    assert np.isfinite(result.u).all()
    assert config.c_min <= result.u[:, 0].min()
    assert result.u[:, 0].max() <= config.c_max
    assert np.abs(result.u[:, 1:]).max() <= config.omega_max
    changes = np.abs(np.diff(result.u, axis=0, prepend=instance.u_last[None]))
    assert changes[:, 0].max() <= config.delta_c_max
    assert changes[:, 1:].max() <= config.delta_omega_max


@pytest.fixture(scope="module", params=["compiled", "virtual machine"])
def converging(request, thorough):
    return Nmpc(thorough, compiled=request.param == "compiled")


@pytest.mark.parametrize("name", EVERY)
def test_the_converged_plan_is_the_optimum(name, converging, reference):
    check_optimum(converging, reference, instance_of(name))


@pytest.mark.parametrize("number", range(0, len(RECORDED), 3))
def test_the_converged_plan_is_the_optimum_of_recorded_instances(number, thorough, reference):
    nmpc = Nmpc(thorough)
    for instance in RECORDED[number].instances[::3]:
        check_optimum(nmpc, reference, instance)


@pytest.mark.slow
def test_the_converged_plan_is_the_optimum_of_all_recorded_instances(thorough, reference):
    nmpc = Nmpc(thorough)
    for run in RECORDED:
        for instance in run.instances:
            check_optimum(nmpc, reference, instance)


def check_optimum(nmpc, reference, instance):
    """Check that the real-time solver, from cold, finds the optimum that IPOPT finds next to it."""
    nmpc.reset()
    result = nmpc.solve(instance)
    reference.guess((result.x, result.u))
    optimum = reference.solve(instance)
    assert result.status is optimum.status is PlanStatus.SOLVED
    assert result.cost == pytest.approx(optimum.cost, rel=5e-5, abs=1e-4)
    np.testing.assert_allclose(result.x[:, :3], optimum.x[:, :3], atol=5e-3)


@pytest.mark.parametrize("name", EVERY)
def test_plan_keeps_its_bounds(name, solver):
    instance = instance_of(name)
    for _ in range(3):
        result = solver.solve(instance)
        assert result.usable
        check_bounds(instance, result)
        np.testing.assert_allclose(result.x[0, :6], instance.x0[:6], atol=1e-12)


def test_hover_is_a_fixed_point(solver):
    for yaw in (0.0, 2.5, -3.1):
        instance = scene(x0=state(yaw=yaw), goal=(0, 0, 2), yaw=yaw)
        solver.reset()
        result = solver.solve(instance)
        np.testing.assert_allclose(result.u, np.tile(HOVER, (CONFIG.N, 1)), atol=1e-5)
        np.testing.assert_allclose(result.x[-1], instance.x0, atol=1e-5)


def test_hover_in_wind_leans_into_it(solver):
    """With the disturbance known, the plan ends at the goal."""
    result = solver.solve(scene(**NAMED["windy"]))
    np.testing.assert_allclose(result.x[-1, :3], (0, 0, 2), atol=0.03)


def test_steps_shrink_where_a_plan_presses_on_a_hinge():
    """Braking from twice v_max: without the hinge's whole curvature, full steps cycle."""
    instance, norms = instance_of("fast"), []
    nmpc = Nmpc(CONFIG)
    for _ in range(12):
        norms.append(again(nmpc, instance).step_norm)
    assert norms[-1] < 1e-2 < norms[0]


@pytest.mark.parametrize(
    ("name", "constraint"),
    [
        ("head-on", "agent"),
        ("dead ahead", "cylinder"),
        ("wall", "plane"),
        ("behind", "delta_omega"),
        ("tilted", "delta_c"),
        ("tilted", "omega"),
        ("fast", "v_max"),
    ],
)
def test_each_constraint_is_active_somewhere(name, constraint, solver):
    result = solver.solve(instance_of(name))
    assert constraint in result.active
    assert max(result.slack_agent, result.slack_obstacle, result.slack_plane) < 0.01


def test_thrust_bound_is_active():
    config = NmpcConfig(c_min=8.0)
    falling = scene(config, x0=state(v=(0, 0, 3)), goal=(0, 0, -20))
    nmpc = Nmpc(config)
    for _ in range(5):
        result = nmpc.solve(falling)
    assert "c" in result.active
    check_bounds(falling, result, config)


@pytest.mark.parametrize(
    ("name", "which"), [("too near", "slack_agent"), ("inside", "slack_obstacle")]
)
def test_a_plan_leads_out_of_a_safety_radius(name, which, solver):
    instance = instance_of(name)
    result = solver.solve(instance)
    assert result.usable
    assert getattr(result, which) > 0.1
    check_bounds(instance, result)
    if name == "inside":
        away = np.linalg.norm(result.x[:, :2] - instance.cylinders[0, :2], axis=1)
    else:
        k = np.arange(CONFIG.N + 1)[:, None] * CONFIG.dt
        other = instance.neighbour_p[0] + k * instance.neighbour_v[0]
        away = np.linalg.norm(result.x[:, :3] - other, axis=1)
    assert away[12] > min(away[0] + 0.3, CONFIG.d_agent_safety - 1e-3)


def test_penalty_is_exact():
    """Where a way exists, no slack is used: the L1 penalty is above every multiplier."""
    config = NmpcConfig(sqp_iterations_cold=60)
    result = Nmpc(config).solve(scene(config, **NAMED["cylinder"]))
    assert result.slack_obstacle < 1e-5


def mirrored(instance):
    """The world in a mirror: y and all turns about x or z change sign."""
    y = np.array([1.0, -1.0, 1.0])
    x0 = instance.x0 * np.r_[y, y, 1, -1, 1, -1]
    return dataclasses.replace(
        instance,
        x0=x0,
        u_last=instance.u_last * np.array([1, -1, 1, -1]),
        goal=instance.goal * y,
        yaw=-instance.yaw,
        neighbour_p=instance.neighbour_p * y,
        neighbour_v=instance.neighbour_v * y,
        cylinders=instance.cylinders * y,
        planes=instance.planes * np.r_[y, 1],
        disturbance=instance.disturbance * y,
    )


@pytest.mark.parametrize("name", ["cylinder", "side by side", "too near", "tilted", 0, 1, 2, 3])
def test_a_mirrored_world_has_a_mirrored_plan(name):
    config = CONFIG.model_copy(update={"tie_break": 0.0})
    instance = instance_of(name)
    here = Nmpc(config).solve(instance)
    there = Nmpc(config).solve(mirrored(instance))
    np.testing.assert_allclose(there.u * np.array([1, -1, 1, -1]), here.u, atol=2e-4)


def test_a_moved_world_has_a_moved_plan():
    shift = np.array([300.0, -200.0, 10.0])
    instance = random_scene(4)
    moved = dataclasses.replace(
        instance,
        x0=instance.x0 + np.r_[shift, np.zeros(7)],
        goal=instance.goal + shift,
        neighbour_p=instance.neighbour_p + shift,
        cylinders=instance.cylinders + np.r_[shift[:2], 0],
        planes=instance.planes + np.c_[np.zeros((6, 3)), instance.planes[:, :3] @ shift],
    )
    here, there = Nmpc(CONFIG).solve(instance), Nmpc(CONFIG).solve(moved)
    np.testing.assert_allclose(there.u, here.u, atol=1e-6)


def test_the_sign_of_the_quaternion_has_no_effect(solver):
    """Telemetry that flips the sign between two ticks changes no plan."""
    instance = random_scene(5)
    first = solver.solve(instance)
    flipped = dataclasses.replace(instance, x0=instance.x0 * np.r_[np.ones(6), -np.ones(4)])
    repeated = again(solver, flipped)
    solver.reset()
    solver.solve(instance)
    same = again(solver, instance)
    assert first.usable
    np.testing.assert_allclose(repeated.u, same.u, atol=1e-6)
    np.testing.assert_allclose(repeated.x[:, 6:10], -same.x[:, 6:10], atol=1e-6)


def test_dead_ahead_is_passed_on_the_right(solver):
    """In the exact tie the plan goes round instead of braking."""
    instance = scene(x0=state(v=(1.5, 0, 0)), cylinders=[(3.2, 0, 1)])
    for _ in range(20):
        result = again(solver, instance)
    assert result.x[-1, 1] < -0.1
    assert result.slack_obstacle < 0.01


def test_inactive_rows_have_no_effect(solver):
    instance = random_scene(6)
    one = solver.solve(instance)
    solver.reset()
    noise = dataclasses.replace(
        instance,
        cylinders=instance.cylinders + (1 - instance.cylinder_active)[:, None] * 0.3,
        planes=instance.planes + (1 - instance.plane_active)[:, None] * 0.1,
    )
    np.testing.assert_array_equal(solver.solve(noise).u, one.u)


def test_neighbours_without_cohesion_only_repel(solver):
    far = [Neighbour((0, 4, 2), (0, 0, 0), cohesion=0.0)]
    free = solver.solve(scene())
    solver.reset()
    np.testing.assert_allclose(solver.solve(scene(neighbours=far)).u, free.u, atol=5e-3)
    solver.reset()
    drawn = solver.solve(scene(neighbours=[far[0]._replace(cohesion=1.0)]))
    assert drawn.x[5, 1] > free.x[5, 1] + 1e-3


def test_lists_of_any_length_are_cut_and_padded():
    many = [Neighbour((i, i, 2), (0, 0, 0)) for i in range(2, 12)]
    instance = make_instance(
        CONFIG,
        x0=state(),
        u_last=HOVER,
        goal=(1, 0, 2),
        yaw=0.0,
        neighbours=many,
        cylinders=np.arange(60.0).reshape(20, 3),
    )
    assert instance.neighbour_active.sum() == CONFIG.neighbours == 8
    assert instance.cylinder_active.sum() == 8
    assert instance.plane_active.sum() == 0
    np.testing.assert_array_equal(instance.neighbour_p[2], (4, 4, 2))
    assert instance.speed == CONFIG.speed


def test_the_same_instances_give_the_same_bytes():
    def plans():
        nmpc = Nmpc(CONFIG)
        return [nmpc.solve(random_scene(seed % 4)).u.tobytes() for seed in range(8)]

    assert plans() == plans()


def test_both_paths_agree(thorough):
    fast, slow = Nmpc(thorough), Nmpc(thorough, compiled=False)
    for seed in (0, 1, 3, 4, 6, 7):
        instance = random_scene(seed)
        fast.reset()
        slow.reset()
        a, b = fast.solve(instance), slow.solve(instance)
        assert a.cost == pytest.approx(b.cost, rel=1e-5)


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


def test_the_clock_is_read_for_the_solve_time_alone():
    times = iter(np.arange(0.0, 100.0, 0.25))
    result = Nmpc(CONFIG, clock=lambda: float(next(times))).solve(scene())
    assert result.solve_time == 0.25


def test_yaw_is_followed_while_flying():
    instance = scene(x0=state(v=(1.5, 0, 0)), yaw=0.6)
    result = Nmpc(CONFIG).solve(instance)
    assert yaw_of(result.x[-1, 6:10]) == pytest.approx(0.6, abs=0.1)
    assert np.linalg.norm(result.x[:, 3:6], axis=1).min() > 1.4


@pytest.mark.parametrize("limit", [CONFIG.work_max, 40])
def test_the_work_of_a_tick_is_bounded(limit):
    """In all recorded ticks, cold and warm, only the last step may be harder than expected."""
    for gain in (0.0, 0.7):
        nmpc, most = Nmpc(NmpcConfig(work_max=limit, route_gain=gain)), 0
        for run in RECORDED:
            nmpc.reset()
            for instance in run.instances:
                assert nmpc.solve(instance).usable
                most = max(most, nmpc._work.done)
        if gain == 0.0:
            assert limit - 20 < most < limit + 20
        else:  # two plans in a tick
            assert limit + 20 < most < 2 * (limit + 20)


def test_a_rival_of_a_tick_before_a_failure_is_forgotten():
    nmpc, config = Nmpc(NmpcConfig(w_short=0.0)), NmpcConfig(w_short=0.0)
    for k in range(3):
        nmpc.solve(comer(config, k))
    assert nmpc._rival is not None
    broken = dataclasses.replace(comer(config, 3), yaw=np.nan)
    assert nmpc.solve(broken).status is PlanStatus.NOT_FINITE
    assert nmpc._rival is None


def test_a_tick_whose_last_plan_leads_nowhere_starts_anew():
    nmpc, instance = Nmpc(CONFIG), scene()
    cold = nmpc.solve(instance)
    nmpc._plan = tuple(np.full_like(part, 1e200) for part in nmpc._plan)
    assert nmpc.solve(instance).cost == pytest.approx(cold.cost, rel=1e-6)


def comer(config, tick, aside=0.1):
    """One that comes at a drone at rest, which stands between it and two others."""
    p = (2.2 - config.dt * tick, aside, 2.0)
    others = [Neighbour((0.3, -0.9, 2.0), np.zeros(3)), Neighbour((-0.6, -0.9, 2.0), np.zeros(3))]
    at_rest = [0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    return make_instance(
        config,
        x0=at_rest,
        u_last=HOVER,
        goal=[8.0, 0.0, 2.0],
        yaw=0.0,
        speed=0.5,
        v_max=1.0,
        neighbours=[Neighbour(p, (-1.0, 0.0, 0.0)), *others],
    )


def test_who_comes_too_near_is_passed_on_its_other_side_where_that_is_cheaper():
    with_route, without = NmpcConfig(w_short=0.0), NmpcConfig(w_short=0.0, route_gain=0.0)
    plans, stuck = ([] for _ in range(2))
    for config, kept in ((with_route, plans), (without, stuck)):
        nmpc = Nmpc(config)
        kept += [nmpc.solve(comer(config, k)) for k in range(6)]
    assert [p.slack_agent > 0.1 for p in stuck] == [False, False, True, True, True, True]
    assert [p.cost for p in plans[:3]] == [p.cost for p in stuck[:3]]
    best = IpoptNmpc(with_route)
    for k in (3, 4, 5):  # the tick after the first that is too near, and on
        best.guess((plans[k].x, plans[k].u))
        assert plans[k].cost <= 1.02 * best.solve(comer(with_route, k)).cost
        assert plans[k].cost < 0.35 * stuck[k].cost
        assert plans[k].slack_agent < 0.05


def test_a_route_that_is_no_cheaper_is_not_taken():
    costs = []
    for config in (NmpcConfig(w_short=0.0), NmpcConfig(w_short=0.0, route_gain=0.0)):
        nmpc = Nmpc(config)
        plans = [nmpc.solve(comer(config, k, aside=0.3)) for k in range(6)]
        assert plans[-1].slack_agent > 0.15  # so the other side was looked at
        costs.append([p.cost for p in plans])
    assert costs[0] == costs[1]


def test_another_side_is_across_the_way_of_a_neighbour_or_its_bearing():
    instance = comer(CONFIG, 0)
    on_left = instance.past_other_side(0, np.array([0.0, -0.2, 2.0]), 2.2, 0.5)
    on_right = instance.past_other_side(0, np.array([0.0, 0.2, 2.0]), 2.2, 0.5)
    assert on_left.neighbour_p[0] == pytest.approx([2.2, -0.4, 2.0])
    assert on_right.neighbour_p[0] == pytest.approx([2.2, 0.6, 2.0])
    assert on_left.neighbour_p[1:].tolist() == instance.neighbour_p[1:].tolist()
    at_rest = instance.past_other_side(1, np.array([0.1, 0.0, 2.0]), 1.0, 0.5)
    moved = at_rest.neighbour_p[1] - instance.neighbour_p[1]
    assert np.linalg.norm(moved) == pytest.approx(0.5)
    assert moved @ instance.neighbour_p[1] == pytest.approx(0.0, abs=1e-9)


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
