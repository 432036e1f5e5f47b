"""Controllers to compare the NMPC with: the same instance in, a plan out; one option chooses."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from companion.baselines.config import BaselinesConfig, Controller
from companion.nmpc import Instance, Nmpc, Result

if TYPE_CHECKING:
    from companion.config import CompanionConfig

__all__ = ["BaselinesConfig", "Controller", "Planner", "adapted", "make_planner"]

_NEIGHBOURS = 12  # flocking rules sum over all that are seen, not over the most critical


class Planner(Protocol):
    """What plans: the NMPC or what stands in its place."""

    def solve(self, instance: Instance) -> Result:
        """Plan from the instance; never raises, never gives a non-finite number."""
        ...

    def reset(self) -> None:
        """Forget what was planned before."""
        ...


def adapted(config: CompanionConfig) -> CompanionConfig:
    """The configuration as its `controller` needs it.

    single-horizon: cohesion and distance over all of N, the conventional NMPC. Rules for the
    velocity are told of every neighbour in view, as it flies and where the goal is: they make way
    in their own manner.
    """
    if config.controller == "nmpc":
        return config
    if config.controller == "single-horizon":
        whole = {"M": config.nmpc.N, "M_constraint": config.nmpc.N}
        return config.model_copy(update={"nmpc": config.nmpc.model_copy(update=whole)})
    return config.model_copy(
        update={
            "nmpc": config.nmpc.model_copy(update={"neighbours": _NEIGHBOURS}),
            "threat": config.threat.model_copy(update={"critical": _NEIGHBOURS, "keep_right": 0.0}),
            "reciprocity": config.reciprocity.model_copy(update={"share": 0.0}),
        }
    )


def make_planner(config: CompanionConfig, stopwatch: Callable[[], float]) -> Planner:
    """The controller that the (adapted) configuration names."""
    if config.controller in ("nmpc", "single-horizon"):
        return Nmpc(config.nmpc, stopwatch)
    from companion.baselines.planner import VelocityPlanner
    from companion.baselines.rules import rule

    return VelocityPlanner(
        rule(config.controller, config.baselines, flocking=config.nmpc.w_short > 0.0),
        config.nmpc,
        config.baselines.tracking,
        config.threat.level,
        stopwatch,
    )
