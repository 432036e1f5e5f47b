"""The checker: what it accepts is safe by a simulation of its own, and all else is refused."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.supervision.certificate import CAUSES, DT, Scene, Trajectories, check
from companion.supervision.certify import CertificateConfig, bounds_of
from companion.supervision.evasion import STRAIGHT, Law, Ways, aside, simulate
from companion.supervision.guard_config import GuardConfig

GUARD = GuardConfig()
LAW = Law(GUARD.brake_gain, GUARD.brake_max, GUARD.attitude_gain, 3.0, 2.0, 20.0)
BOUNDS = bounds_of(CertificateConfig(), GUARD, 0.2)
CALM = np.zeros(3)
EMPTY = Scene(
    np.zeros((0, 11)), np.zeros((0, 6)), np.zeros((0, 3)), np.zeros((0, 4)), np.full(36, 5.0)
)


def state(speed=1.6, q=(1.0, 0.0, 0.0, 0.0)):
    """At 2 m height, flying east."""
    return np.array([0.0, 0.0, 2.0, speed, 0.0, 0.0, *q])


def neighbour(p, v=(0.0, 0.0, 0.0), unseen=0.0):
    return np.array([[*p, *v, 0.001, 0.0, 0.01, unseen, unseen > 0.0]], float)


def lost_in_view(p, seconds):
    rows = neighbour(p, unseen=seconds)
    rows[:, 10] = 0.0
    return rows


def with_straight(sides):
    return Ways(
        np.concatenate([STRAIGHT.velocity, sides.velocity]),
        np.concatenate([STRAIGHT.hold, sides.hold]),
    )


def braking(speed=1.6):
    return simulate(state(speed), STRAIGHT, CALM, LAW, None)


def verdict(scene=EMPTY, way=None, x0=None, bounds=BOUNDS):
    found = check(way or braking(), state() if x0 is None else x0, CALM, scene, bounds)
    return found.margin[0] >= 0.0, found.cause[0]


def test_braking_in_the_open_is_accepted():
    assert verdict()[0]


@pytest.mark.parametrize(
    ("scene", "cause"),
    [
        ({"neighbours": neighbour((0.8, 0.0, 2.0))}, "neighbour"),
        ({"neighbours": neighbour((1.7, 0.0, 2.0), (-2.0, 0.0, 0.0))}, "neighbour"),
        ({"neighbours": neighbour((0.0, -1.2, 2.0), (0.0, 2.0, 0.0))}, "neighbour"),
        ({"neighbours": neighbour((0.9, 0.0, 2.0), unseen=2.0)}, "remembered"),
        ({"neighbours": neighbour((0.3, 0.42, 2.0), unseen=1.0)}, "remembered"),
        # What was seen half a second ago may have turned since.
        ({"neighbours": lost_in_view((0.2, -1.1, 2.0), 0.5)}, "neighbour"),
        # Just out of sight, it cannot have slowed down yet.
        ({"neighbours": neighbour((-0.5, 0.3, 2.0), (2.3, 0.0, 0.0), unseen=0.5)}, "neighbour"),
        ({"cylinders": np.array([[1.0, 0.0, 0.5, 0.0, 0.0, 0.0]])}, "obstacle"),
        ({"cylinders": np.array([[1.6, 0.0, 0.5, 0.0, -1.5, 0.0]])}, "obstacle"),
        ({"points": np.array([[0.5, 0.1, 2.0]])}, "surface"),
        ({"planes": np.array([[1.0, 0.0, 0.0, -0.2]])}, "fence"),
        ({"free": np.zeros(36)}, "unseen"),
    ],
)
def test_what_stands_or_may_come_in_the_way_refuses(scene, cause):
    assert verdict(replace(EMPTY, **scene)) == (False, cause)


@pytest.mark.parametrize(
    "scene",
    [
        {"neighbours": neighbour((1.6, 0.0, 2.0))},
        {"neighbours": neighbour((0.0, -1.2, 2.0))},
        {"neighbours": lost_in_view((0.2, -1.1, 2.0), 0.1)},
        {"neighbours": neighbour((2.0, 0.0, 2.0), (2.0, 0.0, 0.0))},
        {"cylinders": np.array([[1.4, 0.0, 0.5, 0.0, 0.0, 0.0]])},
        {"points": np.array([[0.9, 0.1, 2.0]])},
        {"planes": np.array([[1.0, 0.0, 0.0, 0.2]])},
        {"free": np.where(np.arange(36) < 1, 5.0, 0.0)},
    ],
)
def test_what_keeps_out_of_the_way_does_not(scene):
    assert verdict(replace(EMPTY, **scene))[0]


@pytest.mark.parametrize("climb", [0.8, -0.8])
@pytest.mark.parametrize(
    ("forward", "hold", "accepted"), [(0.0, 0.2, True), (0.0, 0.8, False), (1.2, 0.8, True)]
)
def test_a_camera_has_not_looked_at_what_is_steeply_above_or_below(climb, forward, hold, accepted):
    ways = Ways(np.array([[forward, 0.0, climb]]), np.array([hold]))
    flown = simulate(state(forward), ways, CALM, LAW, None)
    found, cause = verdict(way=flown, x0=state(forward))
    assert found == accepted
    assert accepted or cause == "unseen"


def test_a_drone_that_stands_is_not_to_blame():
    near = replace(EMPTY, neighbours=neighbour((0.7, 0.0, 2.0), (-2.0, 0.0, 0.0)))
    hover = simulate(state(0.0), STRAIGHT, CALM, LAW, None)
    assert verdict(near, hover, state(0.0))[0]
    assert check(hover, state(0.0), CALM, near, BOUNDS).course[0] < 0.0


def _changed(way, name, change):
    arrays = {f.name: getattr(way, f.name).copy() for f in fields(Trajectories)}
    arrays[name] = change(arrays[name])
    return Trajectories(**arrays)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("p", lambda p: p + np.array([0.2, 0.0, 0.0])),  # begins elsewhere
        ("v", lambda v: v + np.array([0.3, 0.0, 0.0])),  # begins faster
        ("p", lambda p: np.concatenate([p[:, :3], p[:, 3:] + [0.0, 0.1, 0.0]], axis=1)),  # jumps
        ("p", lambda p: p[:, :4]),  # shapes differ
        ("u", lambda u: u * [1.0, 1.0, 0.0, 1.0] + [8.0, 0.0, 0.0, 0.0]),  # another command
        ("u", lambda u: u + np.array([0.0, 9.0, 0.0, 0.0])),  # faster than the rate loop
        ("u", lambda u: u[:, :3]),
        ("v", lambda v: v.astype(object)),
        ("v", lambda v: None),
    ],
)
def test_a_trajectory_that_cannot_be_flown_is_refused(name, change):
    accepted, cause = verdict(way=_changed(braking(), name, change))
    assert not accepted
    assert cause in ("motion", "numbers")


def test_a_trajectory_that_does_not_end_at_rest_is_refused():
    way = braking()
    cut = Trajectories(way.u, way.p[:, :4], way.v[:, :4])
    assert verdict(way=cut) == (False, "motion")


def test_braking_harder_than_the_thrust_allows_is_refused():
    way = braking()
    v = way.v.copy()
    v[:, 2:] = 0.0
    p = np.concatenate(
        [way.p[:, :1], way.p[:, :1] + np.cumsum(0.5 * DT * (v[:, 1:] + v[:, :-1]), axis=1)], axis=1
    )
    assert verdict(way=Trajectories(way.u, p, v)) == (False, "motion")


WHERE = st.sampled_from(["u", "p", "v", "x0", "wind", *(f.name for f in fields(Scene))])


@given(WHERE, st.sampled_from([np.nan, np.inf, -np.inf]), st.integers(0, 10_000))
def test_what_is_not_a_number_is_never_accepted(where, value, place):
    scene = replace(
        EMPTY,
        neighbours=neighbour((9.0, 9.0, 2.0)),
        cylinders=np.array([[9.0, 9.0, 0.5, 0.0, 0.0, 0.0]]),
        points=np.array([[9.0, 9.0, 9.0]]),
        planes=np.array([[0.0, 0.0, 1.0, 9.0]]),
    )
    way, x0, wind = braking(), state(), np.zeros(3)
    assert check(way, x0, wind, scene, BOUNDS).margin[0] >= 0.0
    holder = way if where in ("u", "p", "v") else scene
    array = {"x0": x0, "wind": wind}.get(where)
    array = getattr(holder, where) if array is None else array
    array.reshape(-1)[place % array.size] = value
    found = check(way, x0, wind, scene, BOUNDS)
    EMPTY.free[:] = 5.0
    assert found.margin[0] < 0.0
    assert np.isfinite(found.margin).all()


@given(st.lists(st.floats(width=64), min_size=60, max_size=60), st.integers(0, 3))
def test_any_numbers_give_a_finite_answer(values, count):
    numbers = np.array(values)
    with np.errstate(all="ignore"):
        scene = Scene(
            numbers[: 11 * count].reshape(-1, 11),
            numbers[:12].reshape(-1, 6),
            numbers[:9].reshape(-1, 3),
            numbers[:8].reshape(-1, 4),
            numbers[:36],
        )
        way = Trajectories(numbers[:8].reshape(2, 4), *numbers[:48].reshape(2, 2, 4, 3))
        found = check(way, numbers[:10], numbers[:3], scene, BOUNDS)
    assert np.isfinite(found.margin).all()
    assert set(found.cause) <= set(CAUSES)


def test_no_neighbour_within_the_bounds_can_touch_an_accepted_way():
    """Ten neighbours each, that accelerate as they like within the bounds: none is touched."""
    rng = np.random.default_rng(77)
    accepted = 0
    for _ in range(400):
        x0 = state(rng.uniform(0.3, 1.8))
        side = aside(x0[3:6], 1.2, 0.5)
        ways = with_straight(side)
        rows = np.concatenate(
            [
                neighbour(rng.uniform(-2.5, 2.5, 3) * [1, 1, 0.3] + [0, 0, 2], rng.normal(size=3))
                for _ in range(2)
            ]
        )
        rows[:, 6:9] = 0.0
        way = simulate(x0, ways, CALM, LAW, None)
        found = check(way, x0, CALM, replace(EMPTY, neighbours=rows), BOUNDS)
        for k in np.flatnonzero(found.margin >= 0.0):
            accepted += 1
            for row in rows:
                assert _least_gap(way.p[k], way.v[k], row, rng) > 0.4
    assert accepted > 300


def _least_gap(p, v, row, rng, steps=10):
    """The least distance while the drone moves, from a neighbour that attacks in its own way."""
    q, u, least = row[:3].copy(), row[3:6].copy(), np.inf
    push = rng.normal(size=3)
    for k in range(len(p) - 1):
        for s in np.arange(steps) / steps:
            own = p[k] + s * (p[k + 1] - p[k])
            if np.linalg.norm(v[k]) <= BOUNDS.rest:
                return least
            least = min(least, float(np.linalg.norm(own - q)))
            push = own - q if rng.random() < 0.5 else push
            a = BOUNDS.neighbour_acceleration * push / np.linalg.norm(push)
            dt = DT / steps
            q, u = q + dt * u + 0.5 * dt * dt * a, u + dt * a
    return least


def test_the_family_ends_at_rest_and_is_what_the_checker_takes_for_flyable():
    sides = aside(np.array([1.0, 0.0, 0.0]), 1.8, 0.8)
    way = simulate(state(1.85), with_straight(sides), CALM, LAW, None)
    assert (check(way, state(1.85), CALM, EMPTY, BOUNDS).margin >= 0.0).all()


def test_straight_braking_ends_at_rest_where_the_delay_slows_the_rates():
    way = simulate(state(1.85), STRAIGHT, CALM, replace(LAW, omega_max=1.0), None)
    assert verdict(way=way, x0=state(1.85))[0]


@pytest.mark.parametrize(("a", "flyable"), [(9.9, True), (10.3, False)])
def test_a_climb_may_take_all_of_the_thrust_and_no_more(a, flyable):
    """It climbs at so many m/s² for 0.2 s and falls back to rest; 20 m/s² are g and 10.2."""
    v = np.zeros((1, 9, 3))
    v[0, 2:5, 2] = DT * a, 2.0 * DT * a, DT * (2.0 * a - 9.0)
    v[0, 5, 2] = max(v[0, 4, 2] - 0.9, 0.0)
    p = np.cumsum(
        np.concatenate([state()[None, None, :3], 0.5 * DT * (v[:, 1:] + v[:, :-1])], 1), 1
    )
    hover = Trajectories(np.array([[9.80665, 0.0, 0.0, 0.0]]), p, v)
    expected = (True, None) if flyable else (False, "motion")
    found = verdict(way=hover, x0=state(0.0), bounds=replace(BOUNDS, unseen_way=2.0))
    assert found[0] == expected[0]
    assert flyable or found[1] == expected[1]


def test_a_neighbour_out_of_sight_has_no_course():
    """It was last seen long ago: where it flies now is not known, and bound A2 stands for it."""
    near = replace(EMPTY, neighbours=neighbour((1.6, 0.0, 2.0), (-1.0, 0.0, 0.0)))
    near.neighbours[:, 9:11] = 2.5, 1.0  # s unseen, out of view
    hover = simulate(state(0.0), STRAIGHT, CALM, LAW, None)
    found = check(hover, state(0.0), CALM, near, BOUNDS)
    assert found.course[0] > 100.0
    assert found.clear[0] < 0.0


@pytest.mark.parametrize(
    ("away", "speed", "evaded"), [(1.3, 0.7, False), (1.0, 0.7, True), (1.6, 1.0, True)]
)
def test_a_neighbour_that_can_brake_in_time_is_left_to_do_so(away, speed, evaded):
    """From 0.7 m/s it stops within 0.31 m; two radii and the doubts after 1.6 s are 0.88 m.

    Who still comes at 1 m/s does not brake.
    """
    comes = replace(EMPTY, neighbours=neighbour((away, 0.0, 2.0), (-speed, 0.0, 0.0)))
    hover = simulate(state(0.0), STRAIGHT, CALM, LAW, None)
    assert bool(check(hover, state(0.0), CALM, comes, BOUNDS).course[0] < 0.0) == evaded


def test_a_trunk_that_moves_has_a_course():
    comes = replace(EMPTY, cylinders=np.array([[2.0, 0.0, 0.5, 0.0, -1.5, 0.0]]))
    hover = simulate(state(0.0), STRAIGHT, CALM, LAW, None)
    assert check(hover, state(0.0), CALM, comes, BOUNDS).course[0] < 0.0
    stands = replace(EMPTY, cylinders=np.array([[2.0, 0.0, 0.5, 0.0, 0.0, 0.0]]))
    assert check(hover, state(0.0), CALM, stands, BOUNDS).course[0] > 0.5
