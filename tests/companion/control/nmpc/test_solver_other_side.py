"""A neighbour that comes too near is passed on its other side where that is cheaper."""

import dataclasses

import numpy as np
import pytest

from companion.control.nmpc import Neighbour, Nmpc, NmpcConfig, make_instance
from companion.control.nmpc.ipopt import IpoptNmpc
from companion.model import HOVER
from companion.types import PlanStatus
from tests.companion.control.nmpc.scenes import CONFIG


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


def test_a_rival_of_a_tick_before_a_failure_is_forgotten():
    nmpc, config = Nmpc(NmpcConfig(w_short=0.0)), NmpcConfig(w_short=0.0)
    for k in range(3):
        nmpc.solve(comer(config, k))
    assert nmpc._rival is not None
    broken = dataclasses.replace(comer(config, 3), yaw=np.nan)
    assert nmpc.solve(broken).status is PlanStatus.NOT_FINITE
    assert nmpc._rival is None
