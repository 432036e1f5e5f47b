"""The drone as the controller sees it, eq. (1)-(3) and (5): numpy functions and CasADi twins.

State x = (p, v, q): position [m] and velocity [m/s] in world ENU, q_wb (w,x,y,z) body → world.
Input u = (c, omega): collective acceleration [m/s²] along +z_B and body rates [rad/s], FLU.
`disturbance` is an acceleration [m/s²], world, of everything the model leaves out (drag, wind,
wrong thrust scale); zero unless somebody estimates it. Eq. (4), the rate dynamics, belongs to
the autopilot's rate loop, not to this model.

`f` and `step` work on plain numbers: on ten of them numpy costs ten times as much.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mavlink_bridge.shared.arrays import Vector

GRAVITY = 9.81
NX = 10
NU = 4
HOVER = np.array([GRAVITY, 0.0, 0.0, 0.0])

# RK4 errs by less than 1e-6 over 50 ms at the rates flown, by 1e-4 over 200 ms.
LONGEST_STEP = 0.05

Numbers = Sequence[float]
_NONE = (0.0, 0.0, 0.0)


def quaternion_product(a: Vector, b: Vector) -> Vector:
    """Hamilton product a ⊗ b."""
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def body_axes(q: Vector) -> Vector:
    """Rotation matrix (..., 3, 3) of q_wb; its columns are the body axes in the world."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    return np.stack(
        [
            np.stack([w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
            np.stack([2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)], -1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z], -1),
        ],
        axis=-2,
    )


def normalise(q: Vector) -> Vector:
    """Unit quaternion of q; the identity where q is zero."""
    norm = np.linalg.norm(q, axis=-1, keepdims=True)
    identity = np.array([1.0, 0.0, 0.0, 0.0])
    return np.where(norm > 0.0, q / np.where(norm > 0.0, norm, 1.0), identity)


def yaw_of(q: Vector) -> float:
    """Heading [rad] of the body's x axis in the horizontal plane, world ENU."""
    w, x, y, z = (float(e) for e in q)
    return math.atan2(2.0 * (x * y + w * z), w * w + x * x - y * y - z * z)


def yaw_quaternion(yaw: float) -> Vector:
    """Level attitude with the body's x axis at `yaw` [rad]."""
    return np.array([math.cos(yaw / 2.0), 0.0, 0.0, math.sin(yaw / 2.0)])


def f(x: Numbers, u: Numbers, disturbance: Numbers = _NONE) -> tuple[float, ...]:
    """Time derivative (10,) of the state, eq. (1)-(3)."""
    _, _, _, vx, vy, vz, w, i, j, k = x
    c, a, b, r = u
    dx, dy, dz = disturbance
    return (
        vx, vy, vz,
        2.0 * c * (i * k + w * j) + dx,
        2.0 * c * (j * k - w * i) + dy,
        c * (w * w - i * i - j * j + k * k) - GRAVITY + dz,
        -0.5 * (i * a + j * b + k * r),
        0.5 * (w * a + j * r - k * b),
        0.5 * (w * b - i * r + k * a),
        0.5 * (w * r + i * b - j * a),
    )  # fmt: skip


def step(x: Numbers, u: Numbers, dt: float, disturbance: Numbers = _NONE) -> list[float]:
    """State (10,) after `dt` [s] of constant input by one RK4 step, eq. (5)."""
    half = 0.5 * dt
    k1 = f(x, u, disturbance)
    k2 = f([e + half * g for e, g in zip(x, k1, strict=True)], u, disturbance)
    k3 = f([e + half * g for e, g in zip(x, k2, strict=True)], u, disturbance)
    k4 = f([e + dt * g for e, g in zip(x, k3, strict=True)], u, disturbance)
    return [
        e + dt / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        for e, a, b, c, d in zip(x, k1, k2, k3, k4, strict=True)
    ]


def predict(x: Vector, u: Vector, dt: float, disturbance: Vector | None = None) -> Vector:
    """State (10,) after `dt` [s] of constant input u (4,), any dt >= 0, attitude renormalised.

    Compensates a delay: what was measured then, under the input in flight, is this now. For
    several inputs in flight call it once for each.
    """
    state, inputs = x.tolist(), u.tolist()
    outside = _NONE if disturbance is None else disturbance.tolist()
    steps = max(1, math.ceil(dt / LONGEST_STEP)) if dt > 0.0 else 0
    for _ in range(steps):
        state = step(state, inputs, dt / steps, outside)
    norm = math.hypot(*state[6:]) or 1.0
    return np.array([*state[:6], *(e / norm for e in state[6:])])


def observed_disturbance(
    disturbance: Vector, predicted_v: Vector, measured_v: Vector, dt: float, gain: float = 0.1
) -> Vector:
    """Disturbance [m/s²] corrected by how far the velocity was from its prediction.

    predicted_v: `predict` of the state `dt` ago under the inputs since, with `disturbance`.
    With it in the model, drag and wind no longer cost cruise speed nor place at the goal. A
    gain of 0.1 per tick settles within 2 s and lets 5 % of velocity noise through as m/s per s.
    Bounded by 3 m/s², above what the airframe meets, so that a broken estimate cannot fly it.
    """
    corrected = disturbance + gain * (measured_v - predicted_v) / dt
    return np.clip(np.nan_to_num(corrected), -3.0, 3.0)
