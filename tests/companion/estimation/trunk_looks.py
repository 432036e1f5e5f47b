"""Looks at trunks, for tests of the obstacle map."""

import numpy as np

from companion.estimation.obstacle_map import ObstacleConfig, ObstacleMap
from companion.types import Trunk
from mavlink_bridge.wire.messages import VehicleState

FORWARD = np.array([0.5, -0.5, 0.5, -0.5])  # a camera that looks along the body's x axis
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
MISSES = 8  # that end a trunk known for good


def trunk(distance, left=0.0, radius=0.5, sigma=0.1, **seen):
    """A trunk `left` [rad] of straight ahead."""
    return Trunk(np.array([-np.sin(left), 0.0, np.cos(left)]), distance, radius, sigma, **seen)


def by_width(half, left=0.0, radius=1.0, sigma=0.4, both=False):
    """A trunk without a foot: its radius is assumed, `half` [rad] of its width shows.

    both: whether both of its edges do.
    """
    shown = {"assumed": True, "half_width": half if both else 0.0}
    return trunk(radius / np.sin(half), left, radius, sigma, **shown)


def see(known, *trunks, at=(0.0, 0.0), time=0.0, yaw=0.0, turns=0.0, half_view=1.4, **seen):
    """Take one look, turning at `turns` [rad/s]; return the trunks, with the σ of their places."""
    q = np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
    p, omega = np.array([*at, 2.0]), np.array([0.3, -0.4, turns])
    known.update(trunks, VehicleState(time, p, np.zeros(3), q, omega), FORWARD, half_view, **seen)
    return known.doubted_cylinders(p)


def hide(places):
    """Visibility of a picture in which nothing shows."""
    return np.zeros(len(places))


def seen_times(looks, *trunks, **config):
    """Return a map that has seen these trunks so often, in frames of one time and place."""
    known = ObstacleMap(ObstacleConfig(**config))
    for _ in range(looks):
        see(known, *trunks)
    return known


def odds(probability):
    return np.log(probability / (1.0 - probability))
