"""Instances for the solver's tests: hand-made corner cases and random ones."""

import numpy as np

from companion.control.nmpc import Instance, Neighbour, NmpcConfig, make_instance
from companion.model import HOVER, normalise, yaw_of
from mavlink_bridge.shared.frames import quaternion_from_euler

CONFIG = NmpcConfig()


def state(p=(0.0, 0.0, 2.0), v=(0.0, 0.0, 0.0), yaw=0.0):
    return np.concatenate([p, v, quaternion_from_euler(0.0, 0.0, yaw)])


def scene(config: NmpcConfig = CONFIG, **changes) -> Instance:
    given = {"x0": state(), "u_last": HOVER, "goal": (20.0, 0.0, 2.0), "yaw": 0.0}
    return make_instance(config, **{**given, **changes})


NAMED = {
    "free": {},
    "cruise": {"x0": state(v=(1.5, 0, 0))},
    "hover": {"goal": (0, 0, 2)},
    "behind": {"goal": (-10, 0.5, 2), "x0": state(v=(1.5, 0, 0))},
    "climb": {"goal": (3, 0, 6)},
    "cylinder": {"x0": state(v=(1.5, 0, 0)), "cylinders": [(3, 0.4, 1)]},
    "dead ahead": {"x0": state(v=(1.5, 0, 0)), "cylinders": [(4, 0, 1)]},
    "gap": {"x0": state(v=(1.5, 0, 0)), "cylinders": [(3, 1.8, 1), (3, -1.8, 1)]},
    "wall": {"x0": state(v=(1.5, 0, 0)), "planes": [(1, 0, 0, 2.5)]},
    "fence": {"x0": state(v=(1.5, 0, 0.5)), "planes": [(0, 0, 1, 2.8), (0, 0, -1, -1.0)]},
    "side by side": {"neighbours": [Neighbour((0.3, 1.4, 2), (1.5, 0, 0))]},
    "head-on": {
        "x0": state(v=(1.5, 0, 0)),
        "neighbours": [Neighbour((4, 0.2, 2), (-1.5, 0, 0), cohesion=0.0)],
    },
    "too near": {"neighbours": [Neighbour((0.4, 0.3, 2.1), (0.2, 0, 0))]},
    "inside": {"x0": state((0, 0, 2)), "cylinders": [(1.2, 0.3, 1)]},
    "unsure": {
        "x0": state(v=(1.5, 0, 0)),
        "neighbours": [Neighbour((2.5, 0.5, 2), (0, 0, 0), (0.1, 0.3), 0.0)],
    },
    "windy": {"goal": (0, 0, 2), "disturbance": (0.6, -0.3, 0.2)},
    "fast": {"x0": state(v=(3.6, 0.5, 0))},
    "tilted": {
        "x0": np.concatenate([[0, 0, 2, 1, -1, 0.5], normalise(np.array([0.9, 0.3, -0.2, 0.1]))])
    },
}


def random_scene(seed: int, config: NmpcConfig = CONFIG) -> Instance:
    """A crowded scene: three neighbours, four cylinders, floor and ceiling, any heading."""
    rng = np.random.default_rng(seed)
    x0 = np.concatenate(
        [
            [*rng.normal(0, 30, 2), rng.uniform(1.6, 3)],
            rng.normal(0, 0.7, 3),
            normalise(np.array([1, *rng.normal(0, 0.08, 2), rng.normal(0, 0.6)])),
        ]
    )
    bearing = rng.uniform(-np.pi, np.pi, 7)
    away = np.stack([np.cos(bearing), np.sin(bearing)], 1)
    neighbours = [
        Neighbour(
            np.append(x0[:2] + away[i] * rng.uniform(0.9, 4), x0[2] + rng.normal(0, 0.2)),
            np.append(rng.normal(0, 1, 2), 0.0),
            (0.1, 0.1),
            float(rng.integers(0, 2)),
        )
        for i in range(3)
    ]
    cylinders = [(*(x0[:2] + away[3 + i] * rng.uniform(1.7, 5)), 1.0) for i in range(4)]
    return make_instance(
        config,
        x0=x0,
        u_last=HOVER + rng.normal(0, 0.3, 4),
        goal=x0[:3] + np.append(rng.normal(0, 10, 2), rng.normal(0, 0.3)),
        yaw=yaw_of(x0[6:10]) + rng.uniform(-0.8, 0.8),
        neighbours=neighbours,
        cylinders=cylinders,
        planes=[(0, 0, -1, -0.5), (0, 0, 1, 5)],
    )
