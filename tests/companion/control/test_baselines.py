"""Velocity rules from the literature with one neighbour, one obstacle, one goal."""

import math
import sys

import numpy as np
import pytest

from companion.control.baselines import ControllerSetup, make_planner
from companion.control.baselines.config import BaselinesConfig, RblConfig
from companion.control.baselines.planner import tracking_command
from companion.control.baselines.rbl import Rbl
from companion.control.baselines.rules import Reynolds, braking_curve
from companion.control.baselines.surroundings import Surroundings
from companion.control.nmpc import Neighbour, make_instance
from companion.model import predict
from companion.settings.config import CompanionConfig
from mavlink_bridge.shared.settings import SettingsError


class Inputs:
    """A rule of inputs; what it commands is set by the test."""

    commands = (9.81, 0.0, 0.0, 0.0)

    def __init__(self, setup):
        pass

    def command(self, around, instance):
        return self.commands


RULES = ("reynolds", "vasarhelyi", "potential-field", "orca", "rbl", "avocado")


def planner(controller, **changes):
    config = CompanionConfig(controller=controller, **changes).for_controller()
    c = config
    setup = ControllerSetup(c.nmpc, c.baselines, c.right_of_way.level, lambda: 0.0, {})
    return make_planner(c.controller, setup), c.nmpc


def instance(config, v=(0.0, 0.0, 0.0), **scene):
    x0 = np.array([0.0, 0.0, 2.0, *v, 1.0, 0.0, 0.0, 0.0])
    given = {"goal": [20.0, 0.0, 2.0], "yaw": 0.0} | scene
    return make_instance(config, x0=x0, u_last=[9.81, 0, 0, 0], **given)


def surroundings(migration, neighbours=None, surfaces=None):
    none = np.zeros((0, 2))
    neighbours = none if neighbours is None else neighbours
    return Surroundings(
        v=np.zeros(2),
        migration=np.asarray(migration, float),
        fastest=1.6,
        neighbours=neighbours,
        velocities=np.zeros_like(neighbours),
        cohesion=np.zeros(len(neighbours)),
        trunks=np.zeros((0, 3)),
        walls=np.zeros((0, 3)),
        surfaces=none if surfaces is None else surfaces,
    )


def velocity(controller, **scene):
    """The rule's velocity, bounded: the plan's second one."""
    p, config = planner(controller)
    return p.solve(instance(config, **scene)).x[1, 3:5]


@pytest.mark.parametrize("controller", RULES)
def test_alone_it_flies_to_the_goal_at_cruise_speed(controller):
    v = velocity(controller)
    assert np.linalg.norm(v) == pytest.approx(CompanionConfig().nmpc.speed, abs=0.01)
    assert abs(math.atan2(v[1], v[0])) < 0.06


@pytest.mark.parametrize("controller", RULES)
def test_it_gives_way_to_a_neighbour_that_comes_from_the_left(controller):
    free = velocity(controller)
    crossing = Neighbour([1.2, 0.9, 2.0], [0.0, -1.0, 0.0])
    v = velocity(controller, neighbours=[crossing], v=(1.0, 0.0, 0.0))
    assert v[0] < free[0] - 0.05 or v[1] < free[1] - 0.05


@pytest.mark.parametrize("controller", RULES)
def test_a_drone_that_has_landed_blocks_no_way(controller):
    landed = Neighbour([0.7, 0.0, 0.0], [0.0, 0.0, 0.0])
    assert velocity(controller, neighbours=[landed]) == pytest.approx(velocity(controller))


@pytest.mark.parametrize("controller", RULES)
def test_a_drone_that_flies_slowly_to_its_goal_makes_way_faster(controller):
    """As the NMPC does, up to its bound of this tick."""
    comes = Neighbour([-0.6, 0.0, 2.0], [1.0, 0.0, 0.0])
    v = velocity(controller, speed=0.165, v_max=1.5, neighbours=[comes])
    assert 0.4 < np.linalg.norm(v) <= 1.5 + 1e-9


@pytest.mark.parametrize("controller", RULES)
@pytest.mark.parametrize(
    "obstacle", [{"cylinders": [[1.3, 0.3, 0.5]]}, {"planes": [[1.0, 0.0, 0.0, 0.8]]}]
)
def test_it_does_not_fly_on_into_a_trunk_or_a_wall(controller, obstacle):
    towards = np.array([1.3, 0.3]) if "cylinders" in obstacle else np.array([1.0, 0.0])
    towards /= np.linalg.norm(towards)
    v = velocity(controller, v=(1.2, 0.0, 0.0), **obstacle)
    assert v @ towards < velocity(controller) @ towards - 0.3


@pytest.mark.parametrize("controller", RULES)
def test_floor_and_ceiling_are_no_walls(controller):
    fence = [[0, 0, 1, 3.0], [0, 0, -1, -1.0]]
    assert velocity(controller, planes=fence) == pytest.approx(velocity(controller))


def test_reynolds_rests_where_cohesion_and_separation_balance():
    c = BaselinesConfig().reynolds
    rest = math.sqrt(c.separation / c.cohesion)
    rules = {flocking: Reynolds(BaselinesConfig().reynolds, flocking) for flocking in (True, False)}
    _, config = planner("reynolds")

    def pull(distance, flocking):
        seen = Surroundings.of(
            instance(config, goal=[0, 0, 2], neighbours=[Neighbour([0, distance, 2], [0, 0, 0])]),
            config,
            level=1.2,
        )
        return rules[flocking].velocity(seen)[1]

    assert pull(rest, True) == pytest.approx(0.0, abs=1e-9)
    assert pull(rest + 0.5, True) > 0 > pull(rest - 0.5, True)
    assert pull(rest + 0.5, False) < 0  # own targets: no cohesion


@pytest.mark.parametrize(("r", "speed"), [(-1.0, 0.0), (0.5, 0.5), (1.0, 1.0), (2.5, 2.0)])
def test_the_braking_curve_is_linear_then_a_root(r, speed):
    assert braking_curve(r, 1.0, 1.0) == pytest.approx(speed)


@pytest.mark.parametrize("controller", [*RULES, "single-horizon"])
def test_an_instance_that_is_not_finite_gives_an_unusable_finite_plan(controller):
    p, config = planner(controller)
    result = p.solve(instance(config, goal=[np.nan, 0, 2]))
    assert not result.usable
    assert np.isfinite(result.u).all()
    assert np.isfinite(result.x).all()


@pytest.mark.parametrize("controller", [*RULES, "single-horizon"])
def test_random_surroundings_give_a_bounded_command(controller):
    p, config = planner(controller)
    rng = np.random.default_rng(7)
    for _ in range(30):
        scene = {
            "v": rng.normal(0, 1.5, 3),
            "goal": [*rng.normal(0, 8, 2), 2.0],
            "yaw": float(rng.uniform(-3, 3)),
            "neighbours": [
                Neighbour([*rng.normal(0, 1.5, 2), 2.0], rng.normal(0, 1, 3))
                for _ in range(rng.integers(0, 12))
            ],
            "cylinders": [[*rng.normal(0, 2, 2), 0.5] for _ in range(rng.integers(0, 8))],
        }
        result = p.solve(instance(config, **scene))
        assert np.isfinite(result.u).all()
        assert (np.abs(result.u[:, 1:]) <= config.omega_max + 1e-6).all()
        assert (result.u[:, 0] >= config.c_min - 1e-6).all()
        assert (result.u[:, 0] <= config.c_max + 1e-6).all()


def test_the_tracking_law_brings_the_model_to_the_wanted_velocity():
    _, config = planner("orca")
    law = BaselinesConfig().tracking
    x, wanted = np.array([0, 0, 2, 0, 0, 0, 1, 0, 0, 0.0]), np.array([1.2, -0.6, 0.3])
    for _ in range(40):
        at = make_instance(config, x0=x, u_last=[9.81, 0, 0, 0], goal=[9, 0, 2], yaw=0.7)
        x = predict(x, tracking_command(wanted, at, law), 0.1, np.zeros(3))
    assert x[3:6] == pytest.approx(wanted, abs=0.05)
    assert 2 * math.atan2(x[9], x[6]) == pytest.approx(0.7, abs=0.05)


def test_single_horizon_is_the_nmpc_with_all_horizons_of_n_steps():
    config = CompanionConfig(controller="single-horizon").for_controller().nmpc
    assert config.M == config.M_constraint == config.N
    assert CompanionConfig().for_controller().nmpc == CompanionConfig().nmpc


def test_orca_without_its_package_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyrvo", None)
    monkeypatch.delitem(sys.modules, "companion.control.baselines.orca", raising=False)
    with pytest.raises(SettingsError, match=r"swarm-companion\[studies\]"):
        planner("orca")


def test_rules_take_every_neighbour():
    config = CompanionConfig(controller="reynolds").for_controller()
    assert config.nmpc.neighbours == config.threat.critical == 12


@pytest.mark.parametrize(
    ("asked", "flown"),
    [
        ((12.0, 0.5, -0.5, 0.1), (12.0, 0.5, -0.5, 0.1)),
        ((99.0, 9.0, -9.0, 0.0), (20.0, 3.0, -3.0, 0.0)),
        ((0.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0)),
        ((np.nan, 0.0, 0.0, 0.0), None),
        ((9.81, 0.0, 0.0), None),
    ],
)
def test_thrust_and_rates_of_a_rule_are_bounded_and_must_be_four_numbers(asked, flown, monkeypatch):
    monkeypatch.setattr(Inputs, "commands", asked)
    p, config = planner(f"{__name__}:Inputs")
    plan = p.solve(instance(config, v=(1.0, 0.0, 0.0)))
    assert plan.usable == (flown is not None)
    if flown is not None:
        assert plan.u[0] == pytest.approx(flown)
        assert plan.x[-1, 0] == pytest.approx(config.N * config.dt)  # straight on at 1 m/s
    assert np.isfinite(plan.x).all()
    assert np.isfinite(plan.u).all()


def test_lloyds_rule_flies_to_the_middle_of_its_cell_and_no_farther():
    """Half way to a neighbour; a trunk and a wall leave room for the body and its margin."""
    c = RblConfig(reach=2.0, margin=0.1)
    none = np.zeros((0, 2))
    before = [
        (np.array([[2.0, 0.0]]), none, 1.0),  # half the way
        (np.array([[0.8, 0.0]]), none, 0.2),  # two bodies of 0.3 m have to fit
        (none, np.array([[1.0, 0.0]]), 0.7),
    ]
    for neighbours, surfaces, most in before:
        around = surroundings([1.5, 0.0], neighbours=neighbours, surfaces=surfaces)
        rule = Rbl(c, 0.2)
        assert rule.velocity(around)[0] / c.gain <= most
        free = rule._disc[rule._free(around)]
        assert free[:, 0].max() == pytest.approx(most, abs=0.11)


def test_lloyds_rule_turns_right_where_another_stands_in_the_way():
    rule = Rbl(RblConfig(), 0.2)
    around = surroundings([1.5, 0.0], neighbours=np.array([[1.5, 0.0]]))
    first = rule.velocity(around)
    later = np.array([rule.velocity(around) for _ in range(30)])
    assert abs(first[1]) < 1e-6
    assert later[:, 1].min() < -0.3
    assert later[:, 1].max() < 1e-6
    rule.reset()
    assert rule.velocity(around) == pytest.approx(first)


def test_two_that_meet_by_lloyds_rule_pass_each_other():
    p = np.array([[-4.0, 0.0], [4.0, 0.0]])
    goals, rules = p[::-1].copy(), [Rbl(RblConfig(), 0.2) for _ in p]
    least = np.inf
    for _ in range(300):
        v = []
        for k, rule in enumerate(rules):
            off = goals[k] - p[k]
            wanted = 1.5 * off / np.hypot(np.linalg.norm(off), 1.0)
            v.append(rule.velocity(surroundings(wanted, neighbours=p[1 - k : 2 - k] - p[k])))
        p = p + 0.1 * np.array(v)
        least = min(least, float(np.linalg.norm(p[0] - p[1])))
    assert np.abs(p - goals).max() < 0.5
    assert least > 0.4
