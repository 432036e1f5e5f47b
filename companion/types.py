"""Data types that the stages of one tick share: SI, radians, the drone's own ENU frame."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector

Image = NDArray[np.uint8]
Ranges = NDArray[np.float16]

STAMP_AHEAD = 0.03  # s that a stamp may be ahead of the vehicle's clock as it is estimated
_LOST = 0.3  # s unseen, after which a neighbour is out of sight


@dataclass(frozen=True)
class Detection:
    """A neighbouring drone seen in one frame, in the camera frame (x right, y down, z forward).

    direction: (3,) unit vector to its centre. range: m. sigma_bearing: rad. sigma_range: m.
    score: 0…1, the detector's confidence. sigma_lasting: m, the part of sigma_range that the next
    frames are likely to share, as an object in front hides the same of it.
    """

    direction: Vector
    range: float
    sigma_bearing: float = 0.01
    sigma_range: float = 0.1
    score: float = 1.0
    sigma_lasting: float = 0.0

    @property
    def lasting(self) -> float:
        """The share of the range's variance that the next frames are likely to have, too, 0…1."""
        return min(self.sigma_lasting / max(self.sigma_range, 1e-9), 1.0) ** 2


@dataclass(frozen=True)
class Trunk:
    """A vertical cylinder seen in one frame, given by what the image shows of it.

    direction: (3,) unit vector, camera frame, to the point of its axis at the camera's height.
    distance: m, horizontal, from the camera to its axis. radius: m. sigma: m, of `distance`.
    assumed: only the width was seen; the radius is assumed, and the distance follows from it.
    half_width: rad, half the angle between its edges; 0: not both of them show.
    """

    direction: Vector
    distance: float
    radius: float
    sigma: float = 0.1
    assumed: bool = False
    half_width: float = 0.0


@dataclass(frozen=True)
class Track:
    """A neighbour as the tracker knows it, in the drone's own world frame (ENU).

    p: (3,) m. v: (3,) m/s. P: (6,6) covariance of (p, v). age: s since the track began. unseen: s
    since the last detection. scale: its size over the one that the detector assumes. confirmed:
    whether it is surely there.
    """

    id: int
    p: Vector
    v: Vector
    P: Vector
    age: float
    unseen: float
    scale: float = 1.0
    confirmed: bool = True

    @property
    def lost(self) -> bool:
        """Whether the neighbour is out of sight, so that its motion now is a guess."""
        return self.unseen > _LOST

    @cached_property
    def variances(self) -> tuple[float, float, float]:
        """Variance of p [m²], covariance of p and v [m²/s], variance of v [m²/s²], along one axis.

        Each is the mean of three axes.
        """
        place, both, speed = (
            float(self.P[i, j] + self.P[i + 1, j + 1] + self.P[i + 2, j + 2]) / 3.0
            for i, j in ((0, 0), (0, 3), (3, 3))
        )
        return place, both, speed


@dataclass(frozen=True)
class Obstacles:
    """What the NMPC must avoid, in the drone's own world frame (ENU), nearest first.

    cylinders: (K,3) x, y, radius [m], vertical; sigmas: (K,) m, 1 σ of their places. planes: (H,4)
    n_x, n_y, n_z, b with |n| = 1: free where n·p <= b. points: (P,3) m, surface points of other
    shapes.
    """

    cylinders: Vector
    planes: Vector
    points: Vector
    sigmas: Vector


class PlanStatus(Enum):
    """How a solve ended."""

    SOLVED = "solved"  # converged: the last step was small
    MAX_ITERATIONS = "max_iterations"  # usable, though the last step was still large
    QP_FAILED = "qp_failed"  # the quadratic program found no solution
    INFEASIBLE = "infeasible"  # the reference solver proved or gave up on feasibility
    NOT_FINITE = "not_finite"  # a number of the instance or of the plan is not finite


@dataclass(frozen=True)
class Plan:
    """A plan and how good it is.

    x: (N+1,10), u: (N,4), the plan in the instance's frame; x[0] is x0, its q perhaps negated (the
    same attitude). usable: the plan is of this instance; else x and u are the shifted previous
    plan, or hover where there is none, and the guard decides. iterations: of SQP or IPOPT.
    solve_time: s, by the clock given. step_norm: largest change of any variable in the last
    iteration. slack_*: m, deepest intrusion of the plan into what (37), (38) keep free. active:
    names of the active constraints. cost: (29) with the penalties.
    """

    x: Vector
    u: Vector
    status: PlanStatus
    usable: bool
    iterations: int
    solve_time: float
    step_norm: float
    slack_agent: float
    slack_obstacle: float
    slack_plane: float
    active: tuple[str, ...]
    cost: float


class Phase(Enum):
    """What the companion does with the vehicle."""

    WAIT = "wait"  # for telemetry, a frame and a tested solver, or for the pilot
    ARM = "arm"
    TAKEOFF = "takeoff"
    ENGAGE = "engage"  # setpoints hold the place while offboard is requested
    FLY = "fly"
    LAND = "land"
    DONE = "done"  # landed and disarmed
    PASSIVE = "passive"  # the autopilot or a pilot flies

    @property
    def flying(self) -> bool:
        """Whether the companion's setpoints fly the vehicle, or are about to."""
        return self in (Phase.ENGAGE, Phase.FLY, Phase.LAND)

    @property
    def on_mission(self) -> bool:
        """Whether the mission goes on."""
        return self in (Phase.FLY, Phase.LAND)
