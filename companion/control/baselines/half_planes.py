"""The velocity nearest to a wanted one among half-planes of velocities, within a speed limit.

Source of the problem and of its relaxation: van den Berg et al., "Reciprocal n-body collision
avoidance", ISRR 2011, sections 5.1 to 5.3. A drone meets so few half-planes that every point at
which the answer can lie is tried, which is exact and needs no linear program.
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from mavlink_bridge.shared.arrays import Vector, lengths, norm

_EXACT = 1e-6  # m/s; a bound broken by less is kept: what rounding does to a corner is less
_PARALLEL = 1e-9  # sine of the angle below which the foot on one of two lines is their corner
_HALVINGS = 24  # of the violation: to 1e-7 of its largest value


class HalfPlanes(NamedTuple):
    """Velocities v (2,) m/s are allowed while normals (m,2), unit, · v >= least (m,) m/s."""

    normals: Vector
    least: Vector

    @classmethod
    def of(cls, each: list[tuple[Vector, float]]) -> Self:
        """Return the half-planes from pairs of a normal (2,) and its bound [m/s]."""
        normals = np.array([normal for normal, _ in each]).reshape(-1, 2)
        return cls(normals, np.array([least for _, least in each], float))

    def and_(self, others: HalfPlanes, violation: float = 0.0) -> HalfPlanes:
        """Return these and the others, the others' bounds lowered by `violation` [m/s]."""
        return HalfPlanes(
            np.vstack([self.normals, others.normals]),
            np.concatenate([self.least, others.least - violation]),
        )


def nearest_velocity(wanted: Vector, fastest: float, kept: HalfPlanes, asked: HalfPlanes) -> Vector:
    """Return the velocity (2,) m/s nearest to `wanted` (2,) that all half-planes allow.

    Where there is none, the half-planes of `asked` are all moved by the least distance that leaves
    one. Those of `kept` are not moved; rest must be in all of them. fastest: m/s.
    """
    found = _nearest(wanted, fastest, kept.and_(asked))
    if found is not None:
        return found
    # At rest no bound of `asked` is broken by more than this, and `kept` allows rest.
    low, high = 0.0, float(asked.least.max(initial=0.0))
    best = _nearest(wanted, fastest, kept.and_(asked, high))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        found = _nearest(wanted, fastest, kept.and_(asked, middle))
        if found is None:
            low = middle
        else:
            best, high = found, middle
    return np.zeros(2) if best is None else best


def _nearest(wanted: Vector, fastest: float, planes: HalfPlanes) -> Vector | None:
    """Return the nearest allowed velocity (2,), or None where there is none."""
    points = _candidates(wanted, fastest, planes)
    allowed = lengths(points) <= fastest + _EXACT
    allowed &= (points @ planes.normals.T >= planes.least - _EXACT).all(axis=1)
    if not allowed.any():
        return None
    points = points[allowed]
    nearest: Vector = points[lengths(points - wanted).argmin()]
    return nearest


def _candidates(wanted: Vector, fastest: float, planes: HalfPlanes) -> Vector:
    """Return all points (k,2) at which the nearest allowed velocity can lie.

    A convex set's point nearest to another one is that one itself, its foot on one of the set's
    borders, or a corner where two borders meet.
    """
    n, b = planes
    on_circle = wanted * (fastest / max(norm(wanted), _EXACT))
    feet = wanted + (b - n @ wanted)[:, None] * n
    # Where a line leaves the circle of the speed limit.
    cut = np.abs(b) <= fastest
    half = np.sqrt(fastest**2 - b[cut] ** 2)[:, None] * np.column_stack([-n[cut, 1], n[cut, 0]])
    middle = b[cut, None] * n[cut]
    # Where two lines meet.
    i, j = np.triu_indices(len(b), 1)
    sine = n[i, 0] * n[j, 1] - n[i, 1] * n[j, 0]
    meet = np.abs(sine) > _PARALLEL
    i, j, sine = i[meet], j[meet], sine[meet]
    x = (b[i] * n[j, 1] - b[j] * n[i, 1]) / sine
    y = (b[j] * n[i, 0] - b[i] * n[j, 0]) / sine
    corners = np.column_stack([x, y])
    return np.vstack([wanted, on_circle, feet, middle + half, middle - half, corners])
