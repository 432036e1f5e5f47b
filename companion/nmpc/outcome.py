"""What a plan amounts to: cost, intrusion, the constraints it leans on; and the fallback plan."""

from __future__ import annotations

import numpy as np

from companion.model import HOVER, NU, Vector, step, yaw_of, yaw_quaternion
from companion.nmpc.config import NmpcConfig
from companion.nmpc.instance import Instance
from companion.nmpc.result import Result, Status

Plan = tuple[Vector, Vector]

# A constraint nearer than this to its bound is named in Result.active.
ACTIVE = 1e-3


def shifted(plan: Plan, steps: int, dt: float) -> Plan:
    """The plan as seen `steps` ticks later; the last input is held."""
    x, u = plan
    for _ in range(steps):
        x = np.concatenate([x[1:], step(x[-1], u[-1], dt)[None]])
        u = np.concatenate([u[1:], u[-1:]])
    return x, u


def hover(config: NmpcConfig, x0: Vector) -> Plan:
    """Staying where one is, level; also what stands in for a state that is not finite."""
    state = np.zeros(10)
    state[6] = 1.0
    if np.all(np.isfinite(x0)):
        state[:3] = x0[:3]
    return np.tile(state, (config.N + 1, 1)), np.tile(HOVER, (config.N, 1))


def cold_guess(config: NmpcConfig, instance: Instance, x0: Vector) -> Plan:
    """Where nothing is known: level flight straight to the goal, at speed within a second."""
    k = np.arange(config.N + 1)[:, None] * config.dt
    e = instance.goal - x0[:3]
    wanted = instance.speed * e / np.sqrt(e @ e + config.goal_smoothing**2)
    v = x0[3:6] + (wanted - x0[3:6]) * np.minimum(k, 1.0)
    p = x0[:3] + np.concatenate([np.zeros((1, 3)), np.cumsum(v[:-1], axis=0) * config.dt])
    q = yaw_quaternion(yaw_of(x0[6:10]))
    q = q if float(q @ x0[6:10]) >= 0.0 else -q
    x = np.concatenate([p, v, np.tile(q, (config.N + 1, 1))], axis=1)
    x[0] = x0
    return x, np.tile(HOVER, (config.N, 1))


def penalised(config: NmpcConfig, intrusion: Vector) -> float:
    """Penalty of the largest intrusions [m] per stage and kind."""
    return float(np.sum(config.penalty * intrusion + 0.5 * config.penalty_quadratic * intrusion**2))


def judged(
    config: NmpcConfig,
    instance: Instance,
    plan: Plan,
    cost: float,
    margins: Vector,
    *,
    status: Status,
    iterations: int,
    solve_time: float,
    step_norm: float,
) -> Result:
    """Result of a usable plan. margins (N, rows): agents, cylinders, planes at 1…N."""
    J, K = config.neighbours, config.cylinders
    agents = margins[: config.M_constraint, :J]
    cylinders, planes = margins[:, J : J + K], margins[:, J + K :]
    of_agents, of_obstacles = np.zeros(config.N), np.zeros(config.N)
    of_agents[: config.M_constraint] = agents.min(axis=1, initial=0.0)
    np.minimum(margins[:, J:].min(axis=1, initial=0.0), 0.0, out=of_obstacles)
    intrusion = -np.concatenate([of_agents, of_obstacles])
    nearest = [float(part.min(initial=np.inf)) for part in (agents, cylinders, planes)]
    names = [n for n, m in zip(("agent", "cylinder", "plane"), nearest, strict=True) if m < ACTIVE]
    x, u = plan
    return Result(
        x=x,
        u=u,
        status=status,
        usable=True,
        iterations=iterations,
        solve_time=solve_time,
        step_norm=step_norm,
        slack_agent=max(0.0, -nearest[0]),
        slack_obstacle=max(0.0, -nearest[1]),
        slack_plane=max(0.0, -nearest[2]),
        active=(*names, *_active_inputs(config, instance.u_last, u), *_speeding(config, x)),
        cost=cost + penalised(config, intrusion),
    )


def _active_inputs(config: NmpcConfig, u_last: Vector, u: Vector) -> list[str]:
    changes = np.abs(np.diff(u, axis=0, prepend=u_last[None]))
    most, least, change = u.max(axis=0), u.min(axis=0), changes.max(axis=0)
    leaning = {
        "c": most[0] > config.c_max - ACTIVE or least[0] < config.c_min + ACTIVE,
        "omega": max(most[1:].max(), -least[1:].min()) > config.omega_max - ACTIVE,
        "delta_c": change[0] > config.delta_c_max - ACTIVE,
        "delta_omega": change[1:].max() > config.delta_omega_max - ACTIVE,
    }
    return [name for name, leans in leaning.items() if leans]


def _speeding(config: NmpcConfig, x: Vector) -> list[str]:
    speed = float(np.sqrt((x[1:, 3:6] ** 2).sum(axis=1).max()))
    return ["v_max"] if speed > config.v_max - ACTIVE else []


def failed(plan: Plan, *, status: Status, iterations: int, solve_time: float) -> Result:
    """Result of a solve that gave nothing: `plan` is the fallback."""
    return Result(
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
