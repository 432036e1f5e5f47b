"""AVOCADO: its velocity obstacles, its opinion of a neighbour, and flights in the plane."""

import math
from functools import partial

import numpy as np
import pytest

from companion.control.baselines.avocado import Avocado, away, time_to_collision
from companion.control.baselines.config import AvocadoConfig
from companion.control.baselines.surroundings import Surroundings

DT = 0.1  # s, a tick
CONTACT = 0.4  # m between two drones' centres
none = partial(np.zeros, (0, 2))


def surroundings(v, migration, neighbours=(), velocities=(), trunks=(), walls=(), fastest=1.6):
    return Surroundings(
        v=np.asarray(v, float),
        migration=np.asarray(migration, float),
        fastest=fastest,
        neighbours=np.reshape(neighbours, (-1, 2)).astype(float),
        velocities=np.reshape(velocities, (-1, 2)).astype(float),
        cohesion=np.zeros(len(np.reshape(neighbours, (-1, 2)))),
        trunks=np.reshape(trunks, (-1, 3)).astype(float),
        walls=np.reshape(walls, (-1, 3)).astype(float),
        surfaces=none(),
    )


def head_on(own=1.0, other=-0.5, apart=2.4):
    """The drone at `own`, a neighbour ahead of it at `other` [m/s], a little to its left."""
    return surroundings([own, 0.0], [own, 0.0], [apart, 0.1], [other, 0.0])


def within(p, v, radius, horizon):
    """Return whether a point at v comes within the radius of p before the horizon."""
    closest = np.clip(p @ v / max(v @ v, 1e-12), 0.0, horizon)
    return np.linalg.norm(p - closest * v) < radius


def test_the_change_ends_at_the_border_of_the_velocity_obstacle_and_none_is_less():
    rng = np.random.default_rng(1)
    kinds = set()
    for _ in range(300):
        p, v = rng.normal(0.0, 2.0, 2), rng.normal(0.0, 1.5, 2)
        if np.linalg.norm(p) < 0.7:
            continue
        u, n = away(p, v, 0.6, 2.5)
        inside = within(p, v, 0.6, 2.5)
        assert np.linalg.norm(n) == pytest.approx(1.0)
        assert (u @ n > 0.0) == inside
        assert not within(p, v + u + 1e-6 * n, 0.6, 2.5)
        assert within(p, v + u - 1e-6 * n, 0.6, 2.5)
        turn = rng.uniform(0.0, 2.0 * np.pi, 40)
        shorter = 0.99 * np.linalg.norm(u) * np.column_stack([np.cos(turn), np.sin(turn)])
        assert all(within(p, v + less, 0.6, 2.5) == inside for less in shorter)
        kinds.add((inside, bool(abs(n @ (v + u)) < 1e-9)))  # on a leg, which ends at no motion
    assert len(kinds) == 4


def test_two_that_touch_part_within_a_tick():
    p, v = np.array([0.5, 0.0]), np.array([0.4, 0.0])
    u, n = away(p, v, 0.6, 2.5)
    assert n == pytest.approx([-1.0, 0.0])
    assert np.linalg.norm(p - DT * (v + u)) == pytest.approx(0.6)
    assert np.isfinite(away(np.zeros(2), np.zeros(2), 0.6, 2.5)).all()


def test_a_tie_is_passed_on_the_right():
    u, n = away(np.array([2.0, 0.0]), np.array([1.5, 0.0]), 0.6, 2.5)
    assert n[1] < 0.0
    assert u @ n > 0.0


@pytest.mark.parametrize(
    ("p", "v", "time"),
    [
        ((3.0, 0.0), (1.0, 0.0), 2.0),
        ((3.0, 0.6), (2.0, 0.0), (3.0 - 0.8) / 2.0),
        ((3.0, 1.1), (1.0, 0.0), math.inf),  # it passes
        ((3.0, 0.0), (-1.0, 0.0), math.inf),
        ((3.0, 0.0), (0.0, 0.0), math.inf),
        ((0.8, 0.0), (-1.0, 0.0), 0.0),  # it touches
    ],
)
def test_time_to_collision(p, v, time):
    assert time_to_collision(np.array(p), np.array(v), 1.0) == pytest.approx(time)


@pytest.mark.parametrize(("b", "own"), [(-1.0, 1.0), (-0.5, 0.75), (0.0, 0.5), (1.0, 0.0)])
def test_the_drone_does_what_the_neighbour_leaves(b, own):
    """The opinion starts at b/d: α = 0, 1/4, 1/2, 1, and the drone does 1 - α of the change."""
    rule = Avocado(AvocadoConfig(b=b, d=1.0, aside=0.0))
    around = head_on()
    changed = rule.velocity(around) - around.v
    u = rule.known[0].needed
    assert np.linalg.norm(u) > 0.2
    assert changed == pytest.approx(own * u, abs=1e-9)


def test_a_neighbour_that_does_its_part_raises_its_share():
    rule, velocity, shares = Avocado(AvocadoConfig()), np.array([-0.5, 0.0]), []
    for k in range(4):
        offset = np.array([2.4 - 0.15 * k, 0.1])
        rule.velocity(surroundings([1.0, 0.0], [1.0, 0.0], offset, velocity))
        shares.append(rule.known[0].share)
        velocity = velocity - 0.8 * rule.known[0].needed
    assert shares[0] == 0.5
    assert (np.diff(shares) > 0.01).all()


def test_one_that_flies_straight_on_lowers_it():
    rule, shares = Avocado(AvocadoConfig()), []
    for k in range(10):
        rule.velocity(head_on(apart=2.4 - 0.15 * k))
        shares.append(rule.known[0].share)
    assert shares[0] == 0.5
    assert (np.diff(shares) < 0.0).all()
    assert shares[-1] < 0.25


def test_one_step_of_opinion_and_attention_is_as_in_the_paper():
    rule = Avocado(AvocadoConfig(kappa=1.0, aside=0.0))
    rule.velocity(head_on())
    u = rule.known[0].needed
    dv = np.array([-0.1, 0.05])
    rule.velocity(surroundings([1.0, 0.0], [0.7, 0.2], [2.25, 0.1], [-0.6, 0.05]))
    met = rule.known[0]
    # By the velocity that the drone would rather fly, not by the one that it flies.
    left = time_to_collision(np.array([2.25, 0.1]), np.array([1.3, 0.15]), 1.0)
    assert 0.0 < left < math.inf
    w = 0.57 * math.tanh(1.0 / left)
    y = math.tanh(3.22 * (abs(dv @ u) / (u @ u) - 0.5))
    assert met.attention == pytest.approx(w)
    assert met.opinion == pytest.approx(DT * 2.0 * w * math.tanh(0.7 * y))


def test_an_opinion_of_one_that_is_no_danger_fades():
    rule = Avocado(AvocadoConfig())
    for k in range(8):
        rule.velocity(head_on(apart=2.4 - 0.1 * k))
    low = rule.known[0].share
    for k in range(30):
        rule.velocity(surroundings([0.0, 0.0], [0.0, 1.0], [1.7 + 0.02 * k, 0.1], [0.2, 0.0]))
    assert low < 0.4
    assert rule.known[0].share == pytest.approx(0.5, abs=0.02)


def test_each_neighbour_keeps_its_opinion_in_whatever_order_they_come():
    rule = Avocado(AvocadoConfig())
    for k in range(8):
        offsets = [[2.4 - 0.15 * k, 0.1], [-1.5, 1.5]]
        around = surroundings([1.0, 0.0], [1.0, 0.0], offsets, [[-0.5, 0.0], [1.0, 0.0]])
        rule.velocity(around)
    straight, beside = (other.opinion for other in rule.known)
    offsets = [[-1.5, 1.5], [2.4 - 0.15 * 8, 0.1]]
    rule.velocity(surroundings([1.0, 0.0], [1.0, 0.0], offsets, [[1.0, 0.0], [-0.5, 0.0]]))
    swapped = [other.opinion for other in rule.known]
    assert swapped == pytest.approx([beside, straight], abs=0.1)
    assert straight < -0.3 < -0.1 < beside


def test_one_that_was_somewhere_else_is_another_one():
    rule = Avocado(AvocadoConfig())
    for k in range(8):
        rule.velocity(head_on(apart=2.4 - 0.15 * k))
    rule.velocity(surroundings([1.0, 0.0], [1.0, 0.0], [1.2, 1.0], [-0.5, 0.0]))
    assert rule.known[0].share == 0.5


def test_a_neighbour_beyond_reach_does_not_count():
    rule = Avocado(AvocadoConfig(aside=0.0))
    assert rule.velocity(head_on(apart=2.6)) == pytest.approx([1.0, 0.0])
    assert not rule.known
    assert rule.velocity(head_on(apart=2.4)) != pytest.approx([1.0, 0.0])


def test_reset_forgets():
    rule = Avocado(AvocadoConfig())
    first = rule.velocity(head_on())
    for _ in range(5):
        later = rule.velocity(head_on())
    assert np.linalg.norm(later - first) > 0.05
    rule.reset()
    assert not rule.known
    assert (rule.velocity(head_on()) == first).all()


@pytest.mark.parametrize("obstacle", [{"walls": [[1, 0, 0.3]]}, {"trunks": [[0.9, 0, 0.5]]}])
def test_inside_the_margin_a_drone_may_rest_but_comes_no_nearer(obstacle):
    """Two neighbours press it on: a wall and a trunk are kept, the neighbours are not."""
    rests = Avocado(AvocadoConfig()).velocity(surroundings([0, 0], [0, 0], **obstacle))
    assert rests == pytest.approx([0.0, 0.0])
    pressed = {"neighbours": [[-0.5, 0.1], [-0.5, -0.1]], "velocities": [[1.0, 0.0]] * 2}
    free = Avocado(AvocadoConfig()).velocity(surroundings([0, 0], [1, 0], **pressed))
    kept = Avocado(AvocadoConfig()).velocity(surroundings([0, 0], [1, 0], **pressed, **obstacle))
    assert free[0] > 0.5
    assert kept[0] <= 1e-5


def test_a_wall_is_reached_no_sooner_than_the_horizon():
    rule = Avocado(AvocadoConfig(horizon_obstacle=2.0))
    v = rule.velocity(surroundings([1.0, 0.0], [1.5, 0.0], walls=[[1.0, 0.0, 1.5]]))
    assert v[0] == pytest.approx((1.5 - 0.5) / 2.0)


def fly(p, goals, rules, velocity, seconds=30.0, trunks=(), gain=1.0 / DT):
    """Return the way (t,n,2) m of drones that fly what they choose; without a rule, straight on.

    gain: 1/s, by which a velocity follows the chosen one; by default at once.
    """
    way, v = [np.array(p, float)], np.array(velocity, float)
    for _ in range(int(seconds / DT)):
        p, chosen = way[-1], v.copy()
        for k, rule in enumerate(rules):
            if rule is None:
                continue
            off, others = goals[k] - p[k], np.arange(len(p)) != k
            wanted = 1.5 * off / math.hypot(np.linalg.norm(off), 1.0)
            near = [[x - p[k][0], y - p[k][1], r] for x, y, r in trunks]
            seen = surroundings(v[k], wanted, p[others] - p[k], v[others], near)
            chosen[k] = rule.velocity(seen)
        v = v + gain * DT * (chosen - v)
        way.append(p + DT * v)
    return np.array(way)


def least_apart(way):
    return np.linalg.norm(way[:, 0] - way[:, 1], axis=1).min()


def test_two_that_meet_head_on_pass_each_other():
    p = np.array([[-4.0, 0.0], [4.0, 0.0]])
    way = fly(p, p[::-1], [Avocado(AvocadoConfig()) for _ in p], np.zeros((2, 2)))
    assert least_apart(way) > 2 * CONTACT
    assert np.linalg.norm(way[-1] - p[::-1], axis=1).max() < 0.5
    aside = np.abs(way[:, :, 1]).max(axis=0)
    assert aside.min() > 0.3  # both give way


def test_one_that_keeps_straight_is_avoided_by_the_drone_alone():
    p = np.array([[-4.0, 0.0], [4.0, 0.0]])
    rules = [Avocado(AvocadoConfig()), None]
    way = fly(p, p[::-1], rules, [[0.0, 0.0], [-1.0, 0.0]], seconds=12.0)
    assert least_apart(way) > 2 * CONTACT
    assert np.abs(way[:, 1, 1]).max() == 0.0
    assert np.linalg.norm(way[-1, 0] - p[1]) < 0.5


@pytest.mark.parametrize("gain", [2.5, 1.0 / DT])
def test_two_that_both_give_way_hold_each_other_to_do_little(gain):
    """A limit of eq. (15), which compares the change in one tick with all of u.

    A vehicle has not got so far in one tick; and after a tick that is enough, u is 0, which counts
    as nothing done.
    """
    p = np.array([[-4.0, 0.0], [4.0, 0.0]])
    shares = []

    class Watched(Avocado):
        def velocity(self, around):
            chosen = super().velocity(around)
            shares.extend(other.share for other in self.known)
            return chosen

    rules = [Watched(AvocadoConfig()), Avocado(AvocadoConfig())]
    way = fly(p, p[::-1], rules, np.zeros((2, 2)), gain=gain)
    assert least_apart(way) > 2 * CONTACT
    assert shares[0] == 0.5
    assert min(shares) == pytest.approx(0.265, abs=0.01)
    assert max(shares) <= 0.5


def test_a_trunk_in_the_way_is_passed():
    p, goal, trunk = np.array([[-4.0, 0.0]]), np.array([[4.0, 0.0]]), (0.0, 0.1, 0.5)
    way = fly(p, goal, [Avocado(AvocadoConfig())], np.zeros((1, 2)), trunks=[trunk])
    clear = np.linalg.norm(way[:, 0] - trunk[:2], axis=1) - trunk[2]
    assert clear.min() > 0.45  # the radius, with its margin, but for a tick's turn
    assert np.linalg.norm(way[-1] - goal) < 0.5
