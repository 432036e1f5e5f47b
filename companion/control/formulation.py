"""From a reference to the problem that the NMPC solves, eq. (11)-(38)."""

from __future__ import annotations

import math

import numpy as np

from companion.control.nmpc import Instance, Neighbour, NmpcConfig, make_instance
from companion.estimation.prediction import Prediction
from companion.guidance.fence import FenceConfig
from companion.guidance.guidance import Reference
from companion.guidance.reciprocity import ReciprocityConfig, give_way_velocity
from companion.types import Track
from mavlink_bridge.shared.distance import between
from mavlink_bridge.wire.messages import VehicleState


class Formulation:
    """Fills in the NMPC's instance, tick by tick."""

    def __init__(
        self,
        nmpc: NmpcConfig,
        fence: FenceConfig,
        reciprocity: ReciprocityConfig,
    ) -> None:
        self._nmpc = nmpc
        self._fence = fence
        self._reciprocity = reciprocity

    def instance(self, own: VehicleState, reference: Reference, prediction: Prediction) -> Instance:
        """Return the problem of this tick.

        The distance (37) is kept to every neighbour that is near, or a drone that dodges one of
        them flies into the next. The first few planes are kept: walls before the fence, which the
        guard minds, too.
        """
        planes = [
            self._fence.altitude_planes(reference.aim[2]),
            reference.obstacles.planes,
            self._fence.near(own.p, self._nmpc.d_obstacle_safety),
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
                for t, _ in reference.near
            ],
            cylinders=reference.obstacles.cylinders,
            planes=np.vstack(planes),
            disturbance=prediction.disturbance,
        )

    def _neighbour(
        self, own: VehicleState, track: Track, cohesive: bool, delay: float
    ) -> Neighbour:
        """Return a track as the NMPC wants it, carried over the delay, giving way; eq. (13)."""
        nmpc = self._nmpc
        scale = nmpc.agent_vertical_scale
        over = (track.p[2] - own.p[2]) / scale
        apart = math.sqrt(max(nmpc.d_agent_safety**2 - over**2, 0.0))
        v = track.v + give_way_velocity(own, track, apart, self._reciprocity)
        ahead = track.p + track.v * delay
        sigmas = position_velocity_sigma(own, track, nmpc.d_agent_safety, scale)
        return Neighbour(ahead, v, sigmas, float(cohesive))


def position_velocity_sigma(
    own: VehicleState, track: Track, distance: float, vertical_scale: float
) -> tuple[float, float]:
    """Return the 1σ position [m] and velocity [m/s] uncertainty that inflates (37).

    distance: m, of (37). vertical_scale: how much taller than wide the ellipsoid of (37) is.

    One slack serves all neighbours: room that the uncertainty of a neighbour out of sight claims in
    vain is room that the plan takes from another one in sight. So that uncertainty claims only the
    room that is free now, and with time no more of it than once that room a second.
    """
    place, speed = (math.sqrt(float(np.trace(track.P[k : k + 3, k : k + 3])) / 3) for k in (0, 3))
    if not track.lost:
        return place, speed
    room = max(float(between(track.p, own.p, vertical_scale)) - distance, 0.0)
    return min(place, room), min(speed, room)
