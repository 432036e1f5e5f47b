"""Mission: goals in order, each in the drone's own ENU frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from companion.guidance.goals import Goal, GoalConfig, resolved
from mavlink_bridge.shared.arrays import Vector, lengths, norm
from mavlink_bridge.shared.settings import Contradiction, StrictModel
from mavlink_bridge.wire.messages import VehicleState

_STRAIGHT = 0.6  # rad; a smaller turn counts as left
_U_TURN = 2.8  # rad; a larger turn counts as left, too
_AHEAD = 0.8  # rad round the island by which the aim leads the drone
_CLIMB_AHEAD = 2.0  # m ahead on the way, whose height the drone keeps
_LEVEL_FROM, _LEVEL_FULL = 0.5, 1.5  # m from a goal: its own height, and the drone's level
_RING = 0.1  # m, least width between island and tolerance
_LEAVING = 0.35  # rad before the place where the way leaves the island: the next goal is aimed at
_STEP = 0.1  # rad between the places on the way round that are looked at
_CIRCLES = 4  # circles, most, out of which a place is moved
_MARGIN = 1e-3  # m
_NOTHING = np.zeros((0, 3))


class MissionConfig(StrictModel):
    """The goals, and how they are flown."""

    goals: list[GoalConfig] = Field(
        [],
        max_length=1000,
        description="[x, y, z] m each, own ENU frame (origin: where the vehicle booted); or "
        "{home: [east, north, up]}, {latitude, longitude, height}; {place: …, opening: true}. "
        "Without goals the drone stays where it is, until it is told otherwise.",
    )
    tolerance: float = Field(1.0, gt=0, description="A goal is reached within this [m].")
    island: float = Field(
        0.65,
        ge=0.05,
        le=0.9,
        description="A goal on the way is passed as a roundabout: the radius of its island is this "
        "share of the tolerance. Drones that come and drones that go then never meet head on.",
    )
    final_tolerance: float = Field(
        0.5, gt=0, description="The last goal is reached within this [m], and slowly."
    )
    final_speed: float = Field(
        0.4, gt=0, description="Highest speed [m/s] at which the last goal counts as reached."
    )
    level: float = Field(
        0.0,
        description="Height [m] above the goals at which the way between them is flown. Where each "
        "drone has its own level, ways that cross in a narrow place need not all fit in it.",
    )
    commission: bool = Field(
        False,
        description="Instead of the goals: move on the spot for 30 s, in free air, for `companion "
        "calibrate`. The camera is not looked at, but logged.",
    )
    auto: bool = Field(
        False, description="Arm, take off, fly and land without being told; else wait for a pilot."
    )
    takeoff_altitude: float = Field(
        2.0, gt=0.5, description="Height [m] above the place where the drone stood."
    )
    others: bool = Field(
        False,
        description="Other drones start within sight, some 8 m. Until they are seen steadily "
        "at the end of a turn the drone goes on looking round and does not set out; after "
        "`monitors.alone` it asks for HOLD: eyes that have never shown a drone may be eyes for "
        "other drones than these.",
    )
    land: bool = Field(True, description="Land at the last goal; else hold there.")
    land_wait: float = Field(
        0.0,
        ge=0,
        description="Before it lands, the drone turns once all round, then waits while a known "
        "neighbour is below, both for at most this long [s]; 0: it lands at once. For worlds of "
        "several levels.",
    )

    @model_validator(mode="after")
    def _check_ring(self) -> Self:
        """Refuse an island so wide that the way round it leaves the tolerance."""
        ring = self.tolerance * (1.0 - self.island)
        if len(self.goals) > 1 and ring < _RING - 1e-9:
            raise Contradiction(
                ("island", "tolerance"),
                f"between island and tolerance {ring:.2g} m are left, which must be {_RING:g}: "
                "island smaller or tolerance larger, or the way round it never ends",
            )
        return self


@dataclass(frozen=True)
class MissionProgress:
    """Where the mission stands.

    goal: (3,) m to fly to. index: of the present goal. complete: the last goal is reached. climb:
    m, by which the straight way from the goal before is still below the present one.
    """

    goal: Vector
    index: int
    complete: bool
    climb: float = 0.0


class Mission:
    """Leads through the goals, one after another, and holds the last.

    shift: (3,) m, by which the present goal, an opening, has been corrected by what is seen.
    """

    def __init__(self, config: MissionConfig, goals: Sequence[Goal] | None = None) -> None:
        """Start at the first of `goals`; None: those of the configuration, as far as known."""
        self._config = config
        given = resolved(config.goals, None) or [] if goals is None else list(goals)
        self._goals = [g.p for g in given]
        self._openings = [g.opening for g in given]
        self.shift: Vector = np.zeros(3)
        self._index = 0
        self._complete = False
        self._near = False
        self._turn = 0.0  # +1: left, -1: right at the present goal; 0: not known yet
        self._start: VehicleState | None = None
        self._floor = -math.inf  # m
        self._keep_out: Vector = _NOTHING

    def update(
        self,
        own: VehicleState,
        surveyed: bool = True,
        floor: float = -math.inf,
        keep_out: Vector = _NOTHING,
    ) -> MissionProgress:
        """Advance past the goals that are done; return the progress from the own state.

        floor: m, the lowest z that may be flown now; a goal below it is flown to, and reached, at
        that height. keep_out: (K,3) x, y, radius [m] of the circles around trunks that no drone
        flies into. Until the drone has looked round (`surveyed`), and without goals for ever, it
        holds where the first update found it.
        """
        self._start = self._start or own
        self._floor, self._keep_out = floor, keep_out
        if not self._goals or not (surveyed or self._complete):
            return MissionProgress(self._start.p, 0, False)
        while not self._complete and self._done(own):
            self._near = False
            self._turn = 0.0
            self.shift = np.zeros(3)
            if self._index + 1 < len(self._goals):
                self._index += 1
            else:
                self._complete = True
        goal, climb = self._aim(own.p), self._climb(own.p)
        return MissionProgress(goal, self._index, self._complete, climb)

    def opening(self, p: Vector) -> tuple[Vector, Vector] | None:
        """Return place (3,) m and way (2,) of the present goal if it is an opening; else None.

        The way leads there from the goal before; to the first, from where the mission began, or
        from p (3,) m before it has begun.
        """
        if not self._goals or not self._openings[self._index]:
            return None
        goal = self._goals[self._index]
        start = p if self._start is None else self._start.p
        before = self._goals[self._index - 1] if self._index else start
        way = goal[:2] - before[:2]
        length = norm(way)
        return None if length < 1e-3 else (goal, way / length)

    @property
    def _last(self) -> bool:
        return self._index + 1 >= len(self._goals)

    def _done(self, own: VehicleState) -> bool:
        """Return whether the present goal is reached, or passed where others follow."""
        c, goal = self._config, self._goal
        distance = norm(goal - own.p)
        if self._last:
            slow = norm(own.v) <= c.final_speed
            return distance <= c.final_tolerance and slow
        self._near |= norm(self._goal_on_level(own.p) - own.p) <= c.tolerance
        if (opening := self.opening(own.p)) is not None:
            return self._near and float((own.p - goal)[:2] @ opening[1]) > 0.0
        if self._turn == 0.0:
            before = self._goals[self._index - 1] if self._index else own.p
            self._turn = turn_side(before, goal, self._goals[self._index + 1])
        way_round = self._roundabout()
        return self._near and (
            way_round.passed(own.p) or way_round.aim(own.p, self._keep_out) is None
        )

    def _aim(self, p: Vector) -> Vector:
        """Return where to fly (3,) m on the drone's level.

        To the last goal, through an opening, or round any other – or, where trunks leave no way
        round it, as near to it as they allow.
        """
        goal = self._goal_on_level(p)
        if self._last or self._openings[self._index]:
            return goal
        aim = self._roundabout().aim(p, self._keep_out)
        aim = outside(goal, p, self._keep_out) if aim is None else aim
        return np.array([aim[0], aim[1], goal[2]])

    def _climb(self, p: Vector) -> float:
        """Return how far [m] the way is below the present goal, a little ahead of p (3,) m.

        The height changes evenly from goal to goal: over ground that rises from one to the next, a
        drone that climbed at once would lose the ground out of sight, or fly into it.
        """
        if not self._index:
            return 0.0
        goal, before = self._goal, self._goals[self._index - 1]
        length = math.hypot(goal[0] - before[0], goal[1] - before[1])
        ahead = math.hypot(goal[0] - p[0], goal[1] - p[1]) - _CLIMB_AHEAD
        left = min(max(ahead / length, 0.0), 1.0) if length > 1e-3 else 0.0
        return left * float(goal[2] - max(before[2], self._floor))

    @property
    def _goal(self) -> Vector:
        """The present goal (3,) m, no lower than may be flown."""
        x, y, z = self._goals[self._index] + self.shift
        return np.array([x, y, max(z, self._floor)])

    def _goal_on_level(self, p: Vector) -> Vector:
        """Return the goal (3,) m, raised to the drone's level until p (3,) m is near it."""
        goal = self._goal
        distance = math.hypot(goal[0] - p[0], goal[1] - p[1])
        share = (distance - _LEVEL_FROM) / (_LEVEL_FULL - _LEVEL_FROM)
        level = self._config.level * min(max(share, 0.0), 1.0)
        return np.array([goal[0], goal[1], goal[2] + level])

    def _roundabout(self) -> Roundabout:
        """Return the way round the present goal to the following one."""
        radius = self._config.island * self._config.tolerance
        return Roundabout(self._goal, radius, self._goals[self._index + 1], self._turn)


def turn_side(before: Vector, goal: Vector, following: Vector) -> float:
    """Return +1 where the way turns left at `goal` (3,), -1 where it turns right.

    Nearly straight on and nearly back count as left, so that drones that start side by side do not
    go round opposite sides and meet.
    """
    a, b = goal[:2] - before[:2], following[:2] - goal[:2]
    angle = math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1])
    return -1.0 if -_U_TURN < angle < -_STRAIGHT else 1.0


def outside(place: Vector, p: Vector, keep_out: Vector) -> Vector:
    """Return `place` (3,) m, moved out of the circles keep_out (K,3) m, the deepest one first.

    From the very centre it is moved towards p (3,) m.
    """
    for _ in range(_CIRCLES):
        offsets = place[:2] - keep_out[:, :2]
        deep = keep_out[:, 2] - np.hypot(offsets[:, 0], offsets[:, 1])
        if not len(deep) or deep.max() <= _MARGIN:
            break
        x, y, radius = keep_out[deep.argmax()]
        way = offsets[deep.argmax()] if radius - deep.max() > _MARGIN else p[:2] - [x, y]
        way = way / max(norm(way), 1e-6)
        place = np.array([x + radius * way[0], y + radius * way[1], place[2]])
    return place


def _free(places: Vector, keep_out: Vector) -> NDArray[np.bool_]:
    """Return which places (n,3) m are in none of the circles keep_out (K,3) m, as (n,)."""
    offsets = places[:, None, :2] - keep_out[:, :2]
    free: NDArray[np.bool_] = np.all(lengths(offsets) >= keep_out[:, 2], axis=1)
    return free


@dataclass(frozen=True)
class Roundabout:
    """The way past `centre` (3,) m to `following` (3,) m around an island of `radius` [m].

    side: +1 round the island counter-clockwise (the island is on the left), -1 clockwise.
    """

    centre: Vector
    radius: float
    following: Vector
    side: float

    def aim(self, p: Vector, keep_out: Vector = _NOTHING) -> Vector | None:
        """Return where to fly from p (3,) m: along the tangent to the island, or on around it.

        On the rim the aim lies `_AHEAD` round the island and a little outside it, on the tangent: a
        drone on the rim keeps its distance, and a drone too far out or in comes back to it. Where
        that place is in one of the circles keep_out (K,3) m, the aim is the next place on the rim
        that is not: the drone gets round what stands there. None: there is no such place.
        """
        angle, distance = self._polar(p)
        touch = math.acos(min(self.radius / max(distance, 1e-6), 1.0))
        remaining = max(self._remaining(angle), _LEAVING)
        ahead = min(max(touch, _AHEAD), remaining)
        radius = self.radius if touch > _AHEAD else self.radius / math.cos(ahead)
        places = self._places(np.array([angle + self.side * ahead]), radius)
        free = _free(places, keep_out)
        if not free[0]:
            turns = np.arange(ahead + _STEP, remaining, _STEP)
            places = self._places(angle + self.side * turns, self.radius)
            free = _free(places, keep_out)
        for place in places[free]:
            return np.array(place)
        return None

    def _places(self, angles: Vector, radius: float) -> Vector:
        """Return the places (n,3) m at these angles (n,) rad and this radius [m]."""
        around = np.stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))], axis=1)
        places: Vector = self.centre + radius * around
        return places

    def passed(self, p: Vector) -> bool:
        """Return whether p (3,) m has come to where the way to `following` leaves the island."""
        remaining = self._remaining(self._polar(p)[0])
        return remaining < _LEAVING or remaining > 1.5 * math.pi

    def _remaining(self, angle: float) -> float:
        """Return the angle [rad], 0…2π, still to go round from the place at `angle`."""
        towards, distance = self._polar(self.following)
        leave = towards - self.side * math.acos(min(self.radius / max(distance, 1e-6), 1.0))
        return (self.side * (leave - angle)) % (2.0 * math.pi)

    def _polar(self, p: Vector) -> tuple[float, float]:
        """Return angle [rad] and distance [m] of p (3,) m from the centre, seen from above."""
        d = p[:2] - self.centre[:2]
        return math.atan2(d[1], d[0]), math.hypot(d[0], d[1])
