"""Controllers to compare the NMPC with, and those of users: the same instance in, a plan out."""

from __future__ import annotations

from typing import Protocol

from companion.control.baselines.config import BaselinesConfig
from companion.control.baselines.controllers import (
    CONTROLLERS,
    ControllerSetup,
    is_rule,
)
from companion.control.nmpc import Instance
from companion.types import Plan

__all__ = [
    "CONTROLLERS",
    "BaselinesConfig",
    "ControllerSetup",
    "Planner",
    "is_rule",
    "make_planner",
]


class Planner(Protocol):
    """Plans from instances: the NMPC, or a controller in its place."""

    def solve(self, instance: Instance) -> Plan:
        """Return the plan of an instance; it never raises, and every number is finite."""
        ...

    def reset(self) -> None:
        """Forget the previous plan."""
        ...


def make_planner(controller: str, setup: ControllerSetup) -> Planner:
    """Return the planner of this name; the setup is that of `CompanionConfig.for_controller`.

    Raises:
        PartError, SettingsError: the controller cannot be used.
    """
    made = CONTROLLERS.load(controller)(setup)
    if hasattr(made, "solve"):
        planner: Planner = made
        return planner
    from companion.control.baselines.planner import InputPlanner, VelocityPlanner

    if hasattr(made, "command"):
        return InputPlanner(made, setup.nmpc, setup.level, setup.stopwatch)
    return VelocityPlanner(made, setup.nmpc, setup.baselines.tracking, setup.level, setup.stopwatch)
