"""Controllers to compare the NMPC with: the same instance in, a plan out; one option chooses."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from companion.control.baselines.config import BaselinesConfig, Controller
from companion.control.nmpc import Instance, Nmpc, NmpcConfig
from companion.types import Plan

__all__ = ["BaselinesConfig", "Controller", "Planner", "make_planner"]


class Planner(Protocol):
    """What plans: the NMPC or what stands in its place."""

    def solve(self, instance: Instance) -> Plan:
        """Plan from the instance; never raises, never gives a non-finite number."""
        ...

    def reset(self) -> None:
        """Forget what was planned before."""
        ...


def make_planner(
    controller: Controller,
    nmpc: NmpcConfig,
    baselines: BaselinesConfig,
    level: float,
    stopwatch: Callable[[], float],
) -> Planner:
    """The controller of this name; nmpc as `adapted` to it.

    level: m; a neighbour farther above or below is in nobody's way.
    """
    if controller in ("nmpc", "single-horizon"):
        return Nmpc(nmpc, stopwatch)
    from companion.control.baselines.planner import VelocityPlanner
    from companion.control.baselines.rules import rule

    return VelocityPlanner(
        rule(controller, baselines, flocking=nmpc.w_short > 0.0),
        nmpc,
        baselines.tracking,
        level,
        stopwatch,
    )
