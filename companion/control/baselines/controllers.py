"""The controllers by name, packaged and of users: `controller` of a drone's file.

A controller is called with a `ControllerSetup`. It either plans by itself (`solve` and `reset`, a
`Planner`), gives a velocity (`velocity`, a `Rule`), which is tracked as for all rules, or gives
thrust and body rates (`command`, an `InputRule`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from companion.control.baselines.config import BaselinesConfig
from companion.control.nmpc import Nmpc, NmpcConfig
from mavlink_bridge.shared.parts import PartKind
from mavlink_bridge.shared.settings import SettingsError

_HERE = "companion.control.baselines"
_RULES = {
    "reynolds": f"{_HERE}.controllers:reynolds",
    "vasarhelyi": f"{_HERE}.controllers:vasarhelyi",
    "potential-field": f"{_HERE}.controllers:potential_field",
    "orca": f"{_HERE}.controllers:orca",
    "rbl": f"{_HERE}.controllers:rbl",
    "avocado": f"{_HERE}.controllers:avocado",
}
CONTROLLERS = PartKind(
    "controller",
    "swarm_companion.controllers",
    {
        "nmpc": f"{_HERE}.controllers:nmpc",
        "single-horizon": f"{_HERE}.controllers:nmpc",
        **_RULES,
    },
    (frozenset({"solve", "reset"}), frozenset({"velocity"}), frozenset({"command"})),
)


@dataclass(frozen=True)
class ControllerSetup:
    """What a controller is made from.

    nmpc: sizes, bounds and periods of the instances. baselines: settings of the packaged rules.
    level: m; a neighbour farther above or below blocks no way. stopwatch: s, for solve times alone.
    options: `controller_options` of the drone's file, as written.
    """

    nmpc: NmpcConfig
    baselines: BaselinesConfig
    level: float
    stopwatch: Callable[[], float]
    options: Mapping[str, Any]


def is_rule(name: str) -> bool:
    """Return whether the controller of this name is a rule, of velocities or of inputs."""
    if name in CONTROLLERS.packaged:
        return name in _RULES
    made = CONTROLLERS.load(name)
    return hasattr(made, "velocity") or hasattr(made, "command")


def nmpc(setup: ControllerSetup) -> Any:
    """Return the NMPC; both horizons are in its configuration."""
    return Nmpc(setup.nmpc, setup.stopwatch)


def reynolds(setup: ControllerSetup) -> Any:
    """Return the rule of Reynolds, with cohesion where the drones stay together."""
    from companion.control.baselines.rules import Reynolds

    return Reynolds(setup.baselines.reynolds, flocking=setup.nmpc.w_short > 0.0)


def vasarhelyi(setup: ControllerSetup) -> Any:
    """Return the rule of Vásárhelyi et al."""
    from companion.control.baselines.rules import Vasarhelyi

    return Vasarhelyi(setup.baselines.vasarhelyi)


def potential_field(setup: ControllerSetup) -> Any:
    """Return the potential field of Khatib."""
    from companion.control.baselines.rules import PotentialField

    return PotentialField(setup.baselines.potential_field, setup.baselines.radius)


def rbl(setup: ControllerSetup) -> Any:
    """Return the rule-based Lloyd algorithm."""
    from companion.control.baselines.rbl import Rbl

    return Rbl(setup.baselines.rbl, setup.baselines.radius)


def avocado(setup: ControllerSetup) -> Any:
    """Return AVOCADO, avoidance by an opinion of each neighbour."""
    from companion.control.baselines.avocado import Avocado

    return Avocado(setup.baselines.avocado)


def orca(setup: ControllerSetup) -> Any:
    """Return ORCA.

    Raises:
        SettingsError: the package that it needs is missing.
    """
    try:
        from companion.control.baselines.orca import Orca
    except ImportError:
        why = "controller: orca needs pyrvo: pip install 'swarm-companion[studies]'"
        raise SettingsError([why]) from None
    return Orca(setup.baselines.orca)
