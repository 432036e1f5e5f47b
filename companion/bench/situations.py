"""Instances of flight logs by situation, for the benchmark of the solver.

A log is replayed (`flightlog/replay.py`), and each tick's problem is taken as the solver had it. A
window of ticks is named by its hardest situation, and a few of each kind are drawn; else a set
would be mostly straight flight.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from companion.control.nmpc import Instance, NmpcConfig
from companion.control.nmpc.instance_file import Run
from mavlink_bridge.shared.distance import between, to_cylinder

_LENGTH = 6  # ticks of a window
_NEAR = 3.0  # m, of a neighbour or trunk
_AHEAD, _CLOSING = 6.0, 1.5  # m, m/s, of a neighbour that comes head-on


def drawn(windows: Iterable[Run], each: int, seed: int) -> list[Run]:
    """Return at most `each` windows of every flight and kind, drawn by `seed`."""
    groups: dict[tuple[str, str], list[Run]] = {}
    for window in windows:
        groups.setdefault((window.flight, window.kind), []).append(window)
    rng = np.random.default_rng(seed)
    found = []
    for group in groups.values():
        kept = rng.permutation(len(group))[:each]
        found += [group[n] for n in sorted(kept.tolist())]
    return found


def windows(flight: str, instances: Sequence[Instance], config: NmpcConfig) -> list[Run]:
    """Return the instances of one drone's flight, cut into windows that do not overlap."""
    whole = range(0, len(instances) - _LENGTH + 1, _LENGTH)
    parts = [tuple(instances[n : n + _LENGTH]) for n in whole]
    return [
        Run(flight, "cold" if n == 0 else _kind(part, config), part) for n, part in enumerate(parts)
    ]


def _kind(window: Sequence[Instance], config: NmpcConfig) -> str:
    """Return the first kind that any tick is: inside a safety radius, head-on, crowded, easy."""
    tests = {"inside": _inside, "head-on": _head_on, "crowded": _crowded}
    for name, test in tests.items():
        if any(test(instance, config) for instance in window):
            return name
    return "easy"


def _inside(instance: Instance, config: NmpcConfig) -> bool:
    """Return whether the drone is inside a safety distance, (37) or (38)."""
    apart = between(instance.neighbour_p, instance.x0[:3], config.agent_vertical_scale)
    near = apart[instance.neighbour_active > 0]
    return bool((near < config.d_agent_safety).any()) or _to_trunk(instance) < (
        config.d_obstacle_safety
    )


def _head_on(instance: Instance, config: NmpcConfig) -> bool:
    """Return whether a neighbour comes head-on."""
    d = instance.neighbour_p - instance.x0[:3]
    v = instance.neighbour_v - instance.x0[3:6]
    distance = np.linalg.norm(d, axis=1) + 1e-9
    closing = -np.einsum("ij,ij->i", d, v) / distance
    ahead = (distance < _AHEAD) & (closing > _CLOSING) & (instance.neighbour_active > 0)
    return bool(ahead.any())


def _crowded(instance: Instance, config: NmpcConfig) -> bool:
    """Return whether two neighbours and a trunk are near."""
    distance = between(instance.neighbour_p, instance.x0[:3])
    near = (distance < _NEAR) & (instance.neighbour_active > 0)
    return int(near.sum()) >= 2 and _to_trunk(instance) < _NEAR


def _to_trunk(instance: Instance) -> float:
    """Return the distance [m] to the nearest cylinder's surface."""
    active = instance.cylinders[instance.cylinder_active > 0]
    d = to_cylinder(instance.x0, *active.T)
    return float(d.min(initial=np.inf))
