"""Obstacle watch: do trunks stand, as the map and the certificate assume?

The map of obstacles takes all motion for error. Here trunks are tracked as neighbours are, from the
same looks, so that one that moves is found within half a second and has a course. Only sure ranges
serve: a trunk that moves is found by depth, not by pixels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from companion.estimation.tracker import Tracker
from companion.estimation.tracker_config import TrackerConfig
from companion.perception.frontend import Detections
from companion.types import Detection, Track, Trunk
from mavlink_bridge.shared.arrays import Vector, lengths
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import VehicleState

_AGE = 0.5  # s of looks before a speed is believed
_SPEED = 0.5  # m/s: a range that is off by a third looks like this at cruise speed
_SLOW = 0.99 * _SPEED  # tracks that are slower do not move; the rest is room for rounding
_SHARP = 0.05  # m, 1 σ of a look up to which it counts: ranges from pixels jump by metres
_SIGMAS = 3.0
_FORGET = 0.5  # s unseen, after which the course is not believed any more
_SAME = 0.6  # m between a look and the track that it belongs to
_BEARING, _LEAST = 0.01, 0.03  # rad, m: 1 σ of a look


@dataclass(frozen=True)
class Moving:
    """cylinders (k,6): those that move, as the checker takes them; broken: in words."""

    cylinders: Vector = field(default_factory=lambda: np.zeros((0, 6)))
    broken: tuple[str, ...] = ()


class ObstacleWatch:
    """Tracks trunks by their axes, at the drone's height."""

    def __init__(self, mount: Vector) -> None:
        """mount: (4,) camera → body."""
        self._mount = mount
        self.reset()

    def reset(self) -> None:
        """Forget all trunks."""
        self._tracker = Tracker(TrackerConfig())
        self._radii: dict[int, float] = {}

    def update(self, time: float, seen: Detections) -> Moving:
        """Return the trunks that move, at the tick of `time` [s]."""
        if seen.own is not None and seen.searched:
            trunks = [t for t in seen.trunks if t.sigma <= _SHARP and not t.assumed]
            self._look(seen.time, seen.own, trunks)
        self._tracker.predict(time)
        _, _, velocities = self._tracker.courses()
        if not (lengths(velocities[:, :2]) > _SLOW).any():
            return Moving()
        moving = [t for t in self._tracker.tracks() if _moves(t)]
        if not moving:
            return Moving()
        rows = [[*t.p[:2], self._radii.get(t.id, 0.5), _sigma(t), *t.v[:2]] for t in moving]
        broken = tuple(
            f"obstacle {t.id}: moves at {_level_speed(t):.1f} m/s, 0 m/s are assumed"
            for t in moving
        )
        return Moving(np.array(rows, float), broken)

    def _look(self, time: float, own: VehicleState, trunks: Sequence[Trunk]) -> None:
        """Take in the trunks of a frame taken at `time` [s] in the state `own`."""
        turn = rotation_matrix(own.q_wb) @ rotation_matrix(self._mount)
        looks, places = [], []
        for t in trunks:
            ray = turn @ t.direction
            x, y, _ = ray.tolist()
            away = t.distance / max(math.hypot(x, y), 0.1)
            looks.append(Detection(t.direction, away, _BEARING, max(t.sigma, _LEAST)))
            places.append(own.p + ray * away)
        self._tracker.update(time, looks, own, self._mount)
        self._remember_radii(np.array(places).reshape(-1, 3), trunks)

    def _remember_radii(self, places: Vector, trunks: Sequence[Trunk]) -> None:
        """Give the tracks the radii of the trunks that stand at places (n,3) m."""
        ids, tracked, _ = self._tracker.courses()
        self._radii = {name: self._radii.get(name, 0.5) for name in ids}
        apart = places[:, None, :2] - tracked[:, :2]
        same = np.hypot(apart[..., 0], apart[..., 1]) < _SAME
        for n, k in np.argwhere(same).tolist():
            self._radii[ids[k]] = trunks[n].radius


def _moves(t: Track) -> bool:
    if t.age < _AGE or t.unseen > _FORGET:
        return False
    doubt = math.sqrt(max(float(t.P[3, 3] + t.P[4, 4]), 0.0) / 2.0)
    return _level_speed(t) > max(_SPEED, _SIGMAS * doubt)


def _level_speed(t: Track) -> float:
    return math.hypot(t.v[0], t.v[1])


def _sigma(t: Track) -> float:
    return math.sqrt(max(float(t.P[0, 0] + t.P[1, 1]), 0.0) / 2.0)
