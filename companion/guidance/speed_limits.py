"""Speed limits: how fast the drone may fly, given what it sees and its neighbours.

Six limits hold at once; the lowest counts:

| limit | bounds | reason |
|---|---|---|
| visibility | cruise speed | the drone does not fly where it does not look |
| headway | cruise speed | the room behind the neighbour ahead lasts for `headway` seconds |
| surprises | cruise speed | eyes that miss one neighbour miss others |
| clear finds | cruise speed | eyes that are unsure of what they find miss neighbours |
| reaction | cruise speed and v_max | a command acts before the drone is `reaction_way` farther |
| relative speed | v_max of (32) | a drone that dodges fast only hits the next neighbour |
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Self

from pydantic import Field, model_validator

from companion.estimation.delay import Delay
from companion.guidance.gaze import wrap
from companion.guidance.right_of_way import AHEAD_COSINE, RightOfWayConfig, same_level
from companion.types import Track
from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.shared.settings import Contradiction, StrictModel
from mavlink_bridge.wire.messages import VehicleState

_MAKE_WAY = 0.7  # m/s: the drone may always move this fast, to make way
_RESPONDS = 0.25  # s until the drone brakes when the one ahead does
_BRAKES, _ONE_AHEAD = 3.0, 4.0  # m/s²: the drone brakes by this, the one ahead may by that


class SpeedLimitConfig(StrictModel):
    """Numbers of the speed limits."""

    headway: float = Field(
        1.5, ge=0, description="Time [s] that the room ahead must last; 0: no headway limit."
    )
    clearance: float = Field(
        1.1, ge=0, description="Distance [m] from a neighbour at which the room begins."
    )
    headway_least: float = Field(
        0.3, gt=0, le=1, description="Least share of the cruise speed under the headway limit."
    )
    surprises: float = Field(
        1.0,
        gt=0,
        description="Neighbours that come up close by, in plain view, within 20 s and are no "
        "reason to fly slower. With n times as many the cruise speed is an n-th, down to "
        "`guard.blind_speed`.",
    )
    clear_share: float = Field(
        0.5,
        gt=0,
        le=1,
        description="Share of clear finds, see `tracker.clear`, below which the drone flies "
        "slower: at half that share at half the cruise speed, down to `guard.blind_speed`.",
    )
    relative_speed: float = Field(
        0.8,
        ge=0,
        description="Speed [m/s] above a neighbour's own that is allowed at `clearance` from it. "
        "A drone that dodges faster hits the next neighbour, which cannot see it come.",
    )
    reaction_way: float = Field(
        0.3, gt=0, description="Way [m] flown until a command acts, the delay's doubt included."
    )
    full_view: float = Field(
        0.7, gt=0, description="Off the line of sight by at most this [rad]: full speed."
    )
    no_view: float = Field(
        1.4, gt=0, le=3.2, description="Off it by this [rad], the edge of view: `no_view_share`."
    )
    no_view_share: float = Field(
        0.1, gt=0, le=1, description="Share of the cruise speed into what is not in view."
    )

    @model_validator(mode="after")
    def _check_view(self) -> Self:
        if not self.full_view < self.no_view:
            text = f"no_view, {self.no_view:g}, must be above full_view, {self.full_view:g}"
            raise Contradiction(("no_view", "full_view"), text)
        return self


def visibility_speed(config: SpeedLimitConfig, yaw: float, to_goal: Vector) -> float:
    """Return the share 0…1 of the cruise speed towards (3,) while the drone looks along `yaw`.

    A drone that turns round at a goal looks before it flies: what comes from behind the edge of
    view is seen too late to avoid. Linear between `full_view` and `no_view`.
    """
    off = abs(wrap(math.atan2(to_goal[1], to_goal[0]) - yaw))
    share = (config.no_view - off) / (config.no_view - config.full_view)
    return min(max(share, config.no_view_share), 1.0)


def reaction_speed(config: SpeedLimitConfig, delay: Delay) -> float:
    """Return the speed [m/s] at which a command acts in time: within `reaction_way`."""
    return config.reaction_way / (delay.value + 2.0 * delay.sigma)


def surprised_speed(config: SpeedLimitConfig, surprises: int, cruise: float, least: float) -> float:
    """Return the speed [m/s], at most `cruise`, of a drone whose eyes miss neighbours.

    surprises: in the last 20 s, see `companion/estimation/surprises.py`. least: m/s, lowest limit,
    with which a drone still gets on.
    """
    share = min(1.0, config.surprises / max(surprises, 1))
    return max(cruise * share, min(least, cruise))


def clear_speed(config: SpeedLimitConfig, share: float, cruise: float, least: float) -> float:
    """Return the speed [m/s], at most `cruise`, of a drone whose eyes are unsure of what they find.

    share: 0…1 of clear finds, see `companion/estimation/clear_share.py`. least: m/s, lowest limit.
    """
    return max(cruise * min(1.0, share / config.clear_share), min(least, cruise))


def followed(along: float, apart: float, config: SpeedLimitConfig) -> float:
    """Return the speed [m/s] at which the room to one ahead lasts for `headway`.

    It lasts, too, if the one ahead brakes to rest as hard as drones do, and the drone a moment
    later and less hard (the safe distance of Shalev-Shwartz et al., arXiv 1708.06374, Lemma 2).
    along: m/s, of the one ahead, the same way. apart: m, centre to centre.
    """
    room = max(apart - config.clearance, 0.0)
    stops = room + max(along, 0.0) ** 2 / (2.0 * _ONE_AHEAD)
    responds = _BRAKES * _RESPONDS
    safe = math.sqrt(responds**2 + 2.0 * _BRAKES * stops) - responds
    return min(along + room / config.headway, safe)


def headway_speed(
    own: VehicleState,
    tracks: Sequence[Track],
    way: Vector,
    cruise: float,
    config: SpeedLimitConfig,
    right_of_way: RightOfWayConfig,
    range_max: float,
) -> float:
    """Return the speed [m/s], at most `cruise`, at which the room ahead along `way` (3,) lasts.

    The drone flies as fast as a neighbour ahead flies the same way, and room / headway faster.
    A neighbour that flies along in formation is no limit; two drones that meet at close quarters
    both slow down, so that neither dodges faster than the other can see. The speed stays above
    `headway_least`, so that no drone waits for ever.
    """
    length = norm(way[:2])
    if config.headway == 0.0 or length < 1e-6:
        return cruise
    along = way[:2] / length
    speed = cruise
    for t in tracks:
        offset = t.p[:2] - own.p[:2]
        distance = norm(offset)
        ahead = offset @ along > AHEAD_COSINE * distance and same_level(own, t, right_of_way)
        if ahead and distance < range_max:
            speed = min(speed, followed(float(t.v[:2] @ along), distance, config))
    return max(speed, config.headway_least * cruise)


def relative_speed_limit(
    own: VehicleState,
    tracks: Sequence[Track],
    speed: float,
    v_max: float,
    config: SpeedLimitConfig,
) -> float:
    """Return the bound of (32) [m/s], at most `v_max`: near others, not much faster than they are.

    Each metre farther from a neighbour adds 1 m/s. The old speed of a neighbour out of sight is no
    reason to flee from it: there the own `speed` [m/s] or `relative_speed` is enough.
    """
    bound = v_max
    for t in tracks:
        distance = norm(t.p - own.p)
        calm = config.relative_speed + (distance - config.clearance)
        bound = min(bound, max(calm, speed) if t.lost else calm + norm(t.v))
    return max(bound, min(_MAKE_WAY, v_max))
