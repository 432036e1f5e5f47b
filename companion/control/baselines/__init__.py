"""Controllers to compare the NMPC with: the same instance in, a plan out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from companion.control.baselines.config import BaselinesConfig, Controller
from companion.control.nmpc import Instance, Nmpc, NmpcConfig
from companion.types import Plan

__all__ = ["BaselinesConfig", "Controller", "Planner", "make_planner"]


class Planner(Protocol):
    """Plans from instances: the NMPC, or a controller in its place."""

    def solve(self, instance: Instance) -> Plan:
        """Return the plan of an instance; it never raises, and every number is finite."""
        ...

    def reset(self) -> None:
        """Forget the previous plan."""
        ...


def make_planner(
    controller: Controller,
    nmpc: NmpcConfig,
    baselines: BaselinesConfig,
    level: float,
    stopwatch: Callable[[], float],
) -> Planner:
    """Return the planner of this name; nmpc as `CompanionConfig.for_controller` has it.

    level: m; a neighbour farther above or below blocks no way. stopwatch: s, for solve times.
    """
    if controller in ("nmpc", "single-horizon"):
        return Nmpc(nmpc, stopwatch)
    from companion.control.baselines.planner import VelocityPlanner
    from companion.control.baselines.rules import make_rule

    return VelocityPlanner(
        make_rule(controller, baselines, flocking=nmpc.w_short > 0.0),
        nmpc,
        baselines.tracking,
        level,
        stopwatch,
    )
