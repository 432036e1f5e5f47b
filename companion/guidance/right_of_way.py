"""Right of way: oncoming and standing neighbours are passed on the right.

Two drones that meet pass each other on the same side without communication; in a tunnel, lanes
form. A neighbour clearly to the right of the way, or with a trunk beside it on the right, is
passed on the left.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from pydantic import Field

from companion.types import Track
from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.shared.settings import StrictModel
from mavlink_bridge.wire.messages import VehicleState

AHEAD_COSINE = 0.3  # of the angle off the way, above which a neighbour is ahead
_NEAR = 2.0  # m; a neighbour that stands so near ahead blocks the way, even beyond the next goal
_STANDING = 0.3  # m/s along the way; slower is within the doubt of a velocity estimate
_PASSAGE = 0.4  # m from a trunk's surface to a drone's centre that a passage needs
_LEAST = 1.0  # m of room, with less of which trunks leave no passage
_TURN_MAX = 0.6  # rad; a neighbour at arm's length is passed slowly, not by turning sideways


class RightOfWayConfig(StrictModel):
    """Which neighbours block the way, and how far they are avoided."""

    keep_right: float = Field(
        1.0,
        ge=0,
        description="Room [m] left to an oncoming neighbour; more than a metre only as far as "
        "trunks leave it. 0: the goal is never turned.",
    )
    oncoming: float = Field(6.0, gt=0, description="From this distance [m] on room is made.")
    level: float = Field(
        1.2,
        gt=0,
        description="A neighbour farther above or below [m], such as one that has landed, blocks "
        "no way.",
    )


def same_level(own: VehicleState, track: Track, config: RightOfWayConfig) -> bool:
    """Return whether a neighbour flies near enough to the own height to be in the way."""
    return bool(abs(track.p[2] - own.p[2]) < config.level)


def blocks_way(own: VehicleState, track: Track, goal: Vector, config: RightOfWayConfig) -> bool:
    """Return whether a neighbour is before the goal (3,) m and comes closer, or stands there."""
    x, y = (goal[:2] - own.p[:2]).tolist()
    dx, dy = (track.p[:2] - own.p[:2]).tolist()
    length, distance = math.hypot(x, y), math.hypot(dx, dy)
    ahead = x * dx + y * dy > AHEAD_COSINE * distance * length and same_level(own, track, config)
    flies_along = x * track.v[0] + y * track.v[1] > _STANDING * length
    return ahead and not flies_along and distance < min(config.oncoming, max(length, _NEAR))


def pass_on_right(
    own: VehicleState,
    tracks: Sequence[Track],
    cylinders: Vector,
    goal: Vector,
    config: RightOfWayConfig,
) -> Vector:
    """Return the goal (3,) m, turned about the drone as far as neighbours that block the way ask.

    cylinders (K,3): x, y, radius [m] of the trunks that may leave no passage on one side.
    """
    way = goal[:2] - own.p[:2]
    right = left = 0.0
    for t in tracks:
        if config.keep_right == 0.0 or not blocks_way(own, t, goal, config):
            continue
        x, y = (way / norm(way)).tolist()
        offset = t.p[:2] - own.p[:2]
        aside, distance = x * float(offset[1]) - y * float(offset[0]), float(np.hypot(*offset))
        side = np.array([y, -x])
        if room := _room(t.p[:2], side, config.keep_right, cylinders):
            if -0.5 * room < aside < room:
                right = max(right, math.atan2(room - aside, distance))
            continue
        room = _room(t.p[:2], -side, config.keep_right, cylinders)
        if -room < aside < 0.5 * room:
            left = max(left, math.atan2(room + aside, distance))
    turn = max(min(right or -left, _TURN_MAX), -_TURN_MAX)
    c, s = math.cos(turn), math.sin(turn)
    turned = [c * way[0] + s * way[1], c * way[1] - s * way[0]]
    return np.array([own.p[0] + turned[0], own.p[1] + turned[1], goal[2]])


def _room(place: Vector, side: Vector, most: float, cylinders: Vector) -> float:
    """Return the room [m] that cylinders (K,3) leave on that side (2,) of a place (2,); 0: none."""
    offsets = cylinders[:, :2] - place
    gaps = np.hypot(*offsets.T) - cylinders[:, 2]
    room = min(most, float(gaps[offsets @ side > 0.0].min(initial=math.inf)) - _PASSAGE)
    return room if room >= min(_LEAST, most) else 0.0
