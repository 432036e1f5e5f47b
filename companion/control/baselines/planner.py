"""A rule in place of the NMPC: its velocity is bounded and tracked, or its input is made a plan."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from companion.control.baselines.config import TrackingConfig
from companion.control.baselines.rules import InputRule, Rule
from companion.control.baselines.surroundings import Surroundings
from companion.control.nmpc import Instance, NmpcConfig
from companion.model import HOVER, yaw_of
from companion.types import Plan, PlanStatus
from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import rotation_matrix


class _OneInput:
    """Plans of one input for now, followed by straight flight."""

    def __init__(self, nmpc: NmpcConfig, level: float, stopwatch: Callable[[], float]) -> None:
        """level: m; neighbours farther above or below do not count."""
        self._nmpc = nmpc
        self._level = level
        self._stopwatch = stopwatch

    def reset(self) -> None:
        """Do nothing: a rule has no memory."""

    def _plan(
        self, instance: Instance, v: Vector, now: Vector, usable: bool, started: float
    ) -> Plan:
        n, dt = self._nmpc.N, self._nmpc.dt
        u = np.tile(HOVER, (n, 1))
        x = np.tile(instance.x0 if usable else np.eye(10)[6], (n + 1, 1))
        if usable:
            x[:, :3] += np.arange(n + 1)[:, None] * dt * v
            x[1:, 3:6] = v
            u[0] = self._within(now)
        return Plan(
            x=x,
            u=u,
            status=PlanStatus.SOLVED if usable else PlanStatus.NOT_FINITE,
            usable=usable,
            iterations=1,
            solve_time=self._stopwatch() - started,
            step_norm=0.0,
            slack_agent=0.0,
            slack_obstacle=0.0,
            slack_plane=0.0,
            active=(),
            cost=0.0,
        )

    def _within(self, u: Vector) -> Vector:
        """Return the input (4,) within (35), (36)."""
        c = self._nmpc
        low = np.array([c.c_min, *[-c.omega_max] * 3])
        return np.clip(u, low, np.array([c.c_max, *[c.omega_max] * 3]))


class InputPlanner(_OneInput):
    """Plans by one input (c, ω) of a rule per tick."""

    def __init__(
        self,
        rule: InputRule,
        nmpc: NmpcConfig,
        level: float,
        stopwatch: Callable[[], float],
    ) -> None:
        super().__init__(nmpc, level, stopwatch)
        self._rule = rule

    def solve(self, instance: Instance) -> Plan:
        """Return a plan of the rule's input, followed by straight flight."""
        started = self._stopwatch()
        u, finite = HOVER, instance.finite()
        if finite:
            around = Surroundings.of(instance, self._nmpc, self._level)
            u = np.asarray(self._rule.command(around, instance), float)
            finite = u.shape == HOVER.shape and bool(np.isfinite(u).all())
        return self._plan(instance, instance.x0[3:6], u, finite, started)


class VelocityPlanner(_OneInput):
    """Plans by one velocity of a rule per tick."""

    def __init__(
        self,
        rule: Rule,
        nmpc: NmpcConfig,
        tracking: TrackingConfig,
        level: float,
        stopwatch: Callable[[], float],
    ) -> None:
        super().__init__(nmpc, level, stopwatch)
        self._rule = rule
        self._tracking = tracking

    def reset(self) -> None:
        """Have the rule forget what it remembers, if it does."""
        if forget := getattr(self._rule, "reset", None):
            forget()

    def solve(self, instance: Instance) -> Plan:
        """Return a plan of the command for now, followed by straight flight."""
        started = self._stopwatch()
        finite = instance.finite()
        v = np.zeros(3)
        if finite:
            around = Surroundings.of(instance, self._nmpc, self._level)
            v[:2] = bounded(self._rule.velocity(around), around.fastest)
            v[2] = self._climb(instance)
            finite = bool(np.isfinite(v).all())
        now = tracking_command(v, instance, self._tracking) if finite else HOVER
        return self._plan(instance, v, now, finite, started)

    def _climb(self, instance: Instance) -> float:
        """Return the vertical velocity [m/s] towards the goal's height."""
        c = self._tracking
        wanted = c.climb_gain * float(instance.goal[2] - instance.x0[2])
        return min(max(wanted, -c.climb_max), c.climb_max)


def bounded(v: Vector, most: float) -> Vector:
    """Return v, shortened to `most` where it is longer."""
    size = norm(v)
    return v if size <= most else v * (most / size)


def tracking_command(v: Vector, instance: Instance, config: TrackingConfig) -> Vector:
    """Return the input (4,) c, omega that tracks velocity v (3,) m/s at the instance's yaw.

    The law is that of Lee et al., "Geometric tracking control of a quadrotor UAV on SE(3)", 2010,
    reduced to rates: tilt and yaw turn in proportion to their errors from the wanted specific
    force, less the disturbance.
    """
    x = instance.x0
    horizontal = bounded(config.velocity_gain * (v[:2] - x[3:5]), config.acceleration_max)
    vertical = config.velocity_gain * float(v[2] - x[5])
    force = np.array([horizontal[0], horizontal[1], GRAVITY + vertical]) - instance.disturbance
    r = rotation_matrix(x[6:10])
    wanted = r.T @ (force / max(norm(force), 1e-6))
    tilt = math.atan2(math.hypot(wanted[0], wanted[1]), wanted[2])
    axis = np.array([-wanted[1], wanted[0]]) / max(math.hypot(wanted[0], wanted[1]), 1e-9)
    off = instance.yaw - yaw_of(x[6:10])
    turn = config.yaw_gain * math.atan2(math.sin(off), math.cos(off))
    return np.array([float(force @ r[:, 2]), *(config.attitude_gain * tilt * axis), turn])
