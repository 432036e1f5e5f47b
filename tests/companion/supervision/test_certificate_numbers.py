"""The checker's margins, against the same rules written down a second time, number by number."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.supervision.certificate import Bounds, Scene, Trajectories, check
from companion.supervision.evasion import STRAIGHT, Law, Ways, aside, simulate

DT = 0.1
LAW = Law(4.5, 6.0, 6.0, 3.0, 2.0, 20.0)
BOUNDS = Bounds(
    radius=0.2,
    neighbour_radius=0.25,
    neighbour_acceleration=2.0,
    neighbour_brakes=0.8,
    neighbour_trusted=1.0,
    neighbour_speed=3.0,
    sigmas=2.0,
    obstacle_sigmas=1.5,
    unseen_speed=0.3,
    unseen_way=0.35,
    track=0.06,
    track_rate=0.05,
    rest=0.2,
    fence_over=0.5,
    c_max=20.0,
    omega_max=3.0,
)
EMPTY = Scene(
    np.zeros((0, 11)), np.zeros((0, 6)), np.zeros((0, 3)), np.zeros((0, 4)), np.full(36, 90.0)
)


def step_distance(a, b):
    """From 0 to the straight line between two offsets."""
    d = b - a
    s = min(max(-(a @ d) / max(d @ d, 1e-12), 0.0), 1.0)
    return float(np.linalg.norm(a + s * d))


class Reference:
    """Room of one way, in loops. moving: only until the drone is at rest for good."""

    def __init__(self, p, v, scene, b):
        self.p, self.v, self.scene, self.b = p, v, scene, b
        self.last = max((k for k in range(len(p)) if np.linalg.norm(v[k]) > b.rest), default=-1)

    def steps(self, moving):
        """(step, s at its end, half width of the tube)."""
        for k in range(len(self.p) - 1):
            if not moving or k <= self.last:
                later = DT * (k + 1)
                yield k, later, self.b.track + self.b.track_rate * later

    def neighbour(self, row, k, later, tube):
        """Room to the course of a neighbour, to what it can reach, and to its memory."""
        b, p0, v0, unseen = self.b, row[:3], row[3:6], row[9]
        speed = float(np.linalg.norm(v0))
        gap = step_distance(self.p[k] - p0 - v0 * DT * k, self.p[k + 1] - p0 - v0 * DT * (k + 1))
        sigma = math.sqrt(max(row[6] + 2.0 * later * row[7] + later**2 * row[8], 0.0))
        close = b.radius + b.neighbour_radius
        need = close + tube + b.sigmas * sigma
        evaded = min(need, close + tube + b.sigmas * math.sqrt(row[6]) + 0.3)
        time = later + unseen
        reach = min(0.5 * b.neighbour_acceleration * time, b.neighbour_speed + speed) * time
        far = float(np.linalg.norm(p0 - self.p[0]))
        away = max(far - b.unseen_way, min(far, close))
        claim = min(close + tube + b.unseen_speed * unseen, away) + b.unseen_speed * later
        then, soon = p0 + v0 * self.braked(speed, k), p0 + v0 * self.braked(speed, k + 1)
        stops = step_distance(self.p[k] - then, self.p[k + 1] - soon)
        return stops - evaded, gap - need - reach, gap - claim

    def braked(self, speed, k):
        """Seconds at its first speed in which a neighbour that brakes gets as far as in k steps."""
        brakes, time = self.b.neighbour_brakes, DT * k
        if speed > self.b.neighbour_trusted:
            return time
        if speed < brakes * time:
            return 0.5 * speed / brakes
        return time - 0.5 * brakes * time**2 / speed if speed > 0.0 else 0.0

    def counts(self, row):
        """Return whether a neighbour counts as one in sight, and as one that is remembered."""
        speed = float(np.linalg.norm(row[3:6]))
        just = self.b.neighbour_acceleration * row[9] <= speed - self.b.unseen_speed
        return not row[10] or just, bool(row[10])

    def neighbours(self, moving):
        seen, remembered, course = [], [], []
        for row in self.scene.neighbours:
            in_sight, in_mind = self.counts(row)
            for k, later, tube in self.steps(moving):
                on_course, reached, memory = self.neighbour(row, k, later, tube)
                if in_sight:
                    seen.append(reached)
                    course.append(on_course)
                if in_mind:
                    remembered.append(memory)
        return seen, remembered, course

    def obstacles(self, moving):
        b, room = self.b, []
        for x, y, radius, sigma, vx, vy in self.scene.cylinders:
            for k, later, tube in self.steps(moving):
                at = self.p[k + 1][:2] - [x + vx * later, y + vy * later]
                room.append(np.hypot(*at) - radius - b.obstacle_sigmas * sigma - b.radius - tube)
        return room

    def surfaces(self, moving):
        nothing = [1e3 - self.b.radius - tube for _, _, tube in self.steps(moving)]
        return nothing + [
            float(np.linalg.norm(self.p[k + 1] - point)) - self.b.radius - tube
            for point in self.scene.points
            for k, _, tube in self.steps(moving)
        ]

    def fence(self, x0):
        room = []
        for *n, limit in self.scene.planes:
            most = max(limit + self.b.fence_over, float(np.dot(n, x0[:3])))
            room += [most - float(np.dot(n, p)) for p in self.p[1:]]
        return room

    def unseen(self, moving):
        room, count = [], len(self.scene.free)
        for k, later, _ in self.steps(moving):
            x, y, z = self.p[k + 1] - self.p[0]
            way = math.hypot(x, y)
            if moving and abs(z) >= 0.8 * way + self.b.unseen_way:
                room.append(-abs(z))  # no matter as a last resort
            if way >= self.b.unseen_way:
                sector = round(math.degrees(math.atan2(y, x)) / (360.0 / count)) % count
                free = self.scene.free[sector] - self.b.unseen_speed * later
                room.append(free - way - self.b.radius - self.b.neighbour_radius)
        return room


def least(*rooms):
    return min([1e3, *(r for room in rooms for r in room)])


def compared(scene, seeds=range(25), bounds=BOUNDS):
    """Check each way of some random states against the reference; return the causes found."""
    causes = set()
    for seed in seeds:
        rng = np.random.default_rng(seed)
        x0 = np.array([*rng.normal(size=3), *rng.normal(size=3) * [1.0, 1.0, 0.3], 1, 0, 0, 0])
        sides = aside(x0[3:6], 1.2, 0.5)
        ways = Ways(
            np.concatenate([STRAIGHT.velocity, sides.velocity]), np.array([0.0, *sides.hold])
        )
        way = simulate(x0, ways, np.zeros(3), LAW, None)
        around = scene(rng, x0)
        found = check(way, x0, np.zeros(3), around, bounds)
        for k in range(len(ways)):
            r = Reference(way.p[k], way.v[k], around, bounds)
            seen, remembered, _ = r.neighbours(moving=True)
            margins = {
                "neighbour": least(seen),
                "remembered": least(remembered),
                "obstacle": least(r.obstacles(True)),
                "surface": least(r.surfaces(True)),
                "fence": least(r.fence(x0)),
                "unseen": least(r.unseen(True)),
                "motion": 1e3,
            }
            assert found.margin[k] == pytest.approx(min(margins.values()), abs=1e-6)
            assert margins[found.cause[k]] == min(margins.values())
            causes.add(found.cause[k])
            _, remembered, course = r.neighbours(moving=False)
            rest = [r.obstacles(False), r.surfaces(False), r.unseen(False), r.fence(x0)]
            met = min(least(course, *rest[:2]), 0.0)
            assert min(found.course[k], 0.0) == pytest.approx(met, abs=1e-6)
            assert found.clear[k] == pytest.approx(least(course, remembered, *rest), abs=1e-6)
            hits = min(least(*rest[:2]), 0.0)  # of points that a way cannot reach it says nothing
            assert min(found.fixed[k], 0.0) == pytest.approx(hits, abs=1e-6)
    return causes


def some_neighbours(rng, x0, out):
    """Three neighbours 0.3 to 3 m off."""
    rows = np.zeros((3, 11))
    rows[:, :3] = x0[:3] + rng.normal(size=(3, 3)) * [1.5, 1.5, 0.4]
    rows[:, 3:6] = rng.normal(size=(3, 3))
    rows[:, 6] = rng.uniform(0.0, 0.05, 3)
    rows[:, 7] = rng.uniform(-0.02, 0.02, 3)
    rows[:, 8] = rng.uniform(0.0, 0.1, 3)
    rows[:, 9] = rng.uniform(0.0, 1.5, 3)
    rows[:, 10] = out
    return rows


@pytest.mark.parametrize("out", [0.0, 1.0, [0.0, 1.0, 1.0]])
def test_neighbours_in_sight_and_out_of_it(out):
    def scene(rng, x0):
        return replace(EMPTY, neighbours=some_neighbours(rng, x0, out))

    causes = compared(scene)
    assert causes >= ({"neighbour", "remembered"} if np.any(out) else {"neighbour"})


def test_a_neighbour_that_was_remembered_close_by_is_not_where_the_drone_is():
    def scene(rng, x0):
        rows = some_neighbours(rng, x0, 1.0)
        rows[:, :3] = x0[:3] + rng.normal(size=(3, 3)) * 0.3
        rows[:, 3:6] *= 0.1
        return replace(EMPTY, neighbours=rows)

    assert compared(scene) == {"remembered", "unseen"}  # some of the ways go up


def test_trunks_that_stand_and_that_move():
    def scene(rng, x0):
        rows = np.column_stack([
            x0[:2] + rng.normal(size=(4, 2)) * 2.0, rng.uniform(0.1, 0.5, 4),
            rng.uniform(0.0, 0.2, 4), rng.normal(size=(4, 2)) * [[1.0], [1.0], [0.0], [0.0]],
        ])  # fmt: skip
        return replace(EMPTY, cylinders=rows)

    assert "obstacle" in compared(scene)


def test_points_of_surfaces():
    def scene(rng, x0):
        return replace(EMPTY, points=x0[:3] + rng.normal(size=(60, 3)) * [1.0, 1.0, 0.5])

    assert "surface" in compared(scene)


def test_a_fence():
    def scene(rng, x0):
        sides = rng.normal(size=(3, 3))
        sides /= np.linalg.norm(sides, axis=1)[:, None]
        return replace(
            EMPTY, planes=np.column_stack([sides, sides @ x0[:3] + rng.uniform(-0.8, 0.5, 3)])
        )

    assert "fence" in compared(scene)


@pytest.mark.parametrize("sectors", [36, 7])
def test_space_that_was_not_looked_at(sectors):
    def scene(rng, x0):
        return replace(EMPTY, free=rng.uniform(0.0, 2.5, sectors))

    assert "unseen" in compared(scene)


def test_all_at_once():
    def scene(rng, x0):
        return Scene(
            some_neighbours(rng, x0, [0.0, 0.0, 1.0]) + np.eye(11)[0],
            np.array([[*(x0[:2] + rng.normal(size=2) * 2.0), 0.3, 0.1, 0.0, 0.0]]),
            x0[:3] + rng.normal(size=(5, 3)) * 2.0,
            np.array([[0.0, 0.0, 1.0, x0[2] + 0.2]]),
            rng.uniform(0.5, 3.0, 36),
        )

    assert len(compared(scene, range(60))) >= 4


def with_numbers(p, v, c=9.80665, omega=(0.0, 0.0, 0.0)):
    """A way by its places and velocities."""
    return Trajectories(np.array([[c, *omega]]), np.array([p], float), np.array([v], float))


def motion(accelerations, x0=(0, 0, 2, 0, 0, 0, 1, 0, 0, 0), **command):
    """Return whether the checker takes a way by these accelerations [m/s²] for flyable."""
    p, v = [np.array(x0[:3], float)], [np.array(x0[3:6], float)]
    for a in np.array(accelerations, float):
        v.append(v[-1] + DT * a)
        p.append(p[-1] + 0.5 * DT * (v[-1] + v[-2]))
    found = check(with_numbers(p, v, **command), np.array(x0, float), np.zeros(3), EMPTY, BOUNDS)
    assert found.cause[0] == "motion" or found.margin[0] > 0.0
    return bool(found.margin[0] >= 0.0)


REST = [[0.0, 0.0, 0.0]] * 4


def test_hovering_is_flown():
    assert motion(REST)


@pytest.mark.parametrize(("omega", "good"), [(3.0, True), (3.04, True), (3.06, False)])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_first_command_keeps_the_body_rates(omega, good, axis, sign):
    rates = sign * omega * np.eye(3)[axis]
    tilt = 0.5 * DT * rates  # in the mean of the first tick
    a = 9.80665 * np.array([tilt[1], -tilt[0], 0.0]) / np.sqrt(1.0 + tilt[0] ** 2 + tilt[1] ** 2)
    assert motion([a, -a, *REST], omega=tuple(rates)) is good


@pytest.mark.parametrize(("c", "good"), [(20.0, True), (20.01, False)])
def test_the_first_command_keeps_the_thrust(c, good):
    up = np.array([0.0, 0.0, c - 9.80665])
    assert motion([up, *[-up / 4.0] * 4, *REST], c=c) is good


@pytest.mark.parametrize(("off", "good"), [(0.14, True), (0.16, False)])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_first_tick_is_what_the_command_does(off, good, axis):
    """So many m/s otherwise after the first tick."""
    a = off / DT * np.eye(3)[axis]
    assert motion([a, -a, *REST]) is good


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_first_tick_is_that_of_the_attitude_and_of_the_wind(axis):
    """Tilted by 20° it accelerates; a wind that is known holds it."""
    half = math.radians(10.0)
    q = [math.cos(half), *(math.sin(half) * np.eye(3)[axis])]
    a = np.array([[0.0, -math.sin(2 * half)], [math.sin(2 * half), 0.0], [0.0, 0.0]][axis])
    push = 9.80665 * np.array([*a, math.cos(2 * half) - 1.0]) if axis < 2 else np.zeros(3)
    x0 = np.array([0, 0, 2, 0, 0, 0, *q], float)
    p, v = [x0[:3]], [np.zeros(3)]
    for k in (1.0, 0.0, -1.0, 0.0, 0.0):
        v.append(v[-1] + DT * k * push)
        p.append(p[-1] + 0.5 * DT * (v[-1] + v[-2]))
    calm = np.zeros(3)
    assert check(with_numbers(p, v), x0, calm, EMPTY, BOUNDS).margin[0] > 0.0
    still = with_numbers([x0[:3]] * 6, [np.zeros(3)] * 6)
    assert check(still, x0, -push, EMPTY, BOUNDS).margin[0] > 0.0
    if axis < 2:
        assert check(still, x0, calm, EMPTY, BOUNDS).cause[0] == "motion"
        assert check(still, x0, push, EMPTY, BOUNDS).cause[0] == "motion"


@pytest.mark.parametrize(("off", "good"), [(0.04, True), (0.06, False)])
@pytest.mark.parametrize("where", ["place", "speed"])
def test_a_way_begins_where_the_drone_is(off, good, where):
    p, v = np.tile([0.0, 0.0, 2.0], (6, 1)), np.zeros((6, 3))
    x0 = np.array([0, 0, 2, 0, 0, 0, 1, 0, 0, 0], float)
    x0[1 if where == "place" else 4] += off
    found = check(with_numbers(p, v), x0, np.zeros(3), EMPTY, BOUNDS)
    assert bool(found.margin[0] >= 0.0) is good


@pytest.mark.parametrize(("off", "good"), [(0.019, True), (0.021, False)])
@pytest.mark.parametrize("step", [1, 3, 5])
def test_places_follow_from_the_velocities(off, good, step):
    p, v = np.tile([0.0, 0.0, 2.0], (6, 1)), np.zeros((6, 3))
    p[step:, 1] += off
    x0 = np.array([0, 0, 2, 0, 0, 0, 1, 0, 0, 0], float)
    found = check(with_numbers(p, v), x0, np.zeros(3), EMPTY, BOUNDS)
    assert bool(found.margin[0] >= 0.0) is good


@pytest.mark.parametrize(("degrees", "good"), [(26.0, True), (28.5, False)])
def test_the_thrust_turns_as_fast_as_two_axes_allow(degrees, good):
    """√2 × 3 rad/s × 0.1 s and a bit: 27.2°."""
    a = 9.80665 * math.tan(math.radians(degrees))
    assert motion([[0, 0, 0], [a, 0, 0], [0, 0, 0], [-a, 0, 0], [0, 0, 0], *REST]) is good


@pytest.mark.parametrize(("speed", "good"), [(0.19, True), (0.21, False)])
def test_a_way_ends_at_rest(speed, good):
    a = [0.0, 10.0 * speed / 2.0, 0.0]
    assert motion([a, a, [0.0, 0.0, 0.0]]) is good
