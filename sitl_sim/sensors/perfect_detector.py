"""Reports of a perfect detector: everything that is visible by eq. (6), and nothing else.

For studies with `neighbours: truth` or `obstacles: map`. Rows have the layout of the frame
channel: direction (3) in the camera frame, distance, and two more numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import rotation_matrix
from sitl_sim.sensors.fisheye import R_BC, Lens
from sitl_sim.worlds.world import Occluders

_WALL_COLUMNS = 80  # of the coarse range image: 2° apart


def camera_rays(q: Vector, offsets: Vector) -> Vector:
    """Return unit directions (...,n,3) in the camera frame of world offsets (...,n,3).

    q: (...,4) unit, body → world: attitudes of the drones that carry the cameras.
    """
    distance = np.maximum(np.linalg.norm(offsets, axis=-1, keepdims=True), 1e-9)
    matrices = np.array([rotation_matrix(one) for one in q.reshape(-1, 4)])
    r = matrices.reshape(*q.shape[:-1], 3, 3)
    rays: Vector = (offsets / distance) @ r @ R_BC
    return rays


def seen(rays_c: Vector, half_view: float, half_height: float) -> NDArray[np.bool_]:
    """Return whether unit directions (...,3), camera frame, are inside an equidistant image."""
    x, y, z = np.moveaxis(rays_c, -1, 0)
    theta = np.arccos(np.clip(z, -1.0, 1.0))
    rho = np.maximum(np.hypot(x, y), 1e-9)
    inside: NDArray[np.bool_] = (theta * np.abs(x) <= half_view * rho) & (
        theta * np.abs(y) <= half_height * rho
    )
    return inside


def neighbours(
    p: Vector,
    q: Vector,
    others: Vector,
    occluders: Occluders,
    fov: tuple[float, float],
    range_max: float,
) -> Vector:
    """Return (m,6) direction, range, σ bearing, σ range of the drones `others` (k,3) in view.

    fov: half width and half height of the view [rad].
    """
    d = others - p
    distance = np.maximum(np.linalg.norm(d, axis=1), 1e-9)
    rays = camera_rays(q, d)
    visible = seen(rays, *fov) & (distance <= range_max) & occluders.free(p, others)
    n = int(visible.sum())
    return np.column_stack([rays[visible], distance[visible], np.full(n, 0.005), np.full(n, 0.03)])


def trunks(
    p: Vector, q: Vector, occluders: Occluders, fov: tuple[float, float], range_max: float
) -> Vector:
    """Return (m,6) direction to the axis, horizontal distance to it, radius, σ of trunks in view.

    A trunk is in view when its axis or one of its edges is inside the picture and not hidden.
    """
    d = occluders.cylinders[:, :2] - p[:2]
    radius, distance = occluders.cylinders[:, 2], np.hypot(d[:, 0], d[:, 1])
    near = np.flatnonzero((distance - radius <= range_max) & (distance > radius))
    d, radius, distance = d[near], radius[near], distance[near]
    side = np.column_stack([-d[:, 1], d[:, 0]]) * (0.9 * radius / distance)[:, None]
    offsets = np.zeros((len(near), 3, 3))
    offsets[..., :2] = np.stack([d, d + side, d - side], axis=1)
    flat = offsets.reshape(-1, 3)
    rays = camera_rays(q, flat)
    visible = seen(rays, *fov) & occluders.free(p, p + flat, np.repeat(near, 3))
    rows = [rays[::3], distance[:, None], radius[:, None], np.full((len(near), 1), 0.03)]
    table: Vector = np.hstack(rows)[visible.reshape(-1, 3).any(axis=1)]
    return table


class WallRanges:
    """Coarse depth images of the boxes of a world by a perfect sensor; eq. (6)."""

    def __init__(self, occluders: Occluders, width: int, height: int, fov_deg: float) -> None:
        """Sample the view of a camera of this image size [px]."""
        rows = round(_WALL_COLUMNS * height / width)
        self._rays = Lens(_WALL_COLUMNS, rows, fov_deg).rays.astype(float)
        self._boxes = occluders.boxes
        self._trunks = Occluders({})
        self._trunks.cylinders = occluders.cylinders

    def __call__(self, p: Vector, q: Vector, range_max: float) -> NDArray[np.float32]:
        """Return distances (h,w) m along rays to the nearest box; inf: none, NaN: behind trunks."""
        shape = self._rays.shape[1:]
        rays = self._rays.reshape(3, -1).T @ R_BC.T @ rotation_matrix(q).T
        nearest = np.full(len(rays), np.inf)
        for low, high in self._boxes:
            with np.errstate(divide="ignore", invalid="ignore"):
                a, b = (low - p) / rays, (high - p) / rays
            enter = np.nanmax(np.minimum(a, b), axis=1)
            leave = np.nanmin(np.maximum(a, b), axis=1)
            met = (enter < leave) & (enter > 0.0) & (enter < range_max)
            nearest = np.where(met, np.minimum(nearest, enter), nearest)
        ends = p + np.minimum(nearest, range_max)[:, None] * rays
        if len(self._trunks.cylinders):
            nearest[~self._trunks.free(p, ends)] = np.nan
        return nearest.reshape(shape).astype(np.float32)
