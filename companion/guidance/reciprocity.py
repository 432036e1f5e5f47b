"""Two that meet each give way by half: what one does, the other need not.

Eq. (14) has the others fly on unmoved, so each of two that meet dodges as if it were alone, twice
as far as it need; in a crowd every such dodge is the next one's surprise. Reciprocity is that of
van den Berg et al., Reciprocal Velocity Obstacles, ICRA 2008, here as a change of the predicted
velocity. Who turns out not to give way is dodged by half of what is left, ten times a second.
"""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from companion.types import Track
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import StrictModel
from mavlink_bridge.wire.messages import VehicleState

_SLOW = 0.3  # m/s: slower, the way it flies says nothing of where it looks
_ON_COURSE = 0.06  # m; passing nearer, neither side is the right one: it goes to the left


class ReciprocityConfig(StrictModel):
    """How much is left to the others."""

    share: float = Field(
        0.5, ge=0, le=1, description="Of the distance lacking, what the other one makes; 0: (14)."
    )
    ahead: float = Field(1.5, gt=0, description="Time [s] looked ahead for the nearest pass.")
    soonest: float = Field(0.4, gt=0, description="Least time [s] in which anybody gives way.")
    most: float = Field(
        0.8, ge=0, description="Fastest [m/s] that another one is taken to give way."
    )
    sees: float = Field(
        0.2, ge=-1, le=1, description="Cosine of the angle off its way to which it sees: 78°."
    )


def give_way_velocity(
    own: VehicleState, track: Track, distance: float, config: ReciprocityConfig
) -> Vector:
    """(3,) m/s: by how much a neighbour's velocity will change to pass at `distance` [m].

    0 where it passes farther off anyway, or flies so that it cannot see the own drone.
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
