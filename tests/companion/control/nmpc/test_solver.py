"""The real-time solver: optimum, constraints, symmetry, fixed points, bounded work."""

import dataclasses
from unittest import mock

import numpy as np
import pytest

from companion.control.nmpc import Neighbour, Nmpc, NmpcConfig, make_instance
from companion.control.nmpc.instance_file import load, stored
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
