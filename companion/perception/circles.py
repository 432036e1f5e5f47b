"""Circles through noisy outline points, some of which belong to something else.

A ball's outline is a circle in the stereographic plane, anywhere in the picture. An object in
front of the ball replaces an arc by a chord inside the circle; a second ball behind it adds an arc
outside. Both cases are solved by scoring circles through triples of points.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mavlink_bridge.shared.arrays import Vector

SECTORS = 24
Triple = tuple[float, float, float]  # x, y, r


@dataclass(frozen=True)
class Circle:
    """x, y, r in the units of the points; arc: share of the circumference seen, 0…1."""

    x: float
    y: float
    r: float
    arc: float


def fit_circles(x: Vector, y: Vector, tolerance: float, most: int = 4) -> list[Circle]:
    """Return the circles that explain the points x, y (n,), the best supported first.

    tolerance: largest distance of a point from its circle. most: largest number of circles.
    """
    points = np.array([x, y, x * x + y * y, np.ones(len(x))])
    found: list[Circle] = []
    least = max(6.0, 0.12 * len(x))
    while points.shape[1] >= 6 and len(found) < most:
        circle = _best_circle(points, tolerance)
        if circle is None:
            break
        found.append(circle)
        if not len(found) < most:
            break
        points = points[:, _off(points, (circle.x, circle.y, circle.r)) > 2.0 * tolerance]
        if points.shape[1] < least:
            break
    return found


def _off(points: Vector, circle: Triple) -> Vector:
    """Return the signed distance of points (4,n) x, y, x² + y², 1 to a circle; outside: > 0."""
    x, y, r = circle
    squared = np.array([-2.0 * x, -2.0 * y, 1.0, x * x + y * y]) @ points
    result: Vector = np.sqrt(np.maximum(squared, 0.0)) - r
    return result


def _best_circle(points: Vector, tolerance: float) -> Circle | None:
    """Return the circle of a single fit, or else the best of many through triples of points."""
    n = points.shape[1]
    circle, off = _trimmed(points, _least_squares(points), tolerance)
    outside = np.count_nonzero(off > tolerance)
    on = np.abs(off) < tolerance
    count = np.count_nonzero(on)
    if not (count > 0.7 * n and outside < 0.04 * n):
        start = _vote(points[0], points[1], tolerance)
        if start is None:
            return None
        circle, off = _trimmed(points, start, tolerance)
        on = np.abs(off) < tolerance
        count = np.count_nonzero(on)
    if not math.isfinite(circle[2]) or count < 4:
        return None
    x, y = points[:2, on]
    turn = np.arctan2(y - circle[1], x - circle[0]) * (SECTORS / (2 * math.pi))
    seen = np.bincount((turn + SECTORS).astype(int) % SECTORS, minlength=SECTORS)
    # Few points cannot fill all sectors however complete the circle is.
    full = min(float(SECTORS), max(8.0, n * 0.8))
    return Circle(*circle, arc=min(1.0, np.count_nonzero(seen) / full))


def _trimmed(points: Vector, circle: Triple, tolerance: float) -> tuple[Triple, Vector]:
    """Refit to the points near the circle until they no longer change; return it and distances."""
    before = points.shape[1]
    off = _off(points, circle)
    for _ in range(3):
        near = np.abs(off) < tolerance
        count = int(np.count_nonzero(near))
        if count < 4 or count == before:
            break
        before = count
        circle = _least_squares(points[:, near])
        off = _off(points, circle)
    return circle, off


def _vote(x: Vector, y: Vector, tolerance: float) -> Triple | None:
    """Return the circle through three points that most points support; None where there is none."""
    n = len(x)
    order = np.argsort(np.arctan2(y - y.mean(), x - x.mean()), kind="stable")
    # Triples are spread around the outline at several strides: one of them lies on one ball only.
    starts = np.arange(0, n, max(1, n // 24))
    strides = np.array(sorted({max(1, n // k) for k in (3, 4, 5, 7, 10)}))
    first = np.tile(starts, len(strides))
    step = np.repeat(strides, len(starts))
    a, b, c = order[first], order[(first + step) % n], order[(first + 2 * step) % n]
    bx, by, cx, cy = x[b] - x[a], y[b] - y[a], x[c] - x[a], y[c] - y[a]
    cross = 2.0 * (bx * cy - by * cx)
    cross = np.where(np.abs(cross) > 1e-12, cross, np.nan)
    bb, cc = bx * bx + by * by, cx * cx + cy * cy
    ux, uy = (cy * bb - by * cc) / cross, (bx * cc - cx * bb) / cross
    mx, my, r = x[a] + ux, y[a] + uy, np.sqrt(ux * ux + uy * uy)
    extent = max(x.max() - x.min(), y.max() - y.min())
    good = np.isfinite(r) & (r < 1.2 * extent) & (r > 0.1 * extent)
    if not good.any():
        return None
    mx, my, r = mx[good], my[good], r[good]
    thin = slice(None, None, max(1, n // 80))
    dx, dy = x[thin] - mx[:, None], y[thin] - my[:, None]
    off = np.sqrt(dx * dx + dy * dy) - r[:, None]
    # A ball hides nothing outside itself, so points outside count against it; with a second ball
    # in the blob some must lie outside.
    support = (np.abs(off) < tolerance).sum(axis=1) - 0.5 * (off > tolerance).sum(axis=1)
    best = int(np.argmax(support))
    return float(mx[best]), float(my[best]), float(r[best])


def _least_squares(points: Vector) -> Triple:
    """Return the algebraic circle fit (Kåsa, 1976) to points (4,n) x, y, x² + y², 1.

    NaN where they lie on a line.
    """
    (sxx, sxy, sxz, sx), (_, syy, syz, sy), (_, _, _, sz), (_, _, _, n) = (
        points @ points.T
    ).tolist()
    mx, my, mz = sx / n, sy / n, sz / n
    # About the mean.
    sxx, syy, sxy = sxx - sx * mx, syy - sy * my, sxy - sx * my
    det = sxx * syy - sxy * sxy
    if not det > 1e-9 * (sxx + syy) ** 2:
        return math.nan, math.nan, math.nan
    sxz, syz = sxz - sx * mz, syz - sy * mz
    cx, cy = 0.5 * (syy * sxz - sxy * syz) / det, 0.5 * (sxx * syz - sxy * sxz) / det
    return cx, cy, math.sqrt(max(mz - 2 * (cx * mx + cy * my) + cx * cx + cy * cy, 0.0))
