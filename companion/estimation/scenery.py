"""Scenery: what a detector takes for a drone close by, though it is far behind.

A drone's range is told by its size. Woods at the horizon, a hole in a wall or a far pole of that
size seem to fly along: whatever the own drone does, they stay in the same direction, as large as
before. A neighbour does not copy every swerve. So a direction shows scenery where a place at rest,
at least four times as far as it seems, explains what was found there, while a neighbour at that
range would have had to swerve with the own drone. This is parallax, and needs no colours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.estimation.turns import turn_about
from companion.types import Detection
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import VehicleState

_SPAN = 20.0  # s of finds that count, and after the last of which a direction is forgotten
_FEWEST = 6  # finds
_SHORTEST = 4.0  # s from the first to the last
_ORDER = 2  # of the polynomial of time that a neighbour's steady flight, or a start, follows
_EVERY = 0.3  # s between two judgements of a direction
_EXCITED = 0.03  # rad, rms, by which a neighbour at rest or in steady flight would have moved
_STILL = 0.03  # rad, rms, that the directions may be off those of a place at rest
_SHARE = 1.0 / 3.0  # of the former, at most, for the latter
_NEARNESS = 0.25  # range over true distance, two sigmas included
_GROWTH = 0.2  # change of the logarithm of its size: what comes nearer grows
_AGREED = 2  # judgements on end
_BESIDE, _LIKE = 0.08, 0.5  # rad, and of the logarithm of range: the same thing once more
_MOST = 200  # directions remembered
_GAP = 1.0  # s without pictures, after which the own way is not known
_NOWHERE = np.zeros(3)


@dataclass
class _Place:
    """Finds that lie in one direction.

    finds: (n,8), of each the time [s], own way (3,) m, direction (3,), logarithm of range.
    """

    finds: Vector
    judged: float = -math.inf
    agreed: int = 0

    @property
    def is_scenery(self) -> bool:
        """Return whether the last judgements agree that this is far behind."""
        return self.agreed >= _AGREED


class Scenery:
    """Remembers what was found in which direction, and which of it is far behind."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all."""
        self._way: Vector = np.zeros(3)
        self._time: float | None = None
        self._places: list[_Place] = []

    def turn(self, angle: float) -> None:
        """Turn all directions and ways left by a small `angle` [rad]."""
        turn_about(self._way[None], _NOWHERE, angle)
        for place in self._places:
            turn_about(place.finds[:, 1:4], _NOWHERE, angle)
            turn_about(place.finds[:, 4:7], _NOWHERE, angle)

    def without(
        self, detections: Sequence[Detection], time: float, own: VehicleState, q_bc: Vector
    ) -> list[Detection]:
        """Return the detections of the picture taken at `time` [s] from `own` that may be drones.

        q_bc: (4,) camera → body. The own way is that of the velocity: with a place that jumps all
        neighbours would seem to jump, too.
        """
        if self._time is None or not 0.0 <= time - self._time < _GAP:
            self.reset()
            self._time = time
        self._way = self._way + own.v * (time - self._time)
        self._time = time
        self._places = [p for p in self._places if time - p.finds[-1, 0] < _SPAN][-_MOST:]
        if not detections:
            return []
        rotation = rotation_matrix(own.q_wb) @ rotation_matrix(q_bc)
        directions = np.array([d.direction for d in detections]) @ rotation.T
        sizes = np.log([d.range for d in detections])
        fits = self._fits(directions, sizes)
        kept = []
        for row, detection in enumerate(detections):
            find = np.array([[time, *self._way, *directions[row], sizes[row]]])
            near = [self._places[k] for k in fits[row].argsort() if fits[row, k] < math.inf]
            fresh = next((p for p in near if p.finds[-1, 0] < time), None)
            if fresh is not None:
                finds = fresh.finds
                fresh.finds = np.vstack([finds[finds[:, 0] > time - _SPAN], find])
                self._judge(fresh, time)
            elif not near:
                self._places.append(_Place(find))
            if not any(p.is_scenery for p in near):
                kept.append(detection)
        return kept

    def _fits(self, directions: Vector, sizes: Vector) -> Vector:
        """Return how far each find (n,3) is off each known place [rad] (n,m); inf: too far."""
        if not self._places:
            return np.zeros((len(directions), 0))
        last = np.array([p.finds[-1] for p in self._places])
        apart: Vector = np.arccos(np.clip(directions @ last[:, 4:7].T, -1.0, 1.0))
        apart[(apart > _BESIDE) | (np.abs(sizes[:, None] - last[:, 7]) > _LIKE)] = math.inf
        return apart

    def _judge(self, place: _Place, time: float) -> None:
        if time - place.judged < _EVERY or len(place.finds) < _FEWEST:
            return
        place.judged = time
        place.agreed = place.agreed + 1 if _far_behind(place.finds) else 0


def _far_behind(finds: Vector) -> bool:
    """Return whether finds in one direction, (n,8) as above, are of what is far behind.

    Angles are small: directions and ways are taken across the mean direction.
    """
    if not np.isfinite(finds).all():
        return False
    time, way, direction = finds[:, 0], finds[:, 1:4], finds[:, 4:7]
    since, span = time - time.mean(), float(time[-1] - time[0])
    if span < _SHORTEST or abs(float(since @ finds[:, 7]) / float(since @ since)) * span > _GROWTH:
        return False
    mean = direction.mean(axis=0)
    mean /= math.sqrt(float(mean @ mean))
    moved = (way - way.mean(axis=0)) / math.exp(float(np.median(finds[:, 7])))
    moved -= np.outer(moved @ mean, mean)
    powers = np.vander(since / span, _ORDER + 1)
    excited = _rms(moved - powers @ np.linalg.lstsq(powers, moved)[0])
    if excited < _EXCITED:
        return False
    turned = direction - direction.mean(axis=0)
    turned -= np.outer(turned @ mean, mean)
    total = float((moved * moved).sum())
    nearness = -float((turned * moved).sum()) / total
    left = _rms(turned + nearness * moved)
    doubt = left / math.sqrt(total)
    return left < min(_STILL, _SHARE * excited) and abs(nearness) + 2.0 * doubt < _NEARNESS


def _rms(offsets: Vector) -> float:
    return math.sqrt(float((offsets * offsets).sum()) / len(offsets))
