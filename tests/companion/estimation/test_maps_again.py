"""Seen space, points by parallax, sizes of tracks and assignment, written a second time."""

import math
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from companion.estimation import track_size
from companion.estimation.assignment import assign
from companion.estimation.known_obstacles import KnownObstacles
from companion.estimation.landmark_places import Drift
from companion.estimation.parallax_map import ParallaxMap, doubted, with_others
from companion.estimation.seen_space import SeenSpace
from companion.perception.ground_plane import GroundPlane
from companion.perception.parallax import FixedPoints
from mavlink_bridge.wire.messages import VehicleState

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
SEEDS = pytest.mark.parametrize("seed", range(30))


@pytest.mark.parametrize("shape", [(1, 1), (1, 4), (4, 1), (3, 3), (5, 5), (3, 7), (7, 3), (6, 6)])
@pytest.mark.parametrize("kind", ["real", "ties", "gates"])
def test_assignment_costs_as_little_as_scipys(shape, kind):
    rng = np.random.default_rng([*shape, len(kind)])
    for _ in range(20):
        cost = rng.normal(size=shape)
        if kind == "ties":
            cost = rng.integers(0, 3, shape).astype(float)
        elif kind == "gates":
            cost[rng.random(shape) < 0.5] = 1e3
        pairs = assign(cost)
        rows, columns = linear_sum_assignment(cost)
        assert sum(cost[p] for p in pairs) == pytest.approx(cost[rows, columns].sum())
        assert len({r for r, _ in pairs}) == len({c for _, c in pairs}) == min(shape)
        assert pairs == sorted(pairs)


def state(p, time=0.0):
    return VehicleState(time, np.array(p, float), np.zeros(3), LEVEL, np.zeros(3))


def first_hit(p, angle, rows, reach):
    """How far a ray at this angle is free of upright cylinders, by small steps of geometry."""
    ray, free = np.array([math.cos(angle), math.sin(angle)]), reach
    for x, y, radius in rows:
        off = np.array([x, y]) - p[:2]
        along = off @ ray
        beside = math.dist(off, along * ray)
        if along > 0.0 and beside < radius:
            free = min(free, max(along - math.sqrt(radius**2 - beside**2), 0.0))
    return free


@SEEDS
def test_seen_space_sector_by_sector(seed):
    rng = np.random.default_rng(seed)
    asked = []

    def shows(own, places, margin):
        """Return which places are within 45° of east."""
        asked.append((own.p.copy(), places.copy(), margin))
        off = places - own.p
        return np.abs(np.degrees(np.arctan2(off[:, 1], off[:, 0]))) < 45.0

    space, free, place, time = SeenSpace(SimpleNamespace(shows=shows), 4.0), np.zeros(36), None, 0.0
    p = rng.normal(size=3)
    for k in range(8):
        p, now = p + 0.3 * rng.normal(size=3), time + rng.uniform(0.0, 0.4)
        rows = np.column_stack([p[:2] + 2.5 * rng.normal(size=(4, 2)), rng.uniform(0.1, 1.0, 4)])
        known = KnownObstacles(cylinders=rows[:2], occluders=rows[2:])
        looked = None if k % 3 == 2 else state(p + np.array([0.1, -0.1, 0.0]))
        found = space.update(state(p, now), looked, known, 0.4)
        for s in range(36):
            angle = math.radians(10.0 * s)
            ray = np.array([math.cos(angle), math.sin(angle), 0.0])
            if place is not None:
                way = p - place
                nearer = max(float(ray @ way), 0.0) + 0.3 * math.hypot(*way)
                free[s] = max(free[s] - nearer - 0.4 * (now - time), 0.0)
            if looked is not None and (s <= 4 or s >= 32):
                free[s] = first_hit(p, angle, rows, 4.0)
        assert found == pytest.approx(free, abs=1e-9)
        if looked is not None:
            at, places, margin = asked[-1]
            assert at == pytest.approx(looked.p)
            assert np.linalg.norm(places - at, axis=1) == pytest.approx(2.0)
            assert (places[:, 2] == at[2]).all()
            assert margin == 0.0
        place, time = p.copy(), now


def test_time_that_goes_back_frees_nothing():
    space = SeenSpace(SimpleNamespace(shows=lambda own, places, margin: np.ones(36, bool)), 4.0)
    space.update(state([0, 0, 2], 5.0), state([0, 0, 2]), KnownObstacles(), 0.4)
    assert space.update(state([0, 0, 2], 1.0), None, KnownObstacles(), 0.4).tolist() == [4.0] * 36


def some_points(rng, n, first=0, spread=2.0):
    return FixedPoints(
        np.array([3.0, 0.0, 2.0]) + rng.normal(size=(n, 3)) * [spread, spread, 1.0],
        rng.uniform(0.02, 0.5, n),
        np.arange(first, first + n),
        rng.uniform(0.0, 1.0, n),
        rng.uniform(0.1, 2.0, n),
    )


def grouped(rows):
    """Cylinders and points of rows (x, y, z, σ), by walks from point to point."""
    near = [[math.dist(a[:2], b[:2]) for b in rows] for a in rows]
    sure = [i for i in range(len(rows)) if sum(g < 0.4 for g in near[i]) > 1]
    left, cylinders, rest = list(sure), [], []
    while left:
        group, grows = [left[0]], True
        while grows:
            more = [i for i in left if i not in group and any(near[i][k] < 0.7 for k in group)]
            group, grows = group + more, bool(more)
        left = [i for i in left if i not in group]
        members = np.array([rows[i] for i in sorted(group)])
        (x, y), radius = cv2.minEnclosingCircle(members[:, None, :2].astype(np.float32))
        if radius <= 1.7:
            sigma = float(np.median(members[:, 3]))
            cylinders.append([x, y, max(radius, 0.12), max(sigma, 0.1)])
        else:
            rest.extend(members[:, :3].tolist())
    return np.reshape(cylinders, (-1, 4)), np.reshape(rest, (-1, 3))


@SEEDS
@pytest.mark.parametrize("spread", [0.6, 1.6])
def test_points_by_parallax_are_kept_and_grouped(seed, spread):
    rng = np.random.default_rng(seed)
    things, kept, first = ParallaxMap(), [], 0
    ground = GroundPlane(0.1, (1.0, -1.0), (0.1, -0.05))
    for k in range(9):
        p, time = np.array([0.1 * k, 0.0, 2.0]), 10.0 + 3.0 * k
        fixed = some_points(rng, int(rng.integers(0, 18)), first, spread)
        first += int(rng.integers(0, 18))  # some names come again
        drift = Drift(0.03, 0.02)
        things.update(fixed, p, time, ground, drift)
        old = []
        for x, y, z, sigma, name, seen in kept:
            arm = math.dist((x, y, z), p)
            sigma = math.sqrt(sigma**2 + 0.03**2 + (0.02 * arm) ** 2)
            if name not in fixed.names and time - seen < 12.0 and sigma < 0.4:
                old.append([x, y, z, sigma, name, seen])
        for place, sigma, name in zip(fixed.places, fixed.sigmas, fixed.names, strict=True):
            x, y, z = place
            below = 0.1 + 0.1 * (x - 1.0) - 0.05 * (y + 1.0)
            doubt = 2.0 * sigma * abs(z - p[2]) / math.dist(place, p)  # of its height
            if math.dist(place, p) < 8.0 and z - doubt > below + 0.4 and abs(z - 2.0) < 2.0:
                old.append([x, y, z, sigma, name, time])
        kept = old[-250:]
        if k % 3 == 2:
            cylinders, rest = grouped(np.array(kept)[:, :4] if kept else np.zeros((0, 4)))
            found = things.standing()
            assert found.cylinders == pytest.approx(cylinders, abs=1e-6)
            assert found.points == pytest.approx(rest)
            again = things.standing()
            assert again is found
    things.turn(np.array([1.0, 2.0, 0.0]), 0.3)
    turned = []
    for x, y, *more in kept:
        x, y = x - 1.0, y - 2.0
        c, s = math.cos(0.3), math.sin(0.3)
        turned.append([1.0 + c * x - s * y, 2.0 + s * x + c * y, *more])
    cylinders, _ = grouped(np.array(turned)[:, :4] if turned else np.zeros((0, 4)))
    assert things.standing().cylinders == pytest.approx(cylinders, abs=1e-5)


def test_what_stands_is_made_anew_at_each_third_picture():
    things, rng = ParallaxMap(), np.random.default_rng(2)
    for k in range(7):
        before = things.standing()
        things.update(some_points(rng, 12, 12 * k, 0.3), np.array([0, 0, 2.0]), float(k))
        assert (things.standing() is before) == ((k + 1) % 3 != 0)


def test_of_too_many_points_the_newest_are_kept():
    things = ParallaxMap()
    for k in range(3):
        fixed = some_points(np.random.default_rng(k), 100, 100 * k, 0.1)
        fixed.places[:, 2], fixed.sigmas[:] = 2.0, 0.05
        things.update(fixed, np.array([0, 0, 2.0]), float(k))
    assert things._points[:, 4].tolist() == list(range(50, 300))


@SEEDS
def test_the_doubt_of_the_own_motion_widens_points(seed):
    rng = np.random.default_rng(seed)
    fixed, p = some_points(rng, 20), rng.normal(size=3)
    second = Drift(0.04, 0.03, 0.02, 0.6)
    found = doubted(fixed, p, second)
    wanted = []
    for k in range(20):
        away = math.dist(fixed.places[k], p)
        turn = 0.03**2 + 0.02**2 * (1.0 - 0.6**2)
        moved = (0.04**2 + turn * away**2) * fixed.since[k]
        sigma = math.sqrt(fixed.sigmas[k] ** 2 + moved * (away / max(fixed.bases[k], 1e-3)) ** 2)
        if sigma < 0.15 * away:
            wanted.append((fixed.names[k], pytest.approx(sigma)))
    assert list(zip(found.names.tolist(), found.sigmas.tolist(), strict=True)) == wanted
    none = fixed[np.zeros(20, bool)]
    assert doubted(none, p, second) is none


@SEEDS
def test_cylinders_that_none_explains_are_added_by_their_distance(seed):
    rng = np.random.default_rng(seed)
    p = rng.normal(size=3)

    def some(n):
        return np.column_stack([4.0 * rng.normal(size=(n, 2)), rng.uniform(0.1, 1.0, (n, 2))])

    known, others = some(3), some(4)
    known = known[np.argsort(np.hypot(*(known[:, :2] - p[:2]).T) - known[:, 2])]
    new = [o for o in others if all(math.dist(o[:2], c[:2]) - c[2] > 0.5 for c in known)]
    both = sorted([*known, *new], key=lambda c: math.dist(c[:2], p[:2]) - c[2])
    assert with_others(known, others, p) == pytest.approx(np.array(both))
    assert with_others(known, others[:0], p) is known
    assert with_others(known, known, p) is known


def spd(rng, n):
    a = rng.normal(size=(n, n))
    return a @ a.T + 0.1 * np.eye(n)


def a_track(rng):
    """Mean and covariance of κp, κv, κ."""
    kappa = rng.uniform(0.4, 1.8)
    return np.array([*kappa * rng.normal(size=6), kappa]), 0.01 * spd(rng, 7)


@SEEDS
def test_a_track_of_unknown_size_begins_on_its_ray(seed):
    rng = np.random.default_rng(seed)
    z, here, r = rng.normal(size=3), rng.normal(size=3), spd(rng, 3)
    mean, covariance = track_size.birth(z, r, here, 1.1, 0.3)
    assert mean == pytest.approx([*z, 0, 0, 0, 1])
    # κp is z − (1 − κ) here, + noise of z; κv and κ are independent of that noise.
    a = np.zeros((7, 7))
    a[:3, :3], a[3:6, 3:6] = np.eye(3), np.eye(3)
    a[:3, 6], a[6, 6] = here, 1.0
    free = np.zeros((7, 7))
    free[:3, :3], free[3:6, 3:6], free[6, 6] = r, 1.1**2 * np.eye(3), 0.3**2
    assert covariance == pytest.approx(a @ free @ a.T)


@SEEDS
def test_the_doubt_of_a_track_of_unknown_size_grows(seed):
    rng = np.random.default_rng(seed)
    (m, c), dt, keep, a, to = a_track(rng), 0.2, rng.uniform(0.3, 1.0), 1.5, rng.normal(size=3)
    found = track_size.grow(m[None], c[None], dt, np.array([keep]), to[None], np.array([a]))[0]
    step = np.eye(7)
    step[:3, 3:6], step[3:6, 3:6] = dt * np.eye(3), keep * np.eye(3)
    step[3:6, 6] = (1.0 - keep) * to
    jolt = np.vstack([0.5 * dt**2 * np.eye(3), dt * np.eye(3), np.zeros((1, 3))])
    wanted = step @ c @ step.T + (a * m[6]) ** 2 * jolt @ jolt.T + 0.02**2 * dt * np.outer(m, m)
    assert found == pytest.approx(wanted)


@SEEDS
def test_a_track_of_unknown_size_in_the_world(seed):
    rng = np.random.default_rng(seed)
    m, c = a_track(rng)
    state, covariance = track_size.in_world(m[None], c[None])
    assert state[0] == pytest.approx(m[:6] / m[6])
    jacobian = np.array([
        ((m + d)[:6] / (m + d)[6] - (m - d)[:6] / (m - d)[6]) / 2e-6 for d in 1e-6 * np.eye(7)
    ]).T  # fmt: skip
    assert covariance[0] == pytest.approx(jacobian @ c @ jacobian.T, rel=1e-5, abs=1e-8)
    # With κ known exactly, what is left of the place.
    left = c[:3, :3] - np.outer(c[:3, 6], c[:3, 6]) / c[6, 6]
    sigma = math.sqrt(np.trace(left)) / m[6]
    assert track_size.sigma_of_known_size(m[None], c[None])[0] == pytest.approx(sigma)
    here = rng.normal(size=3)
    at, slope = track_size.seen_from(m[None], here)
    assert at[0] == pytest.approx(here + m[6] * (m[:3] / m[6] - here))
    for d in np.eye(7):
        assert slope @ d == pytest.approx(track_size.seen_from((m + d)[None], here)[0][0] - at[0])


def test_a_neighbour_is_five_times_as_large_at_most():
    m = np.array([[0.2, 0.4, 0.6, 0.1, 0.0, -0.1, 0.1], [2, 4, 6, 1, 0, -1, 1.0]])
    assert track_size.bounded(m).tolist() == [
        pytest.approx([0.4, 0.8, 1.2, 0.2, 0.0, -0.2, 0.2]),
        pytest.approx([2, 4, 6, 1, 0, -1, 1]),
    ]
    beyond = np.array([[1.0, 2.0, 3.0, 0.1, 0.2, 0.3, -0.4]])
    assert track_size.bounded(beyond)[0].tolist() == [1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.2]
