"""Obstacle watch: do trunks stand, as the map and the certificate assume?

The map of obstacles takes all motion for error. Here trunks are tracked as neighbours are, from the
same looks, so that one that moves is found within half a second and has a course. Only sure ranges
serve: a trunk that moves is found by depth, not by pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from companion.estimation.tracker import Tracker, TrackerConfig
from companion.perception.frontend import Detections
from companion.types import Detection, Track, Trunk
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import VehicleState

_AGE = 0.5  # s of looks before a speed is believed
_SPEED = 0.5  # m/s: a range that is off by a third looks like this at cruise speed
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
            level = [_level(t.direction, seen.own, self._mount) for t in trunks]
            looks = [
                Detection(t.direction, t.distance / along, _BEARING, max(t.sigma, _LEAST))
                for t, along in zip(trunks, level, strict=True)
            ]
            self._tracker.update(seen.time, looks, seen.own, self._mount)
            self._remember_radii(seen.own, looks, trunks)
        self._tracker.predict(time)
        moving = [t for t in self._tracker.tracks() if _moves(t)]
        rows = [[*t.p[:2], self._radii.get(t.id, 0.5), _sigma(t), *t.v[:2]] for t in moving]
        broken = tuple(
            f"obstacle {t.id}: moves at {float(np.hypot(*t.v[:2])):.1f} m/s, 0 m/s are assumed"
            for t in moving
        )
        return Moving(np.array(rows, float).reshape(-1, 6), broken)

    def _remember_radii(
        self, own: VehicleState, looks: Sequence[Detection], trunks: Sequence[Trunk]
    ) -> None:
        tracks = self._tracker.tracks()
        self._radii = {t.id: self._radii.get(t.id, 0.5) for t in tracks}
        turn = rotation_matrix(own.q_wb) @ rotation_matrix(self._mount)
        for look, trunk in zip(looks, trunks, strict=True):
            place = own.p + turn @ look.direction * look.range
            for t in tracks:
                if np.hypot(*(t.p - place)[:2]) < _SAME:
                    self._radii[t.id] = trunk.radius


def _level(direction: Vector, own: VehicleState, mount: Vector) -> float:
    """Return how much of a unit direction, camera frame, lies along the ground."""
    world = rotation_matrix(own.q_wb) @ rotation_matrix(mount) @ direction
    return max(float(np.hypot(world[0], world[1])), 0.1)


def _moves(t: Track) -> bool:
    doubt = float(np.sqrt(np.trace(t.P[3:5, 3:5]) / 2.0))
    known = t.age >= _AGE and t.unseen <= _FORGET
    return known and float(np.hypot(*t.v[:2])) > max(_SPEED, _SIGMAS * doubt)


def _sigma(t: Track) -> float:
    return float(np.sqrt(np.trace(t.P[:2, :2]) / 2.0))
