"""The drone as the controller sees it, eq. (1)-(3) and (5), on plain numbers.

State x = (p, v, q): position [m] and velocity [m/s] in world ENU, q_wb (w,x,y,z) body → world.
Input u = (c, omega): collective acceleration [m/s²] along +z_B and body rates [rad/s], FLU.
`disturbance` is an acceleration [m/s²], world, of everything the model leaves out: drag, wind, a
wrong thrust scale. Eq. (4), the rate dynamics, belongs to the autopilot's rate loop, not to this
model. A test compares `f` and `step` with their CasADi twins in `companion/control`.

`f` and `step` work on plain numbers: numpy costs ten times as much on ten of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.constants import GRAVITY

NX = 10
NU = 4
HOVER = np.array([GRAVITY, 0.0, 0.0, 0.0])

# s; RK4 errs by less than 1e-6 over 50 ms at the rates flown, by 1e-4 over 200 ms.
_LONGEST_STEP = 0.05
_DISTURBANCE_MAX = 3.0  # m/s², above what the airframe meets

Numbers = Sequence[float]
_NONE = (0.0, 0.0, 0.0)


def normalise(q: Vector) -> Vector:
    """Return q (..., 4) at unit length; the identity where q is zero."""
    norm = np.linalg.norm(q, axis=-1, keepdims=True)
    identity = np.array([1.0, 0.0, 0.0, 0.0])
    return np.where(norm > 0.0, q / np.where(norm > 0.0, norm, 1.0), identity)


def yaw_of(q: Vector) -> float:
    """Return the heading [rad; world ENU] of the body's x axis; q (4,) of any length."""
    w, x, y, z = (float(e) for e in q)
    return math.atan2(2.0 * (x * y + w * z), w * w + x * x - y * y - z * z)


def f(x: Numbers, u: Numbers, disturbance: Numbers = _NONE) -> tuple[float, ...]:
    """Return the time derivative (10,) of the state x (10,) under input u (4,), eq. (1)-(3)."""
    _, _, _, vx, vy, vz, w, i, j, k = x
    c, a, b, r = u
    dx, dy, dz = disturbance
    return (
        vx,
        vy,
        vz,
        2.0 * c * (i * k + w * j) + dx,
        2.0 * c * (j * k - w * i) + dy,
        c * (w * w - i * i - j * j + k * k) - GRAVITY + dz,
        -0.5 * (i * a + j * b + k * r),
        0.5 * (w * a + j * r - k * b),
        0.5 * (w * b - i * r + k * a),
        0.5 * (w * r + i * b - j * a),
    )


def step(x: Numbers, u: Numbers, dt: float, disturbance: Numbers = _NONE) -> list[float]:
    """Return the state (10,) after `dt` [s] of constant input by one RK4 step, eq. (5)."""
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
    """Return the state (10,) after `dt` >= 0 [s] of constant input u (4,), attitude renormalised.

    With it a delay is compensated: a measured state is carried to now under the input in flight.
    """
    state, inputs = x.tolist(), u.tolist()
    outside = _NONE if disturbance is None else disturbance.tolist()
    steps = max(1, math.ceil(dt / _LONGEST_STEP)) if dt > 0.0 else 0
    for _ in range(steps):
        state = step(state, inputs, dt / steps, outside)
    norm = math.hypot(*state[6:]) or 1.0
    return np.array([*state[:6], *(e / norm for e in state[6:])])


def observed_disturbance(
    disturbance: Vector, predicted_v: Vector, measured_v: Vector, dt: float, gain: float = 0.1
) -> Vector:
    """Return the disturbance (3,) m/s², corrected by the error of a predicted velocity.

    predicted_v: (3,) m/s, by `predict` from the state `dt` [s] ago under the inputs since, with
    `disturbance`. gain: per tick; at 0.1 the estimate settles within 2 s. The result is finite and
    bounded, so that a broken estimate cannot fly the drone.
    """
    corrected = disturbance + gain * (measured_v - predicted_v) / dt
    most = _DISTURBANCE_MAX
    return np.array(
        [0.0 if math.isnan(a) else min(max(a, -most), most) for a in corrected.tolist()]
    )
