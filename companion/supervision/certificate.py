"""Certificate: an independent check that a command leaves the drone a safe way to stop.

A command comes with trajectories that begin with it and end at rest. One is accepted where it is
what the drone can fly, and where it keeps clear, until the drone is at rest, of all that is known
and of all that the bounds allow of what is not known. docs/certificate.md states what follows.
The check has its own geometry and model, and uses numpy alone: it repeats no error of planner,
solver or generator. It never raises; what is not a number, or does not fit together, is refused.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[Any]

G, DT, _FAR = 9.80665, 0.1, 1e3  # m/s²; s between samples of a trajectory; m: nothing is farther
CAUSES = ("neighbour", "remembered", "obstacle", "surface", "fence", "unseen", "motion", "numbers")
_PLACE, _SPEED, _ROUNDING = 0.02, 0.15, 0.05  # m, m/s off the own model; m/s² and rad/s
_SOON, _RISE = 0.3, 0.8  # m that doubt of a velocity brings one in sight nearer; rise of a look


@dataclass(frozen=True)
class Bounds:
    """See `CertificateConfig`."""

    radius: float
    neighbour_radius: float
    neighbour_acceleration: float
    neighbour_brakes: float
    neighbour_trusted: float
    neighbour_speed: float
    sigmas: float
    obstacle_sigmas: float
    unseen_speed: float
    unseen_way: float
    track: float
    track_rate: float
    rest: float
    fence_over: float
    c_max: float
    omega_max: float


@dataclass(frozen=True)
class Scene:
    """What has to be kept clear of, at the time of the prediction; metres, own ENU frame.

    neighbours (n,11): p, v, most variance of p, covariance of both, and variance of v along any
    axis, s since it was seen, and 1 where it is out of view, else 0. cylinders (k,6): x, y, radius,
    σ, velocity x, y. points (m,3). planes (h,4): n·p <= b. free (s,): how far it is known to be
    free, in s equal sectors from the drone, the first centred on east, counted anticlockwise.
    """

    neighbours: Vector
    cylinders: Vector
    points: Vector
    planes: Vector
    free: Vector


@dataclass(frozen=True)
class Trajectories:
    """n candidates. u (n,4): c, omega, the first command of each, for `DT`; p, v (n,T,3)."""

    u: Vector
    p: Vector
    v: Vector


@dataclass(frozen=True)
class Findings:
    """margin (n,): m left over at the tightest place, < 0: refused; cause (n,): what is there.

    Others (n,) m, also while the drone is at rest: course, to what is in sight, where that brakes
    on its course; clear, to all; fixed, to what gives way to nobody.
    """

    margin: Vector
    cause: tuple[str, ...]
    course: Vector
    clear: Vector
    fixed: Vector


def check(way: Trajectories, x0: Vector, wind: Vector, scene: Scene, bounds: Bounds) -> Findings:
    """Return how well trajectories from x0 (10,) p, v, q_wb hold; wind: (3,) m/s², unexplained."""
    n = len(way.p) if np.ndim(way.p) else 0
    try:
        with np.errstate(all="ignore"):
            given = [np.ravel(a) for a in (x0, wind, *vars(scene).values())]
            sane = np.isfinite(np.concatenate(given)).all()
            sane &= way.p.shape == way.v.shape and way.u.shape == (n, 4)
            margins = _margins(way, x0, wind, scene, bounds)
            numbers = [margins, *(a.reshape(n, -1) for a in (way.u, way.p, way.v))]
            good = np.isfinite(np.concatenate(numbers, axis=1)).all(axis=1) & sane
    except (ValueError, TypeError, IndexError, AttributeError):  # shapes that do not fit
        return Findings(bad := np.full(n, -_FAR), (CAUSES[-1],) * n, bad, bad, bad)
    by_cause, at_rest = margins[:, :-3], np.where(good, margins[:, -3:].T, -_FAR)
    worst = np.where(good, by_cause.argmin(axis=1), len(CAUSES) - 1)
    least = np.where(good, by_cause.min(axis=1), -_FAR)
    return Findings(least, tuple(CAUSES[k] for k in worst), *at_rest)


def _margins(way: Trajectories, x0: Vector, wind: Vector, scene: Scene, b: Bounds) -> Vector:
    """Return the margins (n,10) m: by cause, the last -_FAR or _FAR; course, clear, fixed."""
    p, t = way.p, DT * np.arange(way.p.shape[1])
    fast: Vector = _length(way.v) > b.rest
    later: Vector = np.cumsum(fast[:, ::-1], axis=1)[:, ::-1] > 0  # not yet at rest for good
    tube = b.track + b.track_rate * t[1:]  # by steps
    sides = scene.planes[:, :3]  # a drone that is farther out than it may be goes no farther
    limits = np.maximum(scene.planes[:, 3] + b.fence_over, sides @ x0[:3])
    fence = (limits - p @ sides.T)[:, 1:].min(axis=(1, 2), initial=_FAR)
    flyable = np.where(_flyable(way, x0, wind, b), _FAR, -_FAR)
    on_course, *rooms = _neighbours(p, t, tube, scene.neighbours, b)
    rooms += [*_obstacles(p, t, tube, scene, b), *_unseen(p, t, scene.free, b)]
    margins = [_least(np.where(later[:, None, :-1], room, _FAR)) for room in rooms]
    moves = np.where(fast[:, -1], -_FAR, flyable)
    rest = [_least(room) for room in (on_course, *rooms[1:-1])]  # up and down as a last resort
    least, fixed = np.min([*rest, fence, flyable], axis=0), np.minimum(*rest[2:4])
    found = [*margins[:4], fence, np.minimum(*margins[4:]), moves, np.minimum(rest[0], fixed)]
    return np.asarray(np.minimum(np.array([*found, least, fixed]).T, _FAR))


def _neighbours(p: Vector, t: Vector, tube: Vector, rows: Vector, b: Bounds) -> list[Vector]:
    """Return the room (n,k,T-1) m to courses, what those in sight can reach, and the remembered."""
    most, speed = b.neighbour_acceleration, np.maximum(_length(rows[:, 3:6])[:, None], 1e-9)
    brakes = np.where(speed <= b.neighbour_trusted, b.neighbour_brakes, 1e-6)  # or never
    until = np.minimum(t, speed / brakes)  # (k,T) s; then one that brakes is at rest
    times = t[:, None], (until - 0.5 * brakes / speed * until**2)[..., None]
    gap, stops = (_apart(p[:, None] - rows[:, None, :3] - rows[:, None, 3:6] * s) for s in times)
    later, close, unseen = t[1:], b.radius + b.neighbour_radius, rows[:, 9:10]
    reach = np.minimum(0.5 * most * (later + unseen), b.neighbour_speed + speed) * (later + unseen)
    spread = rows[:, 6:7] + 2.0 * later * rows[:, 7:8] + later**2 * rows[:, 8:9]
    need = close + tube + b.sigmas * np.sqrt(np.maximum(spread, 0.0))
    soon = np.minimum(need, close + tube + b.sigmas * np.sqrt(rows[:, 6:7]) + _SOON)
    far = _length(rows[:, :3] - p[0, 0])[:, None]
    away = np.maximum(far - b.unseen_way, np.minimum(far, close))  # it is not where the drone is
    claim = np.minimum(close + tube + b.unseen_speed * unseen, away) + b.unseen_speed * later
    out, seen = rows[:, 10] > 0.0, (most * unseen <= speed - b.unseen_speed)[:, 0]  # just now
    seen |= ~out
    return [(stops - soon)[:, seen], (gap - need - reach)[:, seen], (gap - claim)[:, out]]


def _obstacles(p: Vector, t: Vector, tube: Vector, scene: Scene, b: Bounds) -> list[Vector]:
    """Return the room (n,k,T-1) m to upright cylinders, some of which move, and to the points."""
    rows, near = scene.cylinders, scene.points
    centre = rows[:, None, :2] + rows[:, None, 4:6] * t[1:, None]
    gap = _length(p[:, None, 1:, :2] - centre) - rows[:, 2:3] - b.obstacle_sigmas * rows[:, 3:4]
    near = near[_length(near - p[0, 0]) < _length(p - p[:1, :1]).max() + b.radius + tube[-1]]
    square = (p**2).sum(axis=2)[:, 1:, None] + (near**2).sum(axis=1) - 2.0 * p[:, 1:] @ near.T
    closest = np.sqrt(np.maximum(square.min(axis=2, initial=_FAR**2), 0.0))[:, None]
    return [gap - b.radius - tube, closest - b.radius - tube]


def _unseen(p: Vector, t: Vector, free: Vector, b: Bounds) -> list[Vector]:
    """Return the room (n,1,T-1) m to what was not looked at lately, around, and above or below."""
    off, rise = p[:, 1:, :2] - p[:1, :1, :2], np.abs(p[:, 1:, 2] - p[0, 0, 2])
    sector = np.round(np.arctan2(off[..., 1], off[..., 0]) * len(free) / (2.0 * np.pi))
    known = free[sector.astype(int) % len(free)] - b.unseen_speed * t[1:]
    way = _length(off)
    level = np.where(way < b.unseen_way, _FAR, known - way - b.radius - b.neighbour_radius)
    return [level[:, None], np.where(rise < _RISE * way + b.unseen_way, _FAR, -rise)[:, None]]


def _flyable(way: Trajectories, x0: Vector, wind: Vector, b: Bounds) -> Vector:
    """Return which trajectories (n,) begin with their command and stay within thrust and rates."""
    p, v, u, q = way.p, way.v, way.u, x0[6:10] / _length(x0[6:10])
    weight, half = np.array([0.0, 0.0, G]) - wind, 0.5 * DT * u[:, 1:4]
    axis = np.column_stack([half[:, 1], -half[:, 0], np.ones(len(u))])  # of the thrust, body
    w, x, y, z = q.tolist()
    turn = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])  # q[1:] × …
    axis = axis @ (np.eye(3) + 2.0 * (w * turn + turn @ turn)).T  # world
    then = x0[3:6] + DT * (u[:, :1] * axis / _length(axis)[:, None] - weight)
    good = _length(p[:, 0] - x0[:3]) + _length(v[:, 0] - x0[3:6]) < _ROUNDING
    good &= _length(v[:, 1] - then) < _SPEED
    off = p[:, 1:] - p[:, :-1] - 0.5 * DT * (v[:, 1:] + v[:, :-1])
    good &= (_length(off) < _PLACE).all(axis=1)
    good &= (np.abs(u[:, 1:4]) <= b.omega_max + _ROUNDING).all(axis=1) & (u[:, 0] <= b.c_max)
    force = (v[:, 1:] - v[:, :-1]) / DT + weight  # per mass, that the propellers have to give
    along = force / (size := _length(force))[..., None]
    turned = min(np.sqrt(2.0) * b.omega_max * DT + _ROUNDING, np.pi)
    good &= (np.vecdot(along[:, 1:], along[:, :-1]) >= np.cos(turned)).all(axis=1)
    return np.asarray(good & (size <= b.c_max + _ROUNDING).all(axis=1))


def _apart(offsets: Vector) -> Vector:
    """Return the least distance from 0 (...,T-1) on each step between offsets (...,T,d)."""
    a, d = offsets[..., :-1, :], offsets[..., 1:, :] - offsets[..., :-1, :]
    s = np.maximum(-np.vecdot(a, d) / np.maximum(np.vecdot(d, d), 1e-12), 0.0)
    return _length(a + np.minimum(s, 1.0)[..., None] * d)


def _length(a: Vector) -> Vector:
    return np.asarray(np.sqrt(np.vecdot(a, a)))


def _least(room: Vector) -> Vector:
    return np.asarray(room.min(axis=(1, 2), initial=_FAR))
