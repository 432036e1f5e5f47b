"""CasADi twins of the model in `companion/model.py`, eq. (1)-(3), (5); a test compares them."""

from __future__ import annotations

import casadi as ca

from mavlink_bridge.shared.constants import GRAVITY


def casadi_f(x: ca.SX, u: ca.SX, disturbance: ca.SX) -> ca.SX:
    """Return the time derivative (10,1) of state x (10,1): the twin of `f`."""
    w, i, j, k = x[6], x[7], x[8], x[9]
    c, a, b, r = u[0], u[1], u[2], u[3]
    z_body = ca.vertcat(2 * (i * k + w * j), 2 * (j * k - w * i), w * w - i * i - j * j + k * k)
    spin = 0.5 * ca.vertcat(
        -i * a - j * b - k * r,
        w * a + j * r - k * b,
        w * b - i * r + k * a,
        w * r + i * b - j * a,
    )
    gravity = ca.vertcat(0, 0, -GRAVITY)
    return ca.vertcat(x[3:6], c * z_body + gravity + disturbance, spin)


def casadi_step(x: ca.SX, u: ca.SX, dt: float, disturbance: ca.SX) -> ca.SX:
    """Return the state (10,1) after `dt` [s] by one RK4 step: the twin of `step`."""
    k1 = casadi_f(x, u, disturbance)
    k2 = casadi_f(x + 0.5 * dt * k1, u, disturbance)
    k3 = casadi_f(x + 0.5 * dt * k2, u, disturbance)
    k4 = casadi_f(x + dt * k3, u, disturbance)
    return x + dt / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)
