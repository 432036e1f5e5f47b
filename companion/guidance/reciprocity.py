"""Reciprocity: a neighbour that is met gives way by half, and the own drone by the other half.

By eq. (14) neighbours fly on unmoved. Each of two drones that meet would then evade as if it were
alone, twice as far as needed, and in a crowd surprise the next neighbour. Reciprocity is that of
van den Berg et al., "Reciprocal velocity obstacles for real-time multi-agent navigation", ICRA
2008, here as a change of the predicted velocity. Each tick counts on the neighbour for half of what
is still lacking, so that a neighbour that does not give way is evaded all the same.
"""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from companion.types import Track
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import StrictModel
from mavlink_bridge.wire.messages import VehicleState

_SLOW = 0.3  # m/s; the direction of a slower neighbour does not tell where it looks
_ON_COURSE = 0.06  # m; a neighbour that would pass nearer gives way to its right


class ReciprocityConfig(StrictModel):
    """How far neighbours are expected to give way."""

    share: float = Field(
        0.5,
        ge=0,
        le=1,
        description="Share of the distance lacking that the neighbour makes; 0: eq. (14).",
    )
    ahead: float = Field(1.5, gt=0, description="Time [s] looked ahead for the nearest pass.")
    soonest: float = Field(0.4, gt=0, description="Least time [s] in which a neighbour gives way.")
    most: float = Field(
        0.8, ge=0, description="Highest speed [m/s] at which a neighbour gives way."
    )
    sees: float = Field(
        0.2,
        ge=-1,
        le=1,
        description="Cosine of the angle off its way up to which a neighbour sees: 78°.",
    )


def give_way_velocity(
    own: VehicleState, track: Track, distance: float, config: ReciprocityConfig
) -> Vector:
    """Return the change (3,) m/s of a neighbour's velocity by which it will pass at `distance` [m].

    Zero where it passes farther away in any case, and where it does not see the own drone.
    """
    rx, ry = (track.p[:2] - own.p[:2]).tolist()
    wx, wy = (track.v[:2] - own.v[:2]).tolist()
    vx, vy = track.v[:2].tolist()
    apart, speed = math.hypot(rx, ry), math.hypot(vx, vy)
    blind = speed > _SLOW and -(rx * vx + ry * vy) < config.sees * apart * speed
    if apart < 1e-6 or blind:
        return np.zeros(3)
    time = -(rx * wx + ry * wy) / max(wx * wx + wy * wy, 1e-6)
    time = min(max(time, 0.0), config.ahead)
    x, y = rx + time * wx, ry + time * wy
    miss = math.hypot(x, y)
    if miss >= distance:
        return np.zeros(3)
    pace = min(config.share * (distance - miss) / max(time, config.soonest), config.most)
    if miss < _ON_COURSE:
        x, y, miss = -ry, rx, apart
    return np.array([x * pace / miss, y * pace / miss, 0.0])
