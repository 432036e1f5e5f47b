"""How far apart: one measure for the controller, what feeds it, and the metrics.

The NMPC says the same in CasADi's terms (`companion/control/nmpc/constraints.py`); a test holds
them together.
"""

from __future__ import annotations

import numpy as np

from mavlink_bridge.shared.arrays import Vector


def between(a: Vector, b: Vector, vertical_scale: float = 1.0) -> Vector:
    """(...,) m from points a (...,3) to b (...,3), centre to centre; (15), (37).

    vertical_scale: by how much heights count less, as in the NMPC's ellipsoid; 1: not at all.
    """
    apart: Vector = np.linalg.norm((a - b) / np.array([1.0, 1.0, vertical_scale]), axis=-1)
    return apart


def to_cylinder(p: Vector, x: Vector | float, y: Vector | float, radius: Vector | float) -> Vector:
    """(...,) m from points p (...,2 or 3) to the side of upright cylinders; (19), (38).

    Negative inside. x, y, radius: m, of one for all or of one for each.
    """
    aside: Vector = np.hypot(p[..., 0] - x, p[..., 1] - y) - radius
    return aside


def to_ways(points: Vector, start: Vector, ends: Vector) -> Vector:
    """(n,K) m from points (K,2) to the straight ways from start (2,) to each of ends (n,2)."""
    way, offsets = ends - start, points - start
    square = np.maximum((way**2).sum(axis=1), 1e-12)
    along = np.clip(way @ offsets.T / square[:, None], 0.0, 1.0)
    gap: Vector = np.linalg.norm(offsets - along[..., None] * way[:, None], axis=2)
    return gap
