"""Surroundings: what the certificate has to keep clear of, from what one tick knows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from companion.estimation.known_obstacles import KnownObstacles
from companion.estimation.seen_space import SECTORS, SeenSpace
from companion.guidance.fence import FenceConfig
from companion.perception.camera_health import CameraFault
from companion.perception.frontend import Detections
from companion.perception.ground_plane import LEVEL, GroundPlane
from companion.perception.view import View
from companion.supervision.certificate import Scene
from companion.supervision.certify import CertificateConfig
from companion.supervision.neighbour_watch import NeighbourWatch
from companion.supervision.obstacle_watch import ObstacleWatch
from companion.types import Phase, Track
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.wire.messages import VehicleState

_LATELY = 1.0  # s; one unseen for longer is not lost in plain view: it was out of it


def _nothing() -> Scene:
    none = np.zeros((0, 3))
    return Scene(np.zeros((0, 11)), np.zeros((0, 6)), none, np.zeros((0, 4)), np.zeros(SECTORS))


@dataclass(frozen=True)
class Surroundings:
    """scene: makes the scene at the own state, not yet carried to the prediction.

    It is made where it is asked for: most ticks are not certified. broken: bounds, in words.
    """

    scene: Callable[[], Scene] = _nothing
    broken: tuple[str, ...] = ()


class SurroundingsEstimator:
    """Puts together what is seen, remembered, and not seen."""

    def __init__(self, config: CertificateConfig, fence: FenceConfig, view: View) -> None:
        self._config, self._fence, self._view = config, fence, view
        self._space = SeenSpace(view, config.seen_range)
        self._trunks = ObstacleWatch(view.mount)
        self._watch = NeighbourWatch(config.neighbour_acceleration, config.neighbour_speed)
        self._looked: VehicleState | None = None  # own state at the last picture that was searched

    def reset(self) -> None:
        """Forget all: the vehicle's frame has begun anew."""
        self._looked = None
        self._space.reset()
        self._watch.reset()
        self._trunks.reset()

    def update(
        self,
        time: float,
        own: VehicleState | None,
        seen: Detections,
        known: KnownObstacles,
        tracks: list[Track],
        map_offset: Vector,
        phase: Phase,
        ground: GroundPlane = LEVEL,
    ) -> Surroundings:
        """Return what is around `own` at the tick of `time` [s]; nothing where own is not known."""
        if own is None:
            return Surroundings()
        searched = seen.fault is CameraFault.NONE and not seen.partly
        looked = seen.own if searched else None
        free = self._space.update(own, looked, known, self._config.unseen_speed)
        watched, moving = self._watch.update(time, tracks), self._trunks.update(time, seen)
        # A place that came into view after the last picture has not been looked at: with a frozen
        # camera, who was out of view stays remembered.
        self._looked = eye = looked or self._looked or own

        def scene() -> Scene:
            planes = self._fence.planes()
            planes[:, 3] -= planes[:, :3] @ map_offset
            if phase is Phase.FLY:
                planes = np.vstack([planes, ground.half_space(self._fence.altitude_min)])
            places = np.array([t.p for t in watched.tracks]).reshape(-1, 3)
            hidden = known.hidden(eye.p, places)
            shown = self._view.shows(eye, places)
            away = [not v or h for v, h in zip(shown, hidden, strict=True)]
            rows = neighbour_rows(watched.tracks, away)
            cylinders = np.vstack([_cylinder_rows(known), moving.cylinders])
            return Scene(rows, cylinders, known.points, planes, free)

        return Surroundings(scene, watched.broken + moving.broken)


def neighbour_rows(tracks: list[Track], away: list[bool]) -> Vector:
    """Return the tracks (n,11) as the checker takes them.

    away: whether each is out of view. One that is lost in plain view may be anywhere that it can
    reach; one out of view is remembered, also when its place comes into view again.
    """
    if not tracks:
        return np.zeros((0, 11))
    covariance = np.array([t.P for t in tracks])
    b = covariance[:, :3, 3:]
    blocks = covariance[:, :3, :3], 0.5 * (b + b.transpose(0, 2, 1)), covariance[:, 3:, 3:]
    # Along the axis where each is largest: a range is less sure than a bearing.
    variances = np.linalg.eigvalsh(np.array(blocks))[:, :, -1]
    unseen = np.array([t.unseen for t in tracks])
    gone = [out or t.unseen > _LATELY for t, out in zip(tracks, away, strict=True)]
    out = np.array([t.lost and out for t, out in zip(tracks, gone, strict=True)], float)
    places, speeds = np.array([t.p for t in tracks]), np.array([t.v for t in tracks])
    return np.column_stack([places, speeds, *variances, unseen, out])


def _cylinder_rows(known: KnownObstacles) -> Vector:
    """Return the trunks (k,6) as the checker takes them: at rest."""
    k = len(known.cylinders)
    sigmas = known.sigmas if len(known.sigmas) == k else np.zeros(k)
    return np.column_stack([known.cylinders, sigmas, np.zeros((k, 2))])
