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
    found: list[Circle] = []
    least = max(6.0, 0.12 * len(x))
    while len(x) >= 6 and len(found) < most:
        circle = _best_circle(x, y, tolerance)
        if circle is None:
            break
        found.append(circle)
        outside = _off(x, y, (circle.x, circle.y, circle.r)) > 2.0 * tolerance
        x, y = x[outside], y[outside]
        if len(x) < least:
            break
    return found


def _off(x: Vector, y: Vector, circle: Triple) -> Vector:
    """Return the signed distance of points to a circle, positive outside."""
    dx, dy = x - circle[0], y - circle[1]
    result: Vector = np.sqrt(dx * dx + dy * dy) - circle[2]
    return result


def _best_circle(x: Vector, y: Vector, tolerance: float) -> Circle | None:
    """Return the circle of a single fit, or else the best of many through triples of points."""
    n = len(x)
    circle, off = _trimmed(x, y, _least_squares(x, y), tolerance)
    outside = np.count_nonzero(off > tolerance)
    on = np.abs(off) < tolerance
    count = np.count_nonzero(on)
    if not (count > 0.7 * n and outside < 0.04 * n):
        start = _vote(x, y, tolerance)
        if start is None:
            return None
        circle, off = _trimmed(x, y, start, tolerance)
        on = np.abs(off) < tolerance
        count = np.count_nonzero(on)
    if not math.isfinite(circle[2]) or count < 4:
        return None
    turn = np.arctan2(y[on] - circle[1], x[on] - circle[0]) * (SECTORS / (2 * math.pi))
    seen = np.bincount((turn + SECTORS).astype(int) % SECTORS, minlength=SECTORS)
    # Few points cannot fill all sectors however complete the circle is.
    full = min(float(SECTORS), max(8.0, n * 0.8))
    return Circle(*circle, arc=min(1.0, np.count_nonzero(seen) / full))


def _trimmed(x: Vector, y: Vector, circle: Triple, tolerance: float) -> tuple[Triple, Vector]:
    """Refit to the points near the circle until they no longer change; return it and distances."""
    before = len(x)
    off = _off(x, y, circle)
    for _ in range(3):
        near = np.abs(off) < tolerance
        count = int(np.count_nonzero(near))
        if count < 4 or count == before:
            break
        before = count
        circle = _least_squares(x[near], y[near])
        off = _off(x, y, circle)
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


def _least_squares(x: Vector, y: Vector) -> Triple:
    """Return the algebraic circle fit (Kåsa, 1976); NaN where the points lie on a line."""
    n = len(x)
    mx, my = float(x.sum()) / n, float(y.sum()) / n
    u, v = x - mx, y - my
    uu, vv = u * u, v * v
    square = uu + vv
    sxx, syy, sxy = float(uu.sum()), float(vv.sum()), float(u @ v)
    sxz, syz = float(u @ square), float(v @ square)
    det = sxx * syy - sxy * sxy
    if not det > 1e-9 * (sxx + syy) ** 2:
        return math.nan, math.nan, math.nan
    cx, cy = 0.5 * (syy * sxz - sxy * syz) / det, 0.5 * (sxx * syz - sxy * sxz) / det
    return cx + mx, cy + my, math.sqrt((sxx + syy) / n + cx * cx + cy * cy)
