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

from companion.supervision.certificate import DT, Trajectories
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import rotation_matrix

STEPS = 16  # of DT: the longest way is at rest by then
_CLIMB = 0.8  # m/s, up or down
_SIDES = 8
_STILL = 0.05  # m/s: a way this slow has ended
_VERTICAL = 3.0  # m/s², most that height is corrected by
_TINY = 1e-9


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
    start: list[float] = [*x0[:6].tolist(), *r[:, 2].tolist()]
    wx, wy, wz = wind.tolist()
    weight = -wx, -wy, GRAVITY - wz
    command = None
    if first is not None:
        command = (float(first[0]), *(DT * (r @ [first[2], -first[1], 0.0])).tolist())
    places, speeds = np.empty((n, STEPS + 1, 3)), np.empty((n, STEPS + 1, 3))
    u = np.zeros((n, 4))
    # Plain numbers: most often there is one way, of which arrays take eight times as long.
    for k, (velocity, hold) in enumerate(
        zip(ways.velocity.tolist(), ways.hold.tolist(), strict=True)
    ):
        states, c, turn = _flown(start, velocity, hold, weight, law, command)
        rows, count = np.array(states), len(states)
        places[k, :count], speeds[k, :count] = rows[:, :3], rows[:, 3:]
        places[k, count:], speeds[k, count:] = rows[-1, :3], 0.0
        u[k, 0] = c
        u[k, 1:4] = r.T @ turn / DT
    u[:, 3] += law.yaw_rate
    np.clip(u[:, 1:4], -law.omega_max, law.omega_max, out=u[:, 1:4])
    if first is not None:
        u[:] = first
    return Trajectories(u, places, speeds)


def _flown(
    start: Sequence[float],
    wanted: Sequence[float],
    hold: float,
    weight: tuple[float, float, float],
    law: Law,
    command: tuple[float, float, float, float] | None,
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
