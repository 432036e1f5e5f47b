"""Looks at neighbours from a drone that cruises or hovers, for tests of the tracker."""

import numpy as np

from companion.types import Detection
from mavlink_bridge.wire.messages import VehicleState

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
CRUISE = np.array([1.5, 0.0, 0.0])


def own(time):
    return VehicleState(time, CRUISE * time, CRUISE, LEVEL, np.zeros(3))


def look(offset, rng, share=0.02):
    """A look at a drone at `offset` (3,) m; its range is off by `share` of it (1 σ)."""
    away = float(np.linalg.norm(offset))
    measured = away * (1 + share * rng.standard_normal())
    return Detection(offset / away, measured, sigma_bearing=0.003, sigma_range=share * away)


def follow(tracker, start, velocity, looks, rng):
    """Look at 10 Hz at a drone that starts at `start` (3,) m; yield the tracks after each look."""
    for k in range(looks):
        offset = start + (velocity - CRUISE) * k / 10
        tracker.update(k / 10, [look(offset, rng)], own(k / 10), LEVEL, None)
        yield tracker.tracks()


def still(time):
    return VehicleState(time, np.zeros(3), np.zeros(3), LEVEL, np.zeros(3))
