"""The autopilot's outer loops at 100 Hz: position → velocity → attitude → body rates.

World ENU, body FLU, SI. The setpoints of each vehicle are a row of `Setpoints`; the loops use the
autopilot's estimate, never the truth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mavlink_bridge.shared.constants import GRAVITY

Floats = NDArray[np.float64]

OUTER_PERIOD = 0.01  # s
I_LIMIT_XY, I_LIMIT_Z = 3.0, 5.0  # m/s², limits of the velocity loop's I term
UP_LIMIT, DOWN_LIMIT = 8.0, 5.0  # m/s², vertical acceleration
FOLLOW = 0.5  # s, in which the I term follows a pilot's thrust
RATE_LIMIT, YAW_RATE_LIMIT = 3.5, 1.5  # rad/s


class Control(IntEnum):
    """Which setpoints the loops follow."""

    OFF = 0  # motors stopped
    IDLE = 1  # motors at idle, on the ground
    RATES = 2  # body rates and thrust
    RATES_AND_CLIMB = 3  # body rates, and v[2] as climb rate
    LEVEL = 4  # level attitude, yaw, and v[2] as climb rate
    POSITION = 5  # position, or velocity where the position is NaN
    ATTITUDE = 6  # attitude q and thrust, and v[2] as yaw rate that is added


OFF, IDLE, RATES, RATES_AND_CLIMB, LEVEL, POSITION, ATTITUDE = (int(c) for c in Control)


@dataclass(frozen=True)
class OuterGains:
    """position: 1/s (xy, z); velocity: 1/s; integral: 1/s²; attitude: 1/s (tilt, yaw)."""

    position: tuple[float, float] = (1.0, 1.2)
    velocity: tuple[float, float] = (3.0, 5.0)
    integral: tuple[float, float] = (0.8, 2.0)
    attitude: tuple[float, float] = (7.0, 2.5)
    tilt_max: float = math.radians(35.0)


class Setpoints(NamedTuple):
    """Setpoints of n vehicles.

    control (n,): a `Control`. omega (n,3) rad/s. thrust (n,) 0…1. p (n,3) m, NaN where only the
    velocity v (n,3) m/s counts (else v is fed forward). yaw (n,) rad, 0 = east. limits (n,3):
    speed [m/s] along the ground, up, down. hover (n,): hover thrust that the autopilot assumes.
    integral (n,3) m/s²: I term of the velocity loop. q (n,4): attitude, body → world.
    """

    control: NDArray[np.int64]
    omega: Floats
    thrust: Floats
    p: Floats
    v: Floats
    yaw: Floats
    limits: Floats
    hover: Floats
    integral: Floats
    gains: Floats
    q: Floats


def make_setpoints(hover: Floats, gains: OuterGains) -> Setpoints:
    """Return setpoints of n vehicles with their motors off; hover: (n,) hover thrust 0…1."""
    n = len(hover)
    row = [*gains.position, *gains.velocity, *gains.integral, *gains.attitude, gains.tilt_max]
    return Setpoints(
        control=np.zeros(n, dtype=np.int64),
        omega=np.zeros((n, 3)),
        thrust=np.zeros(n),
        p=np.full((n, 3), np.nan),
        v=np.zeros((n, 3)),
        yaw=np.zeros(n),
        limits=np.tile([5.0, 3.0, 1.5], (n, 1)),
        hover=np.array(hover, dtype=np.float64),
        integral=np.zeros((n, 3)),
        gains=np.tile(np.array(row), (n, 1)),
        q=np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
    )


@njit(cache=True)
def _turn_to(i: int, sp: Setpoints, q: Floats, k_tilt: float, k_yaw: float) -> None:
    """Compute sp.omega[i], which turns the vehicle from q[i] to sp.q[i] by the shortest way."""
    a0, a1, a2, a3 = q[i]
    b0, b1, b2, b3 = sp.q[i]
    e0 = a0 * b0 + a1 * b1 + a2 * b2 + a3 * b3  # conjugate of q[i], times sp.q[i]
    e1 = a0 * b1 - a1 * b0 - a2 * b3 + a3 * b2
    e2 = a0 * b2 + a1 * b3 - a2 * b0 - a3 * b1
    e3 = a0 * b3 - a1 * b2 + a2 * b1 - a3 * b0
    way = 2.0 if e0 >= 0.0 else -2.0
    yaw = min(max(way * e3 * k_yaw, -YAW_RATE_LIMIT), YAW_RATE_LIMIT) + sp.v[i, 2]
    sp.omega[i, 0] = min(max(way * e1 * k_tilt, -RATE_LIMIT), RATE_LIMIT)
    sp.omega[i, 1] = min(max(way * e2 * k_tilt, -RATE_LIMIT), RATE_LIMIT)
    sp.omega[i, 2] = min(max(yaw, -RATE_LIMIT), RATE_LIMIT)


@njit(cache=True)
def _follow_thrust(i: int, sp: Setpoints, q: Floats, dt: float) -> None:
    """Let the I term follow the thrust that a pilot gives, so that the next mode begins smoothly.

    Autopilots begin so: ArduCopter's AC_PosControl::relax_z_controller sets the I term to the
    throttle in flight.
    """
    upright = 1.0 - 2.0 * (q[i, 1] * q[i, 1] + q[i, 2] * q[i, 2])
    lift = GRAVITY * (sp.thrust[i] / sp.hover[i] * max(upright, 0.5) - 1.0)
    lift = min(max(lift, -I_LIMIT_Z), I_LIMIT_Z)
    sp.integral[i, 0] = sp.integral[i, 1] = 0.0
    sp.integral[i, 2] += (lift - sp.integral[i, 2]) * dt / FOLLOW


@njit(cache=True)
def outer_loop(i: int, sp: Setpoints, p: Floats, v: Floats, q: Floats, dt: float) -> None:
    """Compute sp.omega[i] and sp.thrust[i] from the estimates p (n,3), v (n,3), q (n,4)."""
    control = sp.control[i]
    if control <= IDLE:
        sp.integral[i] = 0.0
        return
    k_p, k_pz, k_v, k_vz, k_i, k_iz, k_tilt, k_yaw, tilt_max = sp.gains[i]
    if control in (RATES, ATTITUDE):
        _follow_thrust(i, sp, q, dt)
        if control == ATTITUDE:
            _turn_to(i, sp, q, k_tilt, k_yaw)
        return

    # Position → velocity, as fast as allowed.
    vx, vy, vz = sp.v[i]
    if control == POSITION and not math.isnan(sp.p[i, 0]):
        vx += k_p * (sp.p[i, 0] - p[i, 0])
        vy += k_p * (sp.p[i, 1] - p[i, 1])
    if control == POSITION and not math.isnan(sp.p[i, 2]):
        vz += k_pz * (sp.p[i, 2] - p[i, 2])
    along = math.sqrt(vx * vx + vy * vy)
    if along > sp.limits[i, 0]:
        vx, vy = vx * sp.limits[i, 0] / along, vy * sp.limits[i, 0] / along
    vz = min(max(vz, -sp.limits[i, 2]), sp.limits[i, 1])

    # Velocity → acceleration.
    ex, ey, ez = vx - v[i, 0], vy - v[i, 1], vz - v[i, 2]
    sp.integral[i, 2] = min(max(sp.integral[i, 2] + k_iz * ez * dt, -I_LIMIT_Z), I_LIMIT_Z)
    az = min(max(k_vz * ez + sp.integral[i, 2], -DOWN_LIMIT), UP_LIMIT)
    q0, q1, q2, q3 = q[i]
    upright = 1.0 - 2.0 * (q1 * q1 + q2 * q2)
    if control == RATES_AND_CLIMB:
        force = (GRAVITY + az) / max(upright, 0.5)
        sp.thrust[i] = min(max(sp.hover[i] * force / GRAVITY, 0.0), 1.0)
        return
    ax = ay = 0.0
    if control == POSITION:
        sp.integral[i, 0] += k_i * ex * dt
        sp.integral[i, 1] += k_i * ey * dt
        size = math.sqrt(sp.integral[i, 0] ** 2 + sp.integral[i, 1] ** 2)
        if size > I_LIMIT_XY:
            sp.integral[i, 0] *= I_LIMIT_XY / size
            sp.integral[i, 1] *= I_LIMIT_XY / size
        ax = k_v * ex + sp.integral[i, 0]
        ay = k_v * ey + sp.integral[i, 1]

    # Acceleration → thrust direction within the tilt limit, and thrust along the present one.
    fz = GRAVITY + az
    size, limit = math.sqrt(ax * ax + ay * ay), fz * math.tan(tilt_max)
    if size > limit:
        ax, ay = ax * limit / size, ay * limit / size
    bx, by = 2.0 * (q1 * q3 + q0 * q2), 2.0 * (q2 * q3 - q0 * q1)
    force = ax * bx + ay * by + fz * max(upright, 0.5)
    sp.thrust[i] = min(max(sp.hover[i] * force / GRAVITY, 0.0), 1.0)

    # Attitude → rates: turn the body's z axis to the wanted one by the shortest way …
    size = math.sqrt(ax * ax + ay * ay + fz * fz)
    ax, ay, az = ax / size, ay / size, fz / size
    wx, wy, wz = by * az - upright * ay, upright * ax - bx * az, bx * ay - by * ax
    sine, cosine = math.sqrt(wx * wx + wy * wy + wz * wz), bx * ax + by * ay + upright * az
    turn = math.atan2(sine, cosine) / sine if sine > 1e-9 else 1.0
    wx, wy, wz = wx * turn * k_tilt, wy * turn * k_tilt, wz * turn * k_tilt
    # … and the heading about the vertical.
    heading = math.atan2(2.0 * (q1 * q2 + q0 * q3), 1.0 - 2.0 * (q2 * q2 + q3 * q3))
    off = sp.yaw[i] - heading
    off -= 2.0 * math.pi * math.floor(off / (2.0 * math.pi) + 0.5)
    wz += min(max(k_yaw * off, -YAW_RATE_LIMIT), YAW_RATE_LIMIT)
    ox = (1 - 2 * (q2 * q2 + q3 * q3)) * wx + 2 * (q1 * q2 + q0 * q3) * wy
    ox += 2 * (q1 * q3 - q0 * q2) * wz
    oy = 2 * (q1 * q2 - q0 * q3) * wx + (1 - 2 * (q1 * q1 + q3 * q3)) * wy
    oy += 2 * (q2 * q3 + q0 * q1) * wz
    oz = bx * wx + by * wy + upright * wz
    sp.omega[i, 0] = min(max(ox, -RATE_LIMIT), RATE_LIMIT)
    sp.omega[i, 1] = min(max(oy, -RATE_LIMIT), RATE_LIMIT)
    sp.omega[i, 2] = min(max(oz, -RATE_LIMIT), RATE_LIMIT)
