"""Pilots of foreign drones: drones that give way to nobody.

A pilot knows where every drone truly is. It is an adversary, and one that had to find its victim,
or that wavered with its autopilot's estimate, would be a weaker one. It asks its autopilot for
velocities; body, wind and inner loops are those of every vehicle. World frame, SI.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.firmware.flavour import Mode

Floats = NDArray[np.float64]

APPROACH = 1.0  # 1/s: speed by the distance that is left; the position loop's own gain
CLIMBED = 0.3  # m: a take-off this close to its place is over
LIFTED = 0.5  # share of the climb after which the pilot takes over from the take-off
LOWEST = 0.5  # m over the start: a pursuer stays in the air where its victim lands
CLEAR = 0.6  # m between a way and a trunk
_ROUND = 1.1  # places beside a trunk are this many times as far from it: ways cut their corners
_BENDS = 4
_NO_TRUNKS = np.zeros((0, 3))
IN_THE_AIR = 0.3  # m over the start, as a flight's figures count it


class Pilot(Protocol):
    """The pilot of vehicle i. place: (3,) m, where its take-off ends."""

    i: int
    place: Floats

    def velocity(self, now: float, p: Floats) -> Floats:
        """Return the velocity (3,) m/s to fly with; p: (n,3) m, true places of all vehicles."""
        ...


class Hover:
    """Takes off and stays."""

    def __init__(self, i: int, place: ArrayLike, speed: float = 1.0) -> None:
        """place: (3,) m. speed: m/s, the most with which it returns there."""
        self.i, self.place, self.speed = i, np.asarray(place, float), speed

    def velocity(self, now: float, p: Floats) -> Floats:
        """Return the velocity (3,) m/s towards its place."""
        return _bounded(APPROACH * (self.place - p[self.i]), self.speed)


class Straight(Hover):
    """Flies from target to target on straight lines round upright trunks, and stays at the last.

    It gives way to nobody.
    """

    def __init__(
        self,
        i: int,
        place: ArrayLike,
        targets: Sequence[ArrayLike],
        speed: float,
        trunks: Floats = _NO_TRUNKS,
    ) -> None:
        """targets: (3,) m each. trunks: (k,3) x, y, radius, m."""
        super().__init__(i, place, speed)
        self._route = [self.place]
        for target in targets:
            self._route += _way(self._route[-1], np.asarray(target, float), trunks, _BENDS)
        self._climbed = False

    def velocity(self, now: float, p: Floats) -> Floats:
        """Return the velocity (3,) m/s along the present line, and back to it."""
        here = p[self.i]
        self._climbed |= bool(np.linalg.norm(self.place - here) < CLIMBED)
        while self._climbed and len(self._route) > 1:
            way = self._route[1] - self._route[0]
            length = float(np.linalg.norm(way))
            along = way / length if length > 0.0 else np.zeros(3)
            left = float((self._route[1] - here) @ along)
            last = len(self._route) == 2
            if length > 0.0 and (last or left > 0.0):
                off = (self._route[1] - here) - left * along
                ahead = min(APPROACH * left, self.speed) if last else self.speed
                return ahead * along + _bounded(APPROACH * off, self.speed)
            self._route.pop(0)
        return _bounded(APPROACH * (self._route[0] - here), self.speed)


class Pursue(Hover):
    """Flies straight at the nearest of its prey that is in the air."""

    def __init__(
        self,
        i: int,
        place: ArrayLike,
        prey: Sequence[int],
        floor: ArrayLike,
        speed: float,
        after: float,
    ) -> None:
        """prey: indices. floor: (n,) m, height of each start. after: s of the flight."""
        super().__init__(i, place, speed)
        self._prey, self._after = np.asarray(prey, int), after
        self._floor = np.asarray(floor, float)

    def velocity(self, now: float, p: Floats) -> Floats:
        """Return the velocity (3,) m/s: full speed at the prey; hover where none flies."""
        flies = self._prey[p[self._prey, 2] > self._floor[self._prey] + IN_THE_AIR]
        if now < self._after or not len(flies):
            return super().velocity(now, p)
        aim = p[flies].copy()
        aim[:, 2] = np.maximum(aim[:, 2], self._floor[self.i] + LOWEST)
        ways = aim - p[self.i]
        far = np.linalg.norm(ways, axis=1)
        k = int(far.argmin())
        straight: Floats = self.speed * ways[k] / max(float(far[k]), 1e-6)
        return straight


class ForeignFleet:
    """Flies the foreign drones that have no companion."""

    def __init__(self, autopilots: Autopilots, pilots: Iterable[Pilot]) -> None:
        self._autopilots = autopilots
        self._pilots = list(pilots)
        self._starts = autopilots.vehicles.p.copy()
        self._flying: set[int] = set()

    def update(self, now: float) -> None:
        """Take off, or fly on as each pilot wants at `now` [s of the flight]."""
        p, a = self._autopilots.vehicles.p, self._autopilots
        for pilot in self._pilots:
            i = pilot.i
            height = float(pilot.place[2] - self._starts[i, 2])
            if i in self._flying:
                # In another mode it is not the pilot that flies: a failsafe, or a fault.
                if a.mode[i] is Mode.HOLD:
                    a.fly_with(i, pilot.velocity(now, p))
            elif p[i, 2] - self._starts[i, 2] > LIFTED * height:
                a.units[i].commander.set_mode(Mode.HOLD)
                self._flying.add(i)
            elif not a.units[i].commander.armed:
                a.take_off(i, height)


def _way(start: Floats, end: Floats, trunks: Floats, bends: int) -> list[Floats]:
    """Return the places (3,) m after `start` on a way to `end` round trunks, `end` the last.

    bends: how often a line may be split in two; after that it leads through what stands there.
    """
    line = end[:2] - start[:2]
    length = float(np.linalg.norm(line))
    if length < 1e-6 or not bends:
        return [end]
    line = line / length
    off = trunks[:, :2] - start[:2]
    along, aside = off @ line, off @ np.array([-line[1], line[0]])  # aside: to the left
    apart = trunks[:, 2] + CLEAR
    meets = (np.abs(aside) < apart) & (along > apart) & (along < length - apart)
    if not meets.any():
        return [end]
    k = int(np.where(meets, along, np.inf).argmin())
    side = np.array([line[1], -line[0]]) * (1.0 if aside[k] > 0.0 else -1.0)
    share = along[k] / length
    place = start + share * (end - start)
    place[:2] = trunks[k, :2] + _ROUND * apart[k] * side
    return [*_way(start, place, trunks, bends - 1), *_way(place, end, trunks, bends - 1)]


def _bounded(v: Floats, most: float) -> Floats:
    """Return v (3,) no longer than `most`."""
    return v * min(1.0, most / max(float(np.linalg.norm(v)), 1e-9))
