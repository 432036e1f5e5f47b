"""Which neighbours matter: at most three, the most threatening first (section III-C).

The paper's R_ij = RD/RS (eq. 8) with RD = exp(|p_ij| - d_ref) (eq. 9) and RS the closing
speed (eq. 10) shrinks as danger grows and divides by zero. Its inverse says the same and is
total: threat = max(closing speed, small) · exp(d_ref - |p_ij|); larger is worse.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from pydantic import Field

from companion.types import Track
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.distance import between
from mavlink_bridge.shared.settings import StrictModel
from mavlink_bridge.wire.messages import VehicleState

_LEAST_CALM = 0.7  # m/s: enough to make way
_AHEAD = 0.3  # cosine of the angle off the way, above which somebody is ahead
_NEAR = 2.0  # m; who stands so near ahead is in the way, even beyond the next aim
_STANDING = 0.3  # m/s along the way; less is within what is known of a velocity
_FITS = 0.4  # m from a trunk's surface to a drone's centre
_TURN_MAX = 0.6  # rad; who passes at less than an arm's length does so slowly, not sideways


class ThreatConfig(StrictModel):
    """How threat is measured."""

    d_ref: float = Field(1.5, gt=0, description="Reference distance [m] of eq. (9).")
    closing_floor: float = Field(
        0.6, gt=0, description="Least closing speed [m/s]: who is near counts, closing or not."
    )
    critical: int = Field(3, ge=1, le=12, description="Most neighbours taken (out-degree < 4).")
    headway: float = Field(
        1.5, ge=0, description="Time [s] that room ahead must last at the speed flown; 0: any."
    )
    room: float = Field(1.1, ge=0, description="Room [m] begins this far from a neighbour.")
    creep: float = Field(0.3, gt=0, le=1, description="Least part of the speed in a crowd.")
    calm: float = Field(
        0.8,
        ge=0,
        description="Speed [m/s] above a neighbour's own at which one moves `room` away from it. "
        "Who dodges faster only hits the next one, which cannot see it come.",
    )
    keep_right: float = Field(
        1.0, ge=0, description="Room [m] made to the left for who comes towards one; 0: none."
    )
    oncoming: float = Field(6.0, gt=0, description="From this far [m] it is made.")
    level: float = Field(
        1.2, gt=0, description="Farther [m] above or below, on the ground say, is in nobody's way."
    )
    range_max: float = Field(10.0, gt=0, description="R of eq. (6) [m]: farther is ignored.")


def threat(own: VehicleState, p: Vector, v: Vector, config: ThreatConfig) -> float:
    """Threat of a neighbour at p (3,) m moving with v (3,) m/s, own ENU frame; eq. (8)–(10)."""
    offset = p - own.p
    distance = float(np.linalg.norm(offset))
    closing = float(offset @ (own.v - v)) / max(distance, 1e-6)
    return float(max(closing, config.closing_floor) * np.exp(config.d_ref - distance))


def rated_neighbours(
    own: VehicleState, tracks: Sequence[Track], config: ThreatConfig
) -> list[tuple[Track, float]]:
    """The tracks in range with their threat, worst first; order of `tracks` is no matter.

    The first `critical` of them are the critical neighbours.
    """
    near = [t for t in tracks if between(t.p, own.p) <= config.range_max]
    rated = [(t, threat(own, t.p, t.v, config)) for t in near]
    return sorted(rated, key=lambda r: (-r[1], r[0].id))


def uncrowded_speed(
    own: VehicleState, tracks: Sequence[Track], way: Vector, cruise: float, config: ThreatConfig
) -> float:
    """Speed [m/s], at most `cruise`, at which the room ahead along `way` (3,) lasts `headway`.

    A headway rule: as fast as a neighbour ahead flies the same way, and room / headway faster.
    Who flies along in formation slows nobody; two that meet at close quarters both slow, so that
    neither evades faster than the other can see. Never below `creep`: nobody waits for ever.
    """
    length = float(np.linalg.norm(way[:2]))
    if config.headway == 0.0 or length < 1e-6:
        return cruise
    along = way[:2] / length
    speed = cruise
    for t in tracks:
        offset = t.p[:2] - own.p[:2]
        distance = float(np.linalg.norm(offset))
        ahead = offset @ along > _AHEAD * distance and _level(own, t, config)
        if ahead and distance < config.range_max:
            room = max(distance - config.room, 0.0)
            speed = min(speed, float(t.v[:2] @ along) + room / config.headway)
    return max(speed, config.creep * cruise)


def calm_speed(
    own: VehicleState, tracks: Sequence[Track], speed: float, v_max: float, config: ThreatConfig
) -> float:
    """Bound of (32) [m/s], at most `v_max`: near others, not much faster than they are.

    1 m farther off it is 1 m/s higher. How fast one was that is out of sight is no reason to flee
    from it: `speed` [m/s], at which the own way is to be flown, is fast enough, or `calm`.
    """
    bound = v_max
    for t in tracks:
        distance = float(between(t.p, own.p))
        calm = config.calm + (distance - config.room)
        bound = min(bound, max(calm, speed) if t.lost else calm + float(np.linalg.norm(t.v)))
    return max(bound, min(_LEAST_CALM, v_max))


def doubt(
    own: VehicleState, track: Track, distance: float, vertical_scale: float
) -> tuple[float, float]:
    """Standard deviations of place [m] and velocity [m/s] that widen `distance` [m], (37).

    vertical_scale: how much taller than wide the ellipsoid of (37) is.

    One slack serves all neighbours: room that doubt of one out of sight claims in vain is what
    the plan then takes from another that is in sight. So that doubt claims free room only now,
    and with time no more of it than once that room a second.
    """
    place, speed = (math.sqrt(float(np.trace(track.P[k : k + 3, k : k + 3])) / 3) for k in (0, 3))
    if not track.lost:
        return place, speed
    room = max(float(between(track.p, own.p, vertical_scale)) - distance, 0.0)
    return min(place, room), min(speed, room)


def in_the_way(own: VehicleState, track: Track, goal: Vector, config: ThreatConfig) -> bool:
    """Whether a neighbour before the goal (3,) m comes towards one, or stands there."""
    x, y = (goal[:2] - own.p[:2]).tolist()
    dx, dy = (track.p[:2] - own.p[:2]).tolist()
    length, distance = math.hypot(x, y), math.hypot(dx, dy)
    ahead = x * dx + y * dy > _AHEAD * distance * length and _level(own, track, config)
    flies_along = x * track.v[0] + y * track.v[1] > _STANDING * length
    return ahead and not flies_along and distance < min(config.oncoming, max(length, _NEAR))


def _level(own: VehicleState, track: Track, config: ThreatConfig) -> bool:
    return bool(abs(track.p[2] - own.p[2]) < config.level)


def way_past(
    own: VehicleState,
    tracks: Sequence[Track],
    cylinders: Vector,
    goal: Vector,
    config: ThreatConfig,
) -> Vector:
    """Goal (3,) turned to the right as far as who comes towards one, or stands in the way, asks.

    Two that meet pass each other on the same side without a word; in a tunnel, lanes form. Who is
    clearly to the right of the way, or has one of `cylinders` (K,3) x, y, radius [m] there, is
    passed on the left.
    """
    way = goal[:2] - own.p[:2]
    right = left = 0.0
    for t in tracks:
        if config.keep_right == 0.0 or not in_the_way(own, t, goal, config):
            continue
        x, y = (way / np.linalg.norm(way)).tolist()
        offset = t.p[:2] - own.p[:2]
        aside, distance = x * float(offset[1]) - y * float(offset[0]), float(np.hypot(*offset))
        room, side = config.keep_right, np.array([y, -x])
        if _free(t.p[:2], side, room, cylinders):
            if -0.5 * room < aside < room:
                right = max(right, math.atan2(room - aside, distance))
        elif -room < aside and _free(t.p[:2], -side, room, cylinders):
            left = max(left, math.atan2(room + aside, distance))
    turn = max(min(right or -left, _TURN_MAX), -_TURN_MAX)
    c, s = math.cos(turn), math.sin(turn)
    turned = [c * way[0] + s * way[1], c * way[1] - s * way[0]]
    return np.array([own.p[0] + turned[0], own.p[1] + turned[1], goal[2]])


def _free(place: Vector, side: Vector, room: float, cylinders: Vector) -> bool:
    """Whether all cylinders (K,3) on that side (2,) of place (2,) leave room to pass between."""
    offsets = cylinders[:, :2] - place
    gaps = np.hypot(*offsets.T) - cylinders[:, 2]
    return not bool(((offsets @ side > 0.0) & (gaps < room + _FITS)).any())
