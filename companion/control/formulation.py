"""From a reference to the problem that the NMPC solves, eq. (11)-(38)."""

from __future__ import annotations

import math

import numpy as np

from companion.control.nmpc import Instance, Neighbour, NmpcConfig, make_instance
from companion.estimation.prediction import Prediction
from companion.guidance.fence import FenceConfig
from companion.guidance.guidance import Reference
from companion.types import Obstacles, Track
from mavlink_bridge.shared.arrays import Vector, lengths
from mavlink_bridge.shared.distance import between
from mavlink_bridge.wire.messages import VehicleState


class Formulation:
    """Fills in the NMPC's instance, tick by tick."""

    def __init__(self, nmpc: NmpcConfig, fence: FenceConfig) -> None:
        self._nmpc = nmpc
        self._fence = fence

    def instance(self, own: VehicleState, reference: Reference, prediction: Prediction) -> Instance:
        """Return the problem of this tick.

        The distance (37) is kept to every neighbour that is near, or a drone that dodges one of
        them flies into the next. The first few planes are kept: walls before the fence, which the
        guard minds, too.
        """
        offset = reference.map_offset
        band = self._fence.altitude_planes(
            reference.aim[2] - reference.progress.climb + offset[2],
            reference.floor + offset[2],
            float(own.p[2] + offset[2]),
            self._nmpc.d_obstacle_safety,
        )
        if reference.land:  # the autopilot takes it below the floor, where plans are hard to make
            band = band[:1]
        planes = [
            _off_map(band, offset),
            reference.obstacles.planes,
            _off_map(self._fence.near(own.p + offset, self._nmpc.d_obstacle_safety), offset),
        ]
        return make_instance(
            self._nmpc,
            x0=prediction.x0,
            u_last=prediction.u_last,
            goal=reference.target,
            yaw=reference.yaw,
            speed=reference.speed,
            v_max=reference.v_max,
            neighbours=[
                self._neighbour(own, t, t.id in reference.cohesive, prediction.delay)
                for t, _ in reference.near[: self._nmpc.neighbours]
            ],
            cylinders=widened(
                reference.obstacles, own.p, self._nmpc.kappa, self._nmpc.d_obstacle_safety
            ),
            planes=np.vstack(planes),
            disturbance=prediction.disturbance,
        )

    def _neighbour(
        self, own: VehicleState, track: Track, cohesive: bool, delay: float
    ) -> Neighbour:
        """Return a track as the NMPC wants it, carried over the delay; eq. (13)."""
        nmpc = self._nmpc
        ahead = track.p + track.v * delay
        sigmas = position_velocity_sigma(own, track, nmpc.d_agent_safety, nmpc.agent_vertical_scale)
        return Neighbour(ahead, track.v, sigmas, float(cohesive))


def _off_map(planes: Vector, offset: Vector) -> Vector:
    """Return half-spaces (H,4) of the map in the frame that is `offset` (3,) m less."""
    moved = planes.copy()
    moved[:, 3] -= planes[:, :3] @ offset
    return moved


def position_velocity_sigma(
    own: VehicleState, track: Track, distance: float, vertical_scale: float
) -> tuple[float, float]:
    """Return the 1σ position [m] and velocity [m/s] uncertainty that inflates (37).

    distance: m, of (37). vertical_scale: how much taller than wide the ellipsoid of (37) is.

    Room that the uncertainty of a neighbour out of sight claims in vain is room that the plan takes
    from others. So that uncertainty claims only the room that is free now, and with time no more of
    it than once that room a second. The rule is from when one slack served all neighbours; since
    each has its own, two paired crossings said nothing (docs/history/mechanisms.md).
    """
    variance, _, of_speed = track.variances
    place, speed = math.sqrt(variance), math.sqrt(of_speed)
    if not track.lost:
        return place, speed
    room = max(float(between(track.p, own.p, vertical_scale)) - distance, 0.0)
    return min(place, room), min(speed, room)


_COVERED = 0.12  # m of a trunk's doubt that the margin in d_obstacle_safety is for
_WIDENING_MAX = 0.35  # m
_ROOM_KEPT = 0.3  # m that stays free between two widened trunks, beside their safety distances


def widened(obstacles: Obstacles, p: Vector, kappa: float, safety: float) -> Vector:
    """Return the cylinders (K,3) with radii [m] that their uncertainty widens in (38).

    p: (3,) m, the drone. kappa: standard deviations added. safety: m, of (38). No widening takes
    room that the drone is in, or closes the way between two trunks that (38) leaves open.
    """
    cylinders = obstacles.cylinders
    k = len(cylinders)
    if not k:
        return cylinders
    more = np.minimum(np.maximum(kappa * obstacles.sigmas - _COVERED, 0.0), _WIDENING_MAX)
    if not more.any():
        return cylinders
    x, y, radii = cylinders.T
    room = np.hypot(x - p[0], y - p[1]) - radii - safety
    gaps = lengths(cylinders[:, None, :2] - cylinders[:, :2])
    gaps = gaps - radii[:, None] - radii - 2.0 * safety - _ROOM_KEPT
    gaps[gaps < -_ROOM_KEPT] = np.inf  # closed anyway, or from a trunk to itself
    bound = np.maximum(np.minimum(room, 0.5 * gaps.min(axis=1)), 0.0)
    wide = cylinders.copy()
    wide[:, 2] += np.minimum(more, bound)
    return wide
