"""Circles through noisy outline points, some of which belong to something else.

A ball's outline is a circle in the stereographic plane, anywhere in the picture. An object in
front of the ball replaces an arc by a chord inside the circle; a second ball behind it adds an arc
outside. Both cases are solved by scoring circles through triples of points, and pairs of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector

SECTORS = 24
_SECOND = 0.1  # of the points: what a second circle must explain more than the best one alone
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
    points = np.empty((4, len(x)))
    points[0], points[1], points[2], points[3] = x, y, x * x + y * y, 1.0
    found: list[Circle] = []
    least = max(6.0, 0.12 * len(x))
    while points.shape[1] >= 6 and len(found) < most:
        circle = _best_circle(points, tolerance)
        if circle is None:
            break
        found.append(circle)
        if not len(found) < most:
            break
        others = _off(points, (circle.x, circle.y, circle.r)) > 2.0 * tolerance
        if np.count_nonzero(others) < least:
            break
        points = points[:, others]
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
    circle, off = _trimmed(points, _least_squares(points @ points.T), tolerance)
    on = np.abs(off) < tolerance
    count = np.count_nonzero(on)
    if not (count > 0.7 * n and np.count_nonzero(off > tolerance) < 0.04 * n):
        start = _vote(points, tolerance)
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
        circle = _least_squares((points * near) @ points.T)
        off = _off(points, circle)
    return circle, off


def _vote(points: Vector, tolerance: float) -> Triple | None:
    """Return the circle through three of the points (4,n) that most of them support.

    None where there is none.
    """
    x, y = points[:2]
    n = len(x)
    order = np.arctan2(y - y.sum() / n, x - x.sum() / n).argsort(kind="stable")
    # The plane is that of complex numbers: the circle through 0, b and c is about `centre`.
    z = x + 1j * y
    a, b, c = z.take(order).take(_triples(n))
    b, c = b - a, c - a
    cross = 2.0 * (b.real * c.imag - b.imag * c.real)
    cross[np.abs(cross) < 1e-12] = np.inf  # on a line: a circle of no radius
    centre = (c * _squared(b) - b * _squared(c)) * (-1j * (1.0 / cross))
    r = np.abs(centre)
    extent = max(x.max() - x.min(), y.max() - y.min())
    good = ((r < 1.2 * extent) & (r > 0.1 * extent)).nonzero()[0]
    if not len(good):
        return None
    centre, r = (centre + a).take(good), r.take(good)
    # Squared distances to all centres (n,k) in one product; single precision is enough to vote.
    about = np.array([-2.0 * centre.real, -2.0 * centre.imag, np.ones(len(r)), _squared(centre)])
    few = points[:, :: max(1, n // 80)]
    squared = few.T.astype(np.float32) @ about.astype(np.float32)
    outer, inner = np.square([r + tolerance, np.maximum(r - tolerance, 0.0)]).astype(np.float32)
    best = _best_supported(squared < outer, squared < inner)
    return float(centre[best].real), float(centre[best].imag), float(r[best])


def _best_supported(within: NDArray[np.bool_], inside: NDArray[np.bool_]) -> int:
    """Return the circle that most of the points support, alone or as one of two balls.

    within, inside: (n,k) whether a point is not outside a circle, and whether it is well inside.
    """
    on = (within & ~inside).astype(np.float32)
    outside = (~within).astype(np.float32)
    count = on.sum(axis=0)
    # Round two balls side by side there is a circle that touches more points than either ball's
    # own; but the two together leave fewer. A ball hides nothing outside itself, so points outside
    # all circles count against them.
    both = count[:, None] + count - on.T @ on - 0.5 * (outside.T @ outside)
    alone = both.diagonal()
    best = int(np.argmax(alone))
    pair = np.unravel_index(int(np.argmax(both)), both.shape)
    if both[pair] > alone[best] + _SECOND * len(on):
        return int(max(pair, key=lambda one: float(alone[one])))
    return best


@lru_cache(maxsize=256)
def _triples(n: int) -> NDArray[np.intp]:
    """Return triples (3,k) of n points in their order around an outline.

    They are spread around it at several strides: one of them lies on one ball only.
    """
    starts = np.arange(0, n, max(1, n // 24))
    strides = np.array(sorted({max(1, n // k) for k in (3, 4, 5, 7, 10)}))
    first, step = np.tile(starts, len(strides)), np.repeat(strides, len(starts))
    return np.array([first, (first + step) % n, (first + 2 * step) % n])


def _squared(z: NDArray[np.complex128]) -> Vector:
    """Return the squared lengths of complex numbers."""
    result: Vector = z.real * z.real + z.imag * z.imag
    return result


def _least_squares(sums: Vector) -> Triple:
    """Return the algebraic circle fit (Kåsa, 1976); NaN where the points lie on a line.

    sums: (4,4) of the products of x, y, x² + y², 1 over the points.
    """
    (sxx, sxy, sxz, sx), (_, syy, syz, sy), (_, _, _, sz), (_, _, _, n) = sums.tolist()
    mx, my, mz = sx / n, sy / n, sz / n
    # About the mean.
    sxx, syy, sxy = sxx - sx * mx, syy - sy * my, sxy - sx * my
    det = sxx * syy - sxy * sxy
    if not det > 1e-9 * (sxx + syy) ** 2:
        return math.nan, math.nan, math.nan
    sxz, syz = sxz - sx * mz, syz - sy * mz
    cx, cy = 0.5 * (syy * sxz - sxy * syz) / det, 0.5 * (sxx * syz - sxy * sxz) / det
    return cx, cy, math.sqrt(max(mz - 2 * (cx * mx + cy * my) + cx * cx + cy * cy, 0.0))
