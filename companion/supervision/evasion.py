"""Evasion: a small fixed family of ways to stop, flown by one law in closed form.

Each way has a velocity to reach and a time to hold it, then it brakes to rest: straight, sideways
in eight directions, up and down. The law is that of the guard's brake, from the predicted state;
what it simulates for a tick is what the rate loop does with the command of that tick.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.supervision.certificate import DT, Trajectories
from mavlink_bridge.shared.arrays import Vector, cross
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import rotation_matrix

STEPS = 16  # of DT: the longest way is at rest by then
_CLIMB = 0.8  # m/s, up or down
_SIDES = 8
_STILL = 0.05  # m/s: a way this slow has ended
_VERTICAL = 3.0  # m/s², most that height is corrected by


@dataclass(frozen=True)
class Law:
    """Gains and bounds of the law: 1/s, m/s², 1/s, rad/s, m/s²."""

    brake_gain: float
    brake_max: float
    attitude_gain: float
    omega_max: float
    c_min: float
    c_max: float


@dataclass(frozen=True)
class Ways:
    """n ways to stop: velocity (n,3) m/s to reach, for (n,) s, then rest."""

    velocity: Vector
    hold: Vector

    def __len__(self) -> int:
        return len(self.hold)

    def then(self, other: Ways) -> Ways:
        """Return these ways and the others after them."""
        return Ways(
            np.concatenate([self.velocity, other.velocity]), np.concatenate([self.hold, other.hold])
        )

    def one(self, k: int) -> Ways:
        """Return way k alone."""
        return Ways(self.velocity[k : k + 1], self.hold[k : k + 1])

    def later(self, dt: float) -> Ways:
        """Return what is left of the ways after `dt` [s]."""
        return Ways(self.velocity, np.maximum(self.hold - dt, 0.0))


STRAIGHT = Ways(np.zeros((1, 3)), np.zeros(1))


def aside(forward: Vector, speed: float, hold: float) -> Ways:
    """Return ways up, down and to eight sides; forward (3,): along it the first side goes."""
    start = np.arctan2(forward[1], forward[0])
    angles = start + 2.0 * np.pi / _SIDES * np.arange(_SIDES)
    level = speed * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(_SIDES)])
    upright = np.array([[0.0, 0.0, _CLIMB], [0.0, 0.0, -_CLIMB]])
    return Ways(np.concatenate([level, upright]), np.full(_SIDES + 2, hold))


def simulate(x0: Vector, ways: Ways, wind: Vector, law: Law, first: Vector | None) -> Trajectories:
    """Return the ways flown from the state x0 (10,) p, v, q_wb.

    wind: (3,) m/s², acceleration to make up for. first: (4,) c, omega, a command that flies before
    the law does, for `DT`; None: the law flies at once.
    """
    n = len(ways)
    r = rotation_matrix(x0[6:10])
    p, v = np.tile(x0[:3, None], n), np.tile(x0[3:6, None], n)  # (3,n), as all vectors here
    axis = np.tile(r[:, 2:], n)
    weight = np.array([[0.0], [0.0], [GRAVITY]]) - wind[:, None]
    places, speeds = np.empty((STEPS + 1, 3, n)), np.empty((STEPS + 1, 3, n))
    places[0], speeds[0] = p, v
    u = np.zeros((4, n))
    velocity, latest = ways.velocity.T, float(ways.hold.max(initial=0.0))
    for k in range(STEPS):
        if k == 0 and first is not None:
            u[:] = first[:, None]
            after = axis + DT * (r @ [[first[2]], [-first[1]], [0.0]])
            after /= _length(after)
            c = u[0]
        else:
            wanted = velocity * (ways.hold > DT * k)
            c, after, turn = _thrust(axis, _force(v, wanted, weight, law), law)
            if k == 0:
                rates = r.T @ cross(axis.T, turn.T).T / DT
                u[0], u[1:4] = c, _bounded(rates, -law.omega_max, law.omega_max)
        a0, a1 = c * axis - weight, c * after - weight
        p = p + DT * v + DT**2 / 6.0 * (2.0 * a0 + a1)
        v, axis = v + 0.5 * DT * (a0 + a1), after
        places[k + 1], speeds[k + 1] = p, v
        if k > 0 and latest <= DT * k and (np.abs(v) < _STILL).all():
            places[k + 2 :], speeds[k + 2 :] = p, 0.0
            break
    return Trajectories(u.T, places.transpose(2, 0, 1), speeds.transpose(2, 0, 1))


def _force(v: Vector, wanted: Vector, weight: Vector, law: Law) -> Vector:
    """Return the specific force (3,n) m/s² that leads from velocities v to the wanted ones."""
    a = law.brake_gain * (wanted - v)
    a[:2] *= np.minimum(1.0, law.brake_max / np.maximum(np.hypot(a[0], a[1]), 1e-9))
    a[2] = _bounded(a[2], -_VERTICAL, _VERTICAL)
    force: Vector = a + weight
    return force


def _thrust(axis: Vector, force: Vector, law: Law) -> tuple[Vector, Vector, Vector]:
    """Return the thrusts (n,) m/s² of a tick, their axes (3,n) at its end, and how these turn.

    turns: (3,n) rad, each along what its axis turns towards, and across the axis.
    """
    size = _length(force)
    towards = force / size
    cosine = (axis * towards).sum(axis=0)
    aside = towards - cosine * axis
    sine = _length(aside)
    aside /= np.maximum(sine, 1e-9)
    turn = min(law.attitude_gain * DT, 1.0) * np.arctan2(sine, cosine)
    turn = np.minimum(turn, law.omega_max * DT)
    turned = np.cos(turn) * axis + np.sin(turn) * aside
    return _bounded(size * cosine, law.c_min, law.c_max), turned, turn * aside


def _length(a: Vector) -> Vector:
    """Return the lengths (n,) of vectors (3,n)."""
    size: Vector = np.sqrt((a * a).sum(axis=0))
    return size


def _bounded(a: Vector, least: float, most: float) -> Vector:
    """Return a within bounds: what numpy.clip does, which takes five times as long for a few."""
    return np.minimum(np.maximum(a, least), most)
