"""Evasion: a small fixed family of ways to stop, flown by one law in closed form.

Each way has a velocity to reach and a time to hold it, then it brakes to rest: straight, sideways
in eight directions, up and down. The law is that of the guard's brake, from the predicted state;
what it simulates for a tick is what the rate loop does with the command of that tick.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.supervision.certificate import DT, Trajectories
from mavlink_bridge.shared.arrays import Vector, cross
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import rotation_matrix

STEPS = 16  # of DT: the longest way is at rest by then
_UPRIGHT = np.array([[0.0, 0.0, 0.8], [0.0, 0.0, -0.8]])  # m/s, up and down
_SIDES = 8
_STILL = 0.05  # m/s: a way this slow has ended
_VERTICAL = 3.0  # m/s², most that height is corrected by
_TINY = 1e-9
_Axes = tuple[float, float, float]
_Command = tuple[float, float, float, float]  # thrust [m/s²] and by how much it moves the axis


@dataclass(frozen=True)
class Law:
    """Gains and bounds of the law: 1/s, m/s², 1/s, rad/s, m/s²; rad/s by which it yaws."""

    brake_gain: float
    brake_max: float
    attitude_gain: float
    omega_max: float
    c_min: float
    c_max: float
    yaw_rate: float = 0.0


@dataclass(frozen=True)
class Ways:
    """n ways to stop: velocity (n,3) m/s to reach, for (n,) s, then rest."""

    velocity: Vector
    hold: Vector

    def __len__(self) -> int:
        return len(self.hold)

    def one(self, k: int) -> Ways:
        """Return way k alone."""
        return Ways(self.velocity[k : k + 1], self.hold[k : k + 1])

    def later(self, dt: float) -> Ways:
        """Return what is left of the ways after `dt` [s]."""
        return Ways(self.velocity, np.maximum(self.hold - dt, 0.0))


STRAIGHT = Ways(np.zeros((1, 3)), np.zeros(1))


def joined(*ways: Ways) -> Ways:
    """Return all the ways, in this order."""
    return Ways(np.concatenate([w.velocity for w in ways]), np.concatenate([w.hold for w in ways]))


def aside(forward: Vector, speed: float, hold: float, upright: bool = True) -> Ways:
    """Return ways to eight sides, and up and down; forward (3,): along it the first side goes.

    speed: m/s, to the sides. hold: s. upright: whether there are ways up and down.
    """
    start = np.arctan2(forward[1], forward[0])
    angles = start + 2.0 * np.pi / _SIDES * np.arange(_SIDES)
    level = speed * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(_SIDES)])
    velocity = np.concatenate([level, _UPRIGHT]) if upright else level
    return Ways(velocity, np.full(len(velocity), hold))


def simulate(
    x0: Vector,
    ways: Ways,
    wind: Vector,
    law: Law,
    first: Vector | None,
    after: NDArray[np.bool_] | None = None,
) -> Trajectories:
    """Return the ways flown from the state x0 (10,) p, v, q_wb.

    wind: (3,) m/s², acceleration to make up for. first: (4,) c, omega, a command that flies before
    the law does, for `DT`; None: the law flies at once. after: (n,), which ways begin with that
    command; None: all.
    """
    n = len(ways)
    if after is None:
        after = np.full(n, first is not None)
    r = rotation_matrix(x0[6:10])
    start: list[float] = [*x0[:6].tolist(), *r[:, 2].tolist()]
    wx, wy, wz = wind.tolist()
    weight = -wx, -wy, GRAVITY - wz
    command = None
    if first is not None:
        command = (float(first[0]), *(DT * (r @ [first[2], -first[1], 0.0])).tolist())
    # Plain numbers: most often there is one way, of which arrays take four times as long.
    if n == 1:
        places, speeds, thrust, turn = _one_flown(start, ways, weight, law, command)
    else:
        places, speeds, thrust, turn = _flown_together(start, ways, weight, law, command, after)
    u = np.empty((n, 4))
    u[:, 0], u[:, 1:4] = thrust, turn @ r / DT
    u[:, 3] += law.yaw_rate
    np.clip(u[:, 1:4], -law.omega_max, law.omega_max, out=u[:, 1:4])
    if first is not None:
        u[after] = first
    return Trajectories(u, places, speeds)


def _one_flown(
    start: list[float], ways: Ways, weight: _Axes, law: Law, command: _Command | None
) -> tuple[Vector, Vector, Vector, Vector]:
    """Return what `_flown_together` does, of one way."""
    wanted, hold = ways.velocity[0].tolist(), float(ways.hold[0])
    states, thrust, turn = _flown(start, wanted, hold, weight, law, command)
    rows, count = np.array(states), len(states)
    places, speeds = np.empty((1, STEPS + 1, 3)), np.zeros((1, STEPS + 1, 3))
    places[0, :count], speeds[0, :count] = rows[:, :3], rows[:, 3:]
    places[0, count:] = rows[-1, :3]
    return places, speeds, np.array([thrust]), np.array([turn])


def _flown_together(
    start: list[float],
    ways: Ways,
    weight: _Axes,
    law: Law,
    command: _Command | None,
    after: NDArray[np.bool_],
) -> tuple[Vector, Vector, Vector, Vector]:
    """Return places and velocities (n,T,3) of all ways, their first thrusts (n,) and turns (n,3).

    This is `_flown`, all ways at once: it must be changed with it. weight, command: as there.
    after: (n,), which ways begin with the command. thrust: m/s². turn: rad, world.
    """
    n = len(ways)
    p, v, axis = (np.tile(np.array(start[k : k + 3])[:, None], n) for k in (0, 3, 6))  # (3,n)
    g, wanted = np.array(weight)[:, None], ways.velocity.T
    times = DT * np.arange(STEPS + 1)
    goes_on = ways.hold > times[:, None]  # (T,n)
    states = np.empty((STEPS + 1, 2, 3, n))
    states[0] = p, v
    thrust, turn = np.zeros(n), np.zeros((3, n))
    for k in range(STEPS):
        c, turned, sideways = _thrusts(axis, _forces(goes_on[k] * wanted - v, g, law), law)
        if k == 0:
            thrust, turn = c, cross(axis.T, sideways.T).T
        if k == 0 and command is not None:
            told = axis + np.array(command[1:])[:, None]
            told /= np.maximum(np.sqrt((told * told).sum(axis=0)), _TINY)
            c, turned = np.where(after, command[0], c), np.where(after, told, turned)
        old, new = c * axis - g, c * turned - g
        p = p + DT * v + DT * DT / 6.0 * (2.0 * old + new)
        v = v + 0.5 * DT * (old + new)
        axis = turned
        states[k + 1] = p, v
    fastest = np.abs(states[:, 1]).max(axis=1)
    ends = ~goes_on[:-1] & (fastest[1:] < _STILL)  # (T-1,n), after each step
    ends[0], ends[-1] = False, True
    last = 1 + ends.argmax(axis=0)[:, None]  # (n,1): there the drone stays
    samples = np.arange(STEPS + 1)
    found = states[np.minimum(samples, last), :, :, np.arange(n)[:, None]]  # (n,T,2,3)
    found[samples > last, 1] = 0.0
    return found[:, :, 0], found[:, :, 1], thrust, turn.T


def _flown(
    start: Sequence[float],
    wanted: Sequence[float],
    hold: float,
    weight: _Axes,
    law: Law,
    command: _Command | None,
) -> tuple[list[tuple[float, ...]], float, list[float]]:
    """Return one way's places and velocities, and its first thrust and turn [m/s², rad; world].

    start: p, v, and the axis of the thrust. weight: m/s², to be carried. command: thrust of the
    first `DT`, and by how much it moves the axis.
    """
    px, py, pz, vx, vy, vz, ax, ay, az = start
    states: list[tuple[float, ...]] = [(px, py, pz, vx, vy, vz)]
    thrust, turn = 0.0, [0.0, 0.0, 0.0]
    gx, gy, gz = weight
    for k in range(STEPS):
        if k == 0 and command is not None:
            c, dx, dy, dz = command
            bx, by, bz = ax + dx, ay + dy, az + dz
            size = max(math.sqrt(bx * bx + by * by + bz * bz), _TINY)
            bx, by, bz = bx / size, by / size, bz / size
        else:
            x, y, z = wanted if hold > DT * k else (0.0, 0.0, 0.0)
            force = _force((x - vx, y - vy, z - vz), weight, law)
            c, (bx, by, bz), sideways = _thrust((ax, ay, az), force, law)
            if k == 0:
                thrust, (sx, sy, sz) = c, sideways
                turn = [ay * sz - az * sy, az * sx - ax * sz, ax * sy - ay * sx]
        # The acceleration grows evenly from that of the old axis to that of the new one.
        fx, fy, fz = c * ax - gx, c * ay - gy, c * az - gz
        tx, ty, tz = c * bx - gx, c * by - gy, c * bz - gz
        px += DT * vx + DT * DT / 6.0 * (2.0 * fx + tx)
        py += DT * vy + DT * DT / 6.0 * (2.0 * fy + ty)
        pz += DT * vz + DT * DT / 6.0 * (2.0 * fz + tz)
        vx += 0.5 * DT * (fx + tx)
        vy += 0.5 * DT * (fy + ty)
        vz += 0.5 * DT * (fz + tz)
        ax, ay, az = bx, by, bz
        states.append((px, py, pz, vx, vy, vz))
        if k > 0 and hold <= DT * k and max(abs(vx), abs(vy), abs(vz)) < _STILL:
            break
    return states, thrust, turn


def _force(missing: Sequence[float], weight: Sequence[float], law: Law) -> tuple[float, ...]:
    """Return the specific force [m/s²] that makes up for a missing velocity [m/s]."""
    x, y, z = missing
    gain = law.brake_gain
    x, y, z = gain * x, gain * y, gain * z
    less = min(1.0, law.brake_max / max(math.hypot(x, y), _TINY))
    z = min(max(z, -_VERTICAL), _VERTICAL)
    return less * x + weight[0], less * y + weight[1], z + weight[2]


def _thrust(
    axis: Sequence[float], force: Sequence[float], law: Law
) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
    """Return the thrust [m/s²] of a tick, its axis at the end, and how the axis turns.

    That is along what it turns towards, and across the axis [rad].
    """
    (x, y, z), (fx, fy, fz) = axis, force
    size = max(math.sqrt(fx * fx + fy * fy + fz * fz), _TINY)
    fx, fy, fz = fx / size, fy / size, fz / size
    cosine = x * fx + y * fy + z * fz
    sx, sy, sz = fx - cosine * x, fy - cosine * y, fz - cosine * z
    sine = math.sqrt(sx * sx + sy * sy + sz * sz)
    turn = min(law.attitude_gain * DT, 1.0) * math.atan2(sine, cosine)
    turn = min(turn, law.omega_max * DT)
    unit = 1.0 / max(sine, _TINY)
    along, across, share = math.cos(turn), math.sin(turn) * unit, turn * unit
    turned = along * x + across * sx, along * y + across * sy, along * z + across * sz
    c = min(max(size * cosine, law.c_min), law.c_max)
    return c, turned, (share * sx, share * sy, share * sz)


def _forces(missing: Vector, weight: Vector, law: Law) -> Vector:
    """Return what `_force` does, of n ways at once: (3,n); weight: (3,1)."""
    force = law.brake_gain * missing
    less = np.minimum(1.0, law.brake_max / np.maximum(np.hypot(force[0], force[1]), _TINY))
    force[:2] *= less
    force[2] = np.minimum(np.maximum(force[2], -_VERTICAL), _VERTICAL)
    return np.asarray(force + weight)


def _thrusts(axis: Vector, force: Vector, law: Law) -> tuple[Vector, Vector, Vector]:
    """Return what `_thrust` does, of n ways at once: (n,), (3,n), (3,n)."""
    size = np.maximum(np.sqrt((force * force).sum(axis=0)), _TINY)
    to = force / size
    cosine = (axis * to).sum(axis=0)
    side = to - cosine * axis
    sine = np.sqrt((side * side).sum(axis=0))
    turn = np.minimum(
        min(law.attitude_gain * DT, 1.0) * np.arctan2(sine, cosine), law.omega_max * DT
    )
    unit = 1.0 / np.maximum(sine, _TINY)
    turned = np.cos(turn) * axis + np.sin(turn) * unit * side
    c = np.minimum(np.maximum(size * cosine, law.c_min), law.c_max)
    return c, turned, turn * unit * side
