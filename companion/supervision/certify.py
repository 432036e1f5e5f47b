"""Certify: the way to stop that comes with a command, and what flies where there is none.

At each tick the command is accepted with the first way after it that the checker
(`certificate.py`) accepts. Where it accepts none, the way that was accepted last is flown on, from
the present state; where that does not hold any more, another one that does; where none does, the
one that keeps the most room. The last means that a bound is broken, or was never known to hold.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from companion.estimation.delay import Delay, within_doubt
from companion.estimation.prediction import Prediction
from companion.supervision.certificate import DT, Bounds, Scene, check
from companion.supervision.evasion import STRAIGHT, Law, Ways, aside, joined, simulate
from companion.supervision.guard_config import GuardConfig
from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.shared.settings import StrictModel
from mavlink_bridge.wire.messages import RateCommand

# Steps aside, m/s and s; the last is from what comes fast.
_SIDES = (0.6, 0.5), (1.2, 0.5), (1.8, 0.8)
_SPEED_TUBE = 0.1  # m/s that the drone may be faster than on its way
_GAIN = 0.1  # m of room that an evasion must save before it replaces a plan that holds
_AT_WALL = 0.1  # m of too little room to a wall that doubts alone take: 0.06 to 0.16 of the way
_NEAR = 3.0  # m: from farther away nobody hits within the 1.6 s of a way
_SHADOW = 5  # ticks from one judgement to the next where a certificate changes nothing


class CertificateConfig(StrictModel):
    """Bounds that the certificate relies on, each with its reason."""

    enforce: bool = Field(
        True,
        description="Fly the way to stop where a plan's command has no certificate; false: the "
        "certificate is only judged, at every fifth tick, logged and counted.",
    )
    neighbour_radius: float = Field(
        0.2,
        gt=0,
        description="Radius [m] of the sphere around a neighbour, the largest of the fleet.",
    )
    neighbour_acceleration: float = Field(
        2.0,
        ge=0,
        description="Most acceleration [m/s²] of a neighbour off its course: what a neighbour's "
        "NMPC uses in ordinary flight.",
    )
    neighbour_brakes: float = Field(
        0.8,
        gt=0,
        description="Deceleration [m/s²] that a neighbour on its course is left to brake by, and "
        "is not evaded as long as that is enough: less than half of what its NMPC uses.",
    )
    neighbour_hastens: float = Field(
        0.3,
        ge=0,
        description="Speed [m/s] above the least that headway leaves ours, up to which a neighbour "
        "is left to brake: who is faster where its course ends here within 1.6 s gives no way.",
    )
    neighbour_speed: float = Field(
        3.0, gt=0, description="Highest speed [m/s] of a neighbour: well above nmpc.v_max."
    )
    sigmas: float = Field(2.0, ge=0, description="σ of a neighbour's place that are kept clear.")
    obstacle_sigmas: float = Field(2.0, ge=0, description="σ of an obstacle's place likewise.")
    unseen_speed: float = Field(
        0.3,
        ge=0,
        description="Speed [m/s] at which a drone that is not seen may come nearer: no drone flies "
        "faster where it does not look (nmpc.v_blind, and its swing), and one that looks has a "
        "certificate of its own.",
    )
    unseen_way: float = Field(
        0.3, ge=0, description="Way [m] into space not looked at that is nothing: hovering drifts."
    )
    seen_range: float = Field(
        5.0, gt=0, description="Distance [m] up to which a look would have shown a drone."
    )
    track: float = Field(
        0.06, ge=0, description="How far [m] the drone may be beside its way at its beginning."
    )
    track_rate: float = Field(
        0.06, ge=0, description="How much farther [m/s] beside its way with time."
    )
    rest: float = Field(
        0.3, gt=0.15, description="Speed [m/s] below which the drone counts as at rest."
    )
    fence_over: float = Field(
        0.5, ge=0, description="How far [m] a way may lead over the fence: half of fence_land."
    )


class Flown(Enum):
    """What flies, with which certificate."""

    COMMAND = "command"  # the guard's command, which is accepted
    WAY = "way"  # a way to stop that is accepted, instead of the command
    NONE = "none"  # nothing is accepted; where it may, the way with the most room flies


@dataclass(frozen=True)
class Certified:
    """What came of one tick's command.

    margin: m left over at the tightest place of the best way after the command; < 0: it is refused.
    cause: what is at that place. instead: what flies where the command is refused.
    """

    flown: Flown
    margin: float
    cause: str
    instead: RateCommand | None = None


class _Try(NamedTuple):
    """A way that was tried, number k of some, and what it leaves over [m], see `Findings`.

    u: (4,), its first command. Most ways are not flown: `way` and `command` are made when asked.
    """

    ways: Ways
    k: int
    u: Vector
    margin: float
    cause: str
    course: float
    clear: float
    fixed: float

    @property
    def way(self) -> Ways:
        """The way alone."""
        return self.ways.one(self.k)

    @property
    def command(self) -> RateCommand:
        """The first command of the way."""
        return RateCommand(self.u[1:4], float(self.u[0]))

    @property
    def room(self) -> float:
        """The room that the way leaves [m], moving and standing."""
        return min(self.margin, self.course)

    @property
    def walls(self) -> tuple[bool, float]:
        """The key of ways by what gives way to nobody, the best one largest.

        A drone that is nearer to a wall than doubts allow lacks room on all ways: then those lead
        no deeper than `_AT_WALL`, or as little as there is.
        """
        return self.fixed >= 0.0, min(self.fixed + _AT_WALL, 0.0)

    @property
    def evades(self) -> tuple[bool, float, float, float]:
        """The key of evasions, the best one largest.

        A neighbour may give way, a wall does not. Of those that clear all the shortest step is
        best: a longer one would only bring the drone near others.
        """
        step = norm(self.ways.velocity[self.k]) * float(self.ways.hold[self.k])
        return *self.walls, min(self.clear, 0.0), -step

    @property
    def rank(self) -> tuple[bool, bool, float, float, float]:
        """The key of ways, the best one largest: one that is accepted comes before others."""
        return self.margin >= 0.0, *self.evades


def _until_room(ways: list[_Try], kind: int) -> list[_Try]:
    """Return the ways, straight on first, up to the first kind that has room.

    kind: number of steps of each length, which follow each other.
    """
    for count in range(1, len(ways), kind):
        if max(way.room for way in ways[:count]) >= 0.0:
            return ways[:count]
    return ways


def _carried(scene: Scene, dt: float) -> Scene:
    """Return the scene `dt` [s] later: what has a course has moved on."""
    neighbours, cylinders = scene.neighbours.copy(), scene.cylinders.copy()
    neighbours[:, :3] += dt * neighbours[:, 3:6]
    cylinders[:, :2] += dt * cylinders[:, 4:6]
    return replace(scene, neighbours=neighbours, cylinders=cylinders)


def braking_law(guard: GuardConfig, delay: Delay, yaw_rate: float = 0.0) -> Law:
    """Return the law of the guard's brake; delay: limits the body rates. yaw_rate: rad/s, kept."""
    fastest = within_doubt(np.array([guard.omega_max, 0.0, 0.0]), delay)[0]
    return Law(
        guard.brake_gain,
        guard.brake_max,
        guard.attitude_gain,
        fastest,
        guard.c_min,
        guard.c_max,
        yaw_rate,
    )


def bounds_of(
    config: CertificateConfig, guard: GuardConfig, radius: float, slow: float = 0.5
) -> Bounds:
    """Return what the check relies on.

    radius: m, of the own drone. slow: m/s, the least to which headway slows ours down.
    """
    given = config.model_dump(exclude={"seen_range", "enforce", "neighbour_hastens"})
    return Bounds(
        radius=radius,
        c_max=guard.c_max,
        omega_max=guard.omega_max,
        neighbour_trusted=slow + config.neighbour_hastens,
        **given,
    )


class Certifier:
    """Finds ways to stop, and remembers the one that was accepted last."""

    def __init__(
        self, config: CertificateConfig, guard: GuardConfig, radius: float, slow: float = 0.5
    ) -> None:
        """radius: m, of the own drone. slow: m/s, see `bounds_of`."""
        self._guard = guard
        self._enforce = config.enforce
        self._bounds = bounds_of(config, guard, radius, slow)
        self._bounds = replace(self._bounds, rest=config.rest - _SPEED_TUBE)
        # A way that was accepted is flown on within its tube, which deviations may have used up.
        self._continued = replace(
            self._bounds,
            track=0.0,
            sigmas=0.5 * config.sigmas,
            obstacle_sigmas=0.5 * config.obstacle_sigmas,
            unseen_way=2.0 * config.unseen_way,
        )
        self.reset()

    def reset(self) -> None:
        """Forget the way that was accepted last."""
        self._last: Ways | None = None
        self._ticks = 0

    def certify(
        self,
        command: RateCommand,
        prediction: Prediction,
        around: Callable[[], Scene],
        delay: Delay,
        v_max: float = math.inf,
    ) -> Certified | None:
        """Return whether the command may fly, and what else may; None: it was not judged.

        prediction: of the state at which it takes effect. around: makes the scene, at the own
        state. delay: limits the body rates. v_max: m/s, of (32): who evades faster hits the next.
        """
        self._ticks += 1
        if not self._enforce and self._ticks % _SHADOW:
            return None
        first = np.array([command.c, *within_doubt(command.omega, delay)])
        law = braking_law(self._guard, delay, float(first[3]))  # it looks where the plan does
        scene = _carried(around(), prediction.delay)
        after, at_once = self._out(first, prediction, scene, law, v_max)
        safe = max(after, key=lambda way: way.margin)
        leaves = max(way.course for way in after)
        if safe.margin >= 0.0 and leaves >= 0.0:
            self._last = max(after, key=lambda way: way.room).way if safe.room < 0.0 else safe.way
            return Certified(Flown.COMMAND, safe.margin, safe.cause)
        if safe.margin < 0.0 and not self._enforce:  # no matter what else there is
            self._last = None
            return Certified(Flown.NONE, safe.margin, safe.cause)
        if safe.margin >= 0.0:
            stays, ways = max(after, key=lambda way: way.clear), []
        else:
            held = self._going_on(prediction, scene, law)
            ways = [] if held else at_once
            stays = max(held or ways, key=lambda way: way.rank)
        if stays.course < 0.0:  # it stops on somebody's course, and would be hit at rest
            ways = ways or at_once
            leaving = max(ways, key=lambda way: way.evades)
            if leaving.clear >= stays.clear + _GAIN and leaving.walls >= stays.walls:
                return self._fly(leaving, safe.margin, "course")
        if safe.margin >= 0.0:
            self._last = safe.way
            return Certified(Flown.COMMAND, safe.margin, safe.cause)
        return self._fly(stays, safe.margin, safe.cause)

    def _out(
        self, first: Vector, prediction: Prediction, scene: Scene, law: Law, v_max: float
    ) -> tuple[list[_Try], list[_Try]]:
        """Return ways to stop after the command `first` (4,), until one has room; and at once.

        Those at once are looked at where straight on after the command there is no room.
        """
        straight = self._tried(STRAIGHT, first, prediction, scene, law)
        if straight[0].room >= 0.0:
            return straight, []
        # Many ways at once take little longer than few, and most often all of them are needed.
        pressed = self._pressed(scene, prediction.x0[:3])
        sides = [s for s in _SIDES if pressed or s[0] <= v_max] or _SIDES[:1]
        kinds = [aside(prediction.x0[3:6], *side, upright=pressed) for side in sides]
        ways = joined(*kinds)
        n = len(ways)
        after = np.arange(2 * n + 1) < n
        both = joined(ways, STRAIGHT, ways)
        found = self._tried(both, first, prediction, scene, law, after=after)
        kind = len(kinds[0])
        return _until_room(straight + found[:n], kind), _until_room(found[n:], kind)

    def _pressed(self, scene: Scene, p: Vector) -> bool:
        """Return whether somebody near p (3,) m comes, faster than who is left to brake.

        One that flies away, as ours do who have evaded, presses nobody.
        """
        rows, trusted = scene.neighbours, self._bounds.neighbour_trusted
        return any(
            norm(r[:3] - p) < _NEAR and norm(r[3:6]) > trusted and (r[:3] - p) @ r[3:6] < 0.0
            for r in rows
        )

    def _going_on(self, prediction: Prediction, scene: Scene, law: Law) -> list[_Try]:
        """Return the way that was accepted last; nothing where there is none that still holds.

        It holds by less doubt than it was accepted by; what room it leaves is told by all of it, as
        of the others.
        """
        if self._last is None:
            return []
        (held,) = self._tried(self._last, None, prediction, scene, law, self._continued)
        if held.margin < 0.0:
            return []
        (now,) = self._tried(self._last, None, prediction, scene, law)
        return [now._replace(margin=held.margin)]

    def _fly(self, best: _Try, margin: float, cause: str) -> Certified:
        """Return that a way is flown instead of the command."""
        if not self._enforce:
            self._last = None
            return Certified(Flown.NONE, margin, cause)
        self._last = best.way.later(DT)
        flown = Flown.WAY if best.margin >= 0.0 else Flown.NONE
        return Certified(flown, margin, cause, best.command)

    def _tried(
        self,
        ways: Ways,
        first: Vector | None,
        prediction: Prediction,
        scene: Scene,
        law: Law,
        bounds: Bounds | None = None,
        after: NDArray[np.bool_] | None = None,
    ) -> list[_Try]:
        """Return what the ways leave over, flown after the command `first` (4,) or at once.

        after: (n,), which of them begin with that command; None: all.
        """
        x0, wind = prediction.x0, prediction.disturbance
        flown = simulate(x0, ways, wind, law, first, after)
        # A plan may lead to a stop on a neighbour's course, as long as a way out is left after it.
        found = check(flown, x0, wind, scene, bounds or self._bounds)
        return [
            _Try(ways, k, *left_over)
            for k, left_over in enumerate(
                zip(
                    flown.u,
                    found.margin.tolist(),
                    found.cause,
                    found.course.tolist(),
                    found.clear.tolist(),
                    found.fixed.tolist(),
                    strict=True,
                )
            )
        ]
