"""A rule for the velocity in the NMPC's place: bounded, tracked, and written down as a plan."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from companion.control.baselines.config import TrackingConfig
from companion.control.baselines.rules import Rule
from companion.control.baselines.surroundings import Surroundings
from companion.control.nmpc import Instance, NmpcConfig
from companion.model import HOVER, yaw_of
from companion.types import Plan, PlanStatus
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.shared.thrust import G


class VelocityPlanner:
    """Asks the rule once a tick."""

    def __init__(
        self,
        rule: Rule,
        nmpc: NmpcConfig,
        tracking: TrackingConfig,
        level: float,
        stopwatch: Callable[[], float],
    ) -> None:
        self._rule = rule
        self._nmpc = nmpc
        self._tracking = tracking
        self._level = level
        self._stopwatch = stopwatch

    def reset(self) -> None:
        """A rule remembers nothing."""

    def solve(self, instance: Instance) -> Plan:
        """The command for now; the plan behind it flies straight on."""
        started = self._stopwatch()
        finite = instance.finite()
        v = np.zeros(3)
        if finite:
            around = Surroundings.of(instance, self._nmpc, self._level)
            v[:2] = bounded(self._rule.velocity(around), around.fastest)
            v[2] = self._climb(instance)
            finite = bool(np.isfinite(v).all())
        return self._plan(instance, v, finite, started)

    def _climb(self, instance: Instance) -> float:
        c = self._tracking
        wanted = c.climb_gain * float(instance.goal[2] - instance.x0[2])
        return min(max(wanted, -c.climb_max), c.climb_max)

    def _plan(self, instance: Instance, v: Vector, usable: bool, started: float) -> Plan:
        n, dt = self._nmpc.N, self._nmpc.dt
        u = np.tile(HOVER, (n, 1))
        x = np.tile(instance.x0 if usable else np.eye(10)[6], (n + 1, 1))
        if usable:
            x[:, :3] += np.arange(n + 1)[:, None] * dt * v
            x[1:, 3:6] = v
            u[0] = self._bounded(track(v, instance, self._tracking))
        return Plan(
            x=x, u=u, status=PlanStatus.SOLVED if usable else PlanStatus.NOT_FINITE, usable=usable,
            iterations=1, solve_time=self._stopwatch() - started, step_norm=0.0,
            slack_agent=0.0, slack_obstacle=0.0, slack_plane=0.0, active=(), cost=0.0,
        )  # fmt: skip

    def _bounded(self, u: Vector) -> Vector:
        c = self._nmpc
        low = np.array([c.c_min, *[-c.omega_max] * 3])
        return np.clip(u, low, np.array([c.c_max, *[c.omega_max] * 3]))


def bounded(v: Vector, most: float) -> Vector:
    """`v` no longer than `most`."""
    size = float(np.linalg.norm(v))
    return v if size <= most else v * (most / size)


def track(v: Vector, instance: Instance, config: TrackingConfig) -> Vector:
    """(4,) c, omega that bring the drone to velocity v (3,) m/s, looking along the instance's yaw.

    Lee's geometric law reduced to rates: the wanted specific force, tilted and turned to in
    proportion to what is missing; the disturbance is taken off.
    """
    x = instance.x0
    horizontal = bounded(config.velocity_gain * (v[:2] - x[3:5]), config.acceleration_max)
    vertical = config.velocity_gain * float(v[2] - x[5])
    force = np.array([horizontal[0], horizontal[1], G + vertical]) - instance.disturbance
    r = rotation_matrix(x[6:10])
    wanted = r.T @ (force / max(float(np.linalg.norm(force)), 1e-6))
    tilt = math.atan2(math.hypot(wanted[0], wanted[1]), wanted[2])
    axis = np.array([-wanted[1], wanted[0]]) / max(math.hypot(wanted[0], wanted[1]), 1e-9)
    off = instance.yaw - yaw_of(x[6:10])
    turn = config.yaw_gain * math.atan2(math.sin(off), math.cos(off))
    return np.array([float(force @ r[:, 2]), *(config.attitude_gain * tilt * axis), turn])
