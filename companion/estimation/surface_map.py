"""Surface map: walls, floors and ceilings from depth images, remembered for a while.

Surfaces are kept as small cubes (voxels) in the drone's own ENU frame. A cube that left the view
stays for some seconds; a cube that the view shows to be free goes at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from companion.perception.camera import Camera
from companion.types import Ranges
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.shared.settings import StrictModel
from mavlink_bridge.wire.messages import VehicleState

_OFFSET = 1 << 20  # cubes; makes indices positive
_DEEPER = 0.3  # m behind a cube that the view must show before the cube counts as gone


class SurfaceConfig(StrictModel):
    """Numbers of the surface map and of the corridor cut from it."""

    cube: float = Field(0.2, gt=0.02, description="Edge [m] of a cube of the map.")
    memory: float = Field(4.0, ge=0, description="Time [s] that a cube out of view is kept.")
    range: float = Field(5.0, gt=0, description="Cubes farther than this [m] are forgotten.")
    hits_to_count: int = Field(2, ge=1, description="Looks before a cube counts.")
    stretch: float = Field(
        2.5,
        ge=1,
        description="Points ahead count as this many times nearer: the free room is as many times "
        "longer than wide.",
    )
    rough: float = Field(0.1, ge=0, description="A plane may cut off this much [m] of a surface.")
    planes: int = Field(4, ge=0, le=32, description="Most half-spaces of the corridor.")
    trunk_margin: float = Field(
        0.35, ge=0, description="Points this near [m] to a trunk belong to the trunk."
    )


class SurfaceMap:
    """Remembers surface cubes in the drone's own ENU frame."""

    def __init__(self, camera: Camera, config: SurfaceConfig) -> None:
        self._camera = camera
        self._config = config
        self._lens: Camera | None = None
        self._keys: NDArray[np.int64] = np.zeros(0, np.int64)
        self._points: Vector = np.zeros((0, 3))
        self._seen: Vector = np.zeros(0)
        self._hits: NDArray[np.int64] = np.zeros(0, np.int64)

    def update(self, ranges: Ranges, own: VehicleState) -> None:
        """Take in ranges (h,w) [m; inf: free, NaN: unknown] of one frame seen in state `own`."""
        if self._lens is None or (self._lens.height, self._lens.width) != ranges.shape:
            self._lens = self._camera.scaled(ranges.shape[1], ranges.shape[0])
        r_wc = rotation_matrix(own.q_wb) @ rotation_matrix(self._camera.mount)
        wide = ranges.astype(np.float64)
        self._forget(wide, own, r_wc, self._lens)
        met = np.flatnonzero(wide < self._config.range)  # NaN is not
        rays, lengths = self._lens.directions.reshape(-1, 3)[met], wide.ravel()[met, None]
        self._add(own.p + rays * lengths @ r_wc.T, own.time)

    def points(self, cylinders: Vector) -> Vector:
        """Return confirmed surface points (n,3) m that belong to no trunk of cylinders (k,3)."""
        sure = self._points[self._hits >= self._config.hits_to_count]
        if not len(cylinders) or not len(sure):
            return sure
        gap = np.linalg.norm(sure[:, None, :2] - cylinders[None, :, :2], axis=-1)
        result: Vector = sure[(gap > cylinders[:, 2] + self._config.trunk_margin).all(axis=1)]
        return result

    def _forget(self, ranges: Vector, own: VehicleState, r_wc: Vector, lens: Camera) -> None:
        """Drop the cubes that are old, far, or shown by the ranges to be gone."""
        if not len(self._keys):
            return
        offsets = self._points - own.p
        distance = np.linalg.norm(offsets, axis=1)
        pixels = lens.project(offsets @ r_wc)
        inside = (pixels > 0.0) & (pixels < np.array([lens.width - 1, lens.height - 1]))
        shown = np.full(len(offsets), np.nan)
        u, v = np.round(pixels[inside.all(axis=1)]).astype(int).T
        shown[inside.all(axis=1)] = _nearest_around(ranges)[v, u]
        gone = shown > distance + _DEEPER
        old = own.time - self._seen > self._config.memory
        self._keep(~(gone | old | (distance > self._config.range)))

    def _add(self, points: Vector, time: float) -> None:
        """Add surface points (n,3) m of one frame, which is one look at each of their cubes."""
        cells = np.floor(points / self._config.cube).astype(np.int64) + _OFFSET
        keys = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
        keys, which, count = np.unique(keys, return_inverse=True, return_counts=True)
        sums = [np.bincount(which, axis, len(keys)) for axis in points.T]
        points = np.stack(sums, axis=1) / count[:, None]
        known = np.isin(self._keys, keys, assume_unique=True)
        self._seen[known] = time
        self._hits[known] += 1
        new = ~np.isin(keys, self._keys, assume_unique=True)
        self._keys = np.concatenate([self._keys, keys[new]])
        self._points = np.concatenate([self._points, points[new]])
        self._seen = np.concatenate([self._seen, np.full(new.sum(), time)])
        self._hits = np.concatenate([self._hits, np.ones(new.sum(), np.int64)])

    def _keep(self, keep: NDArray[np.bool_]) -> None:
        """Drop the cubes that are not in `keep` (n,)."""
        self._keys, self._points = self._keys[keep], self._points[keep]
        self._seen, self._hits = self._seen[keep], self._hits[keep]


def _nearest_around(ranges: Vector) -> Vector:
    """Return the least of each range (h,w) and its eight neighbours; NaN where one is unknown."""
    padded = np.pad(ranges, 1, mode="edge")
    h, w = ranges.shape
    shifted = [padded[i : i + h, j : j + w] for i in range(3) for j in range(3)]
    least: Vector = np.minimum.reduce(shifted)
    return least
