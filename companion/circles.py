"""Circles through noisy outline points, some of which belong to something else.

A ball's outline is a circle in the stereographic plane, wherever in the picture it lies. What
hides a part of the ball replaces an arc by a chord inside the circle; a second ball behind it adds
an arc outside. Both are handled by scoring circles through triples of points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.types import Vector


@dataclass(frozen=True)
class Circle:
    """x, y, r in the units of the points; arc: share of the circumference seen, 0…1."""

    x: float
    y: float
    r: float
    arc: float


def fit_circles(points: Vector, tolerance: float, most: int = 4) -> list[Circle]:
    """Circles that explain points (n,2), most convincing first.

    tolerance: how far a point may lie off its circle. most: upper limit of circles.
    """
    found: list[Circle] = []
    rest = points
    while len(rest) >= 6 and len(found) < most:
        circle = _best_circle(rest, tolerance)
        if circle is None:
            break
        found.append(circle)
        distance = np.hypot(rest[:, 0] - circle.x, rest[:, 1] - circle.y)
        left = rest[distance > circle.r + 2.0 * tolerance]
        if len(left) < max(6, 0.12 * len(points)):
            break
        rest = left
    return found


def _best_circle(points: Vector, tolerance: float) -> Circle | None:
    centre = points.mean(axis=0)
    order = np.argsort(np.arctan2(points[:, 1] - centre[1], points[:, 0] - centre[0]))
    ring = points[order]
    n = len(ring)
    # Triples evenly and less evenly spread around the outline: one of them lies on one ball only.
    starts = np.arange(0, n, max(1, n // 24))
    strides = {max(1, n // k) for k in (3, 4, 5, 7, 10)}
    triples = np.array([(i, (i + s) % n, (i + 2 * s) % n) for s in strides for i in starts])
    x, y, r = _through(ring[triples])
    extent = float(np.ptp(points, axis=0).max())
    good = np.isfinite(r) & (r < 1.2 * extent) & (r > 0.1 * extent)
    if not good.any():
        return None
    x, y, r = x[good], y[good], r[good]
    off = np.hypot(points[:, 0] - x[:, None], points[:, 1] - y[:, None]) - r[:, None]
    on = (np.abs(off) < tolerance).sum(axis=1)
    outside = (off > tolerance).sum(axis=1)
    # A ball hides nothing outside itself, so points outside speak against it; yet with a second
    # ball in the blob some must lie outside. Equal scores go to the circle that encloses more.
    best = int(np.argmax(on - 0.5 * outside))
    circle = np.array([x[best], y[best], r[best]])
    inlier = np.abs(off[best]) < tolerance
    for _ in range(3):
        if inlier.sum() < 4:
            break
        circle = _least_squares(points[inlier])
        off_now = np.hypot(points[:, 0] - circle[0], points[:, 1] - circle[1]) - circle[2]
        inlier = np.abs(off_now) < tolerance
    if not np.isfinite(circle).all() or inlier.sum() < 4:
        return None
    angle = np.arctan2(points[inlier, 1] - circle[1], points[inlier, 0] - circle[0])
    sectors = np.unique(((angle + np.pi) * (24 / (2 * np.pi))).astype(int) % 24)
    # Few points cannot fill 24 sectors however complete the circle is.
    full = min(24.0, max(8.0, len(points) * 0.8))
    return Circle(*(float(v) for v in circle), arc=min(1.0, len(sectors) / full))


def _through(triples: Vector) -> tuple[Vector, Vector, Vector]:
    """Circles through (k,3,2) triples: centre x, y and radius, NaN where collinear."""
    a, b, c = triples[:, 0], triples[:, 1], triples[:, 2]
    ba, ca = b - a, c - a
    cross = 2.0 * (ba[:, 0] * ca[:, 1] - ba[:, 1] * ca[:, 0])
    cross = np.where(np.abs(cross) > 1e-12, cross, np.nan)
    bb, cc = (ba * ba).sum(axis=1), (ca * ca).sum(axis=1)
    ux = (ca[:, 1] * bb - ba[:, 1] * cc) / cross
    uy = (ba[:, 0] * cc - ca[:, 0] * bb) / cross
    return a[:, 0] + ux, a[:, 1] + uy, np.hypot(ux, uy)


def _least_squares(points: Vector) -> Vector:
    """Algebraic circle fit (Kåsa) of (n,2) points: x, y, r."""
    mean = points.mean(axis=0)
    p = points - mean
    A = np.column_stack([2.0 * p, np.ones(len(p))])
    rhs = (p * p).sum(axis=1)
    normal = A.T @ A
    det = np.linalg.det(normal)
    if not np.isfinite(det) or abs(det) < 1e-30:
        return np.full(3, np.nan)
    solution = np.linalg.solve(normal, A.T @ rhs)
    r2 = solution[2] + solution[0] ** 2 + solution[1] ** 2
    return np.array([solution[0] + mean[0], solution[1] + mean[1], np.sqrt(max(r2, 0.0))])
