"""Distances between agents and to obstacles, the same for planning and for the metrics.

`companion/control/nmpc/constraints.py` holds them as CasADi expressions; a test compares both.
"""

from __future__ import annotations

import numpy as np

from mavlink_bridge.shared.arrays import Vector, lengths


def between(a: Vector, b: Vector, vertical_scale: float = 1.0) -> Vector:
    """Return the distance (...,) [m] from points a (...,3) to b (...,3), eqs. (15), (37).

    vertical_scale: divides the height difference, as in the NMPC's ellipsoid.
    """
    return lengths((a - b) / np.array([1.0, 1.0, vertical_scale]))


def to_cylinder(p: Vector, x: Vector | float, y: Vector | float, radius: Vector | float) -> Vector:
    """Return the distance (...,) [m] from points p (...,2 or 3) to upright cylinders, (19), (38).

    It is negative inside. x, y, radius: m, of one cylinder or of one per point.
    """
    aside: Vector = np.hypot(p[..., 0] - x, p[..., 1] - y) - radius
    return aside


def to_ways(points: Vector, start: Vector, ends: Vector) -> Vector:
    """Return (n,K) m from points (K,2) to the segments from start (2,) to each of ends (n,2)."""
    way, offsets = ends - start, points - start
    square = np.maximum((way**2).sum(axis=1), 1e-12)
    along = np.minimum(np.maximum(way @ offsets.T / square[:, None], 0.0), 1.0)
    return lengths(offsets - along[..., None] * way[:, None])
