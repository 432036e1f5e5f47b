"""Plans out of trajectories: cost, intrusion, active constraints; guesses, and the fallback."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from companion.control.nmpc.config import NmpcConfig
from companion.control.nmpc.instance import Instance
from companion.model import HOVER, NU, yaw_of
from companion.types import Plan, PlanStatus
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import quaternion_from_euler

Trajectory = tuple[Vector, Vector]

ACTIVE = 1e-3  # SI; a constraint nearer than this to its bound is named in Plan.active


def no_clock() -> float:
    """Return 0.0: the clock of a solver whose solve times are of no interest."""
    return 0.0


def shifted(plan: Trajectory, dt: float) -> Trajectory:
    """Return the plan as seen one step of `dt` [s] later; the last input is held."""
    x, u = plan
    last_x, last_u = x[-1].tolist(), u[-1].tolist()
    x = np.concatenate([x[1:], [_held(last_x, last_u, dt)]])
    return x, np.concatenate([u[1:], u[-1:]])


def _held(x: list[float], u: list[float], dt: float) -> list[float]:
    """Return the state (10,) after `dt` [s] of a held input, to second order, for a guess."""
    px, py, pz, vx, vy, vz, w, i, j, k = x
    c, a, b, r = u
    n = 1.0 / math.sqrt(w * w + i * i + j * j + k * k)
    w, i, j, k, h = w * n, i * n, j * n, k * n, 0.5 * dt
    ax, ay = c * 2.0 * (i * k + w * j), c * 2.0 * (j * k - w * i)
    az = c * (w * w - i * i - j * j + k * k) - GRAVITY
    return [
        px + dt * (vx + h * ax),
        py + dt * (vy + h * ay),
        pz + dt * (vz + h * az),
        vx + dt * ax,
        vy + dt * ay,
        vz + dt * az,
        w + h * (-i * a - j * b - k * r),
        i + h * (w * a + j * r - k * b),
        j + h * (w * b - i * r + k * a),
        k + h * (w * r + i * b - j * a),
    ]


def hover(config: NmpcConfig, x0: Vector) -> Trajectory:
    """Return the level hover at the position of x0 (10,), or at 0 where x0 is not finite."""
    state = np.zeros(10)
    state[6] = 1.0
    if np.all(np.isfinite(x0)):
        state[:3] = x0[:3]
    return np.tile(state, (config.N + 1, 1)), np.tile(HOVER, (config.N, 1))


def cold_guess(config: NmpcConfig, instance: Instance, x0: Vector) -> Trajectory:
    """Return level flight straight to the goal, at speed within a second: the first guess."""
    k = np.arange(config.N + 1)[:, None] * config.dt
    e = instance.goal - x0[:3]
    wanted = instance.speed * e / np.sqrt(e @ e + config.goal_smoothing**2)
    v = x0[3:6] + (wanted - x0[3:6]) * np.minimum(k, 1.0)
    p = x0[:3] + np.concatenate([np.zeros((1, 3)), np.cumsum(v[:-1], axis=0) * config.dt])
    q = quaternion_from_euler(0.0, 0.0, yaw_of(x0[6:10]))
    q = q if float(q @ x0[6:10]) >= 0.0 else -q
    x = np.concatenate([p, v, np.tile(q, (config.N + 1, 1))], axis=1)
    x[0] = x0
    return x, np.tile(HOVER, (config.N, 1))


def penalty(config: NmpcConfig, margins: Vector) -> float:
    """Return the penalty of all intrusions, by margins (N,rows) m."""
    deep = -np.minimum(margins, 0.0)
    return float(np.sum(config.penalty * deep + 0.5 * config.penalty_quadratic * deep**2))


def usable_plan(
    config: NmpcConfig,
    instance: Instance,
    plan: Trajectory,
    cost: float,
    margins: Vector,
    *,
    status: PlanStatus,
    iterations: int,
    step_norm: float,
    elapsed: Callable[[], float],
) -> Plan:
    """Return the Plan of a solved trajectory.

    margins (N,rows) m: of agents, cylinders, planes at 1…N; beyond M_constraint, a neighbour's row
    is switched off. cost: (29) with the penalties.
    """
    J, K = config.neighbours, config.neighbours + config.cylinders
    rows = margins.min(axis=0).tolist()
    nearest = [min(part, default=math.inf) for part in (rows[:J], rows[J:K], rows[K:])]
    names = [n for n, m in zip(("agent", "cylinder", "plane"), nearest, strict=True) if m < ACTIVE]
    x, u = plan
    return Plan(
        x=x,
        u=u,
        status=status,
        usable=True,
        iterations=iterations,
        step_norm=step_norm,
        slack_agent=max(0.0, -nearest[0]),
        slack_obstacle=max(0.0, -nearest[1]),
        slack_plane=max(0.0, -nearest[2]),
        active=(*names, *_active_inputs(config, instance.u_last, u), *_speeding(instance, x)),
        cost=cost,
        solve_time=elapsed(),
    )


def _active_inputs(config: NmpcConfig, u_last: Vector, u: Vector) -> list[str]:
    """Return the names of the bounds (33)-(36) that u (N,4) touches."""
    changes = np.abs(u - np.concatenate([u_last[None], u[:-1]])).max(axis=0).tolist()
    most, least = u.max(axis=0).tolist(), u.min(axis=0).tolist()
    touches = {
        "c": most[0] > config.c_max - ACTIVE or least[0] < config.c_min + ACTIVE,
        "omega": max(*most[1:], -min(least[1:])) > config.omega_max - ACTIVE,
        "delta_c": changes[0] > config.delta_c_max - ACTIVE,
        "delta_omega": max(changes[1:]) > config.delta_omega_max - ACTIVE,
    }
    return [name for name, active in touches.items() if active]


def _speeding(instance: Instance, x: Vector) -> list[str]:
    """Return the name of (32) where x (N+1,10) touches it."""
    v = x[1:, 3:6]
    fastest = math.sqrt(float((v * v).sum(axis=1).max()))
    return ["v_max"] if fastest > instance.v_max - ACTIVE else []


def failed_plan(
    plan: Trajectory, *, status: PlanStatus, iterations: int, solve_time: float
) -> Plan:
    """Return the Plan of a failed solve: `plan` is the fallback."""
    return Plan(
        x=plan[0],
        u=plan[1].reshape(-1, NU),
        status=status,
        usable=False,
        iterations=iterations,
        solve_time=solve_time,
        step_norm=0.0,
        slack_agent=0.0,
        slack_obstacle=0.0,
        slack_plane=0.0,
        active=(),
        cost=0.0,
    )
