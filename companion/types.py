"""Data types of one tick (design of the pipeline): SI, radians, the drone's own ENU frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Image = NDArray[np.uint8]
Ranges = NDArray[np.float16]

_LOST = 0.3  # s unseen


@dataclass(frozen=True)
class Detection:
    """A neighbouring drone seen in one frame, in the camera frame (x right, y down, z forward).

    direction: (3,) unit vector to its centre. range: m. sigma_bearing: rad. sigma_range: m.
    score: 0…1, the detector's confidence.
    """

    direction: Vector
    range: float
    sigma_bearing: float = 0.01
    sigma_range: float = 0.1
    score: float = 1.0


@dataclass(frozen=True)
class Trunk:
    """A vertical cylinder seen in one frame, given by what the image shows of it.

    direction: (3,) unit vector, camera frame, to the point of its axis at the camera's height.
    distance: m, horizontal, from the camera to its axis. radius: m. sigma: m, of `distance`.
    assumed: the radius was, and with it the distance; only the width was seen.
    """

    direction: Vector
    distance: float
    radius: float
    sigma: float = 0.1
    assumed: bool = False


@dataclass(frozen=True)
class Track:
    """A neighbour as the tracker knows it, in the drone's own world frame (ENU).

    p (3,) m, v (3,) m/s, P (6,6) covariance of (p, v). age: s since birth. unseen: s since
    the last detection.
    """

    id: int
    p: Vector
    v: Vector
    P: Vector
    age: float
    unseen: float

    @property
    def lost(self) -> bool:
        """Whether it is out of sight: what it does now is a guess."""
        return self.unseen > _LOST


@dataclass(frozen=True)
class Obstacles:
    """What the NMPC must avoid, in the drone's own world frame (ENU), nearest first.

    cylinders: (K,3) x, y, radius [m], vertical. planes: (H,4) n_x, n_y, n_z, b with |n| = 1:
    free where n·p <= b. points: (P,3) m, surface points of other shapes.
    """

    cylinders: Vector
    planes: Vector
    points: Vector

    @staticmethod
    def none() -> Obstacles:
        """No obstacle known."""
        return Obstacles(np.zeros((0, 3)), np.zeros((0, 4)), np.zeros((0, 3)))
