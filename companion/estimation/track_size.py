"""Tracks of neighbours whose size is unknown: one more state, and everything stays linear.

A detector tells the range by an assumed size. A neighbour of s times that size looks s times
nearer: it is seen at own + κ (p − own), with κ = 1/s. In the states κp, κv and κ, both that
measurement and constant velocity are linear, so that nothing is learnt of the size but what own
motion tells. Own acceleration tells it; while neither drone accelerates, only the neighbour's
likely speed does.

Source: Ning et al., "A bearing-angle approach for unknown target motion analysis", 2024, arXiv
2401.17117; the states here are linear where those are not.
"""

from __future__ import annotations

import numpy as np

from mavlink_bridge.shared.arrays import Vector

STATES = 7  # κp (3), κv (3), κ
_DRIFT = 0.02  # 1/√s, of κ over κ: a drone is not equally wide from all sides
_SMALLEST = 0.2  # of κ: five times the assumed size


def birth(
    z: Vector, r: Vector, here: Vector, velocity: float, size: float
) -> tuple[Vector, Vector]:
    """Return mean (7,) and covariance (7,7) of a track at rest, seen at z (3,) from here (3,).

    r: (3,3) of z. velocity: m/s and size: 1 σ of the speed and of κ.
    """
    covariance = np.zeros((STATES, STATES))
    covariance[:3, :3] = r
    covariance[3:6, 3:6] = velocity**2 * np.eye(3)
    # It was seen at z; how far it is hangs on κ: κp = z − (1 − κ) here.
    column = np.concatenate([here, np.zeros(3), [1.0]])
    covariance += size**2 * np.outer(column, column)
    return np.concatenate([z, np.zeros(3), [1.0]]), covariance


def grow(
    mean: Vector, covariance: Vector, dt: float, keep: Vector, to: Vector, a: Vector
) -> Vector:
    """Return the covariance (n,7,7) after dt [s]; mean (n,7): before it.

    keep: (n,) share of the velocity's difference from `to` (n,3) that is left. a: (n,) m/s², 1 σ of
    the acceleration.
    """
    step = np.tile(np.eye(STATES), (len(mean), 1, 1))
    step[:, :3, 3:6] = dt * np.eye(3)
    step[:, 3:6, 3:6] = keep[:, None, None] * np.eye(3)
    step[:, 3:6, 6] = (1.0 - keep[:, None]) * to
    jolt = np.zeros((STATES, 3))
    jolt[:3], jolt[3:6] = dt * dt / 2 * np.eye(3), dt * np.eye(3)
    noise = (a * mean[:, 6])[:, None, None] ** 2 * (jolt @ jolt.T)
    # κ drifts, and the place stays: κp and κv drift with it.
    drift = _DRIFT**2 * dt * mean[:, :, None] * mean[:, None]
    grown: Vector = step @ covariance @ step.transpose(0, 2, 1) + noise + drift
    return grown


def seen_from(mean: Vector, here: Vector) -> tuple[Vector, Vector]:
    """Return where detections from here (3,) show the tracks (n,3), and the slope (3,7) of that."""
    slope = np.zeros((3, STATES))
    slope[:, :3], slope[:, 6] = np.eye(3), -here
    return mean[:, :3] + (1.0 - mean[:, 6:]) * here, slope


def bounded(mean: Vector) -> Vector:
    """Return the means (n,7) with κ above its least value, at the same places and velocities."""
    kappa = np.maximum(mean[:, 6:], _SMALLEST)
    result: Vector = mean * (kappa / mean[:, 6:])
    return np.where(mean[:, 6:] > 0, result, np.concatenate([mean[:, :6], kappa], axis=1))


def in_world(mean: Vector, covariance: Vector) -> tuple[Vector, Vector]:
    """Return p, v (n,6) [m, m/s] and their covariance (n,6,6)."""
    kappa = mean[:, 6:]
    state = mean[:, :6] / kappa
    to_world = np.zeros((len(mean), 6, STATES))
    to_world[:, :, :6] = np.eye(6) / kappa[..., None]
    to_world[:, :, 6] = -state / kappa
    return state, to_world @ covariance @ to_world.transpose(0, 2, 1)


def sigma_of_known_size(mean: Vector, covariance: Vector) -> Vector:
    """Return the σ (n,) of the place [m] that is left once the size is known."""
    column = covariance[:, :3, 6]
    left = covariance[:, :3, :3] - (
        column[:, :, None] * column[:, None] / covariance[:, 6, 6][:, None, None]
    )
    sigma: Vector = np.sqrt(np.trace(left, axis1=1, axis2=2)) / mean[:, 6]
    return sigma
