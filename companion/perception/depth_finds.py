"""Finds of neighbours, checked against the depth image of the same view.

A detector tells a neighbour's range by its size, to a fifth of it, and takes openings and shadows
for drones. A depth image shows what stands out there from its surroundings, and how far it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from companion.perception.camera import Camera
from companion.types import Detection
from mavlink_bridge.shared.arrays import norm

_BODY = 0.2  # m, about the radius of a drone's body
_CORE = 0.9  # of it: where some rays meet the body
_RING = (1.5, 2.4)  # of it: what is round the body
_BLUR = 0.6  # pixels by which a place may be off
_FEWEST = 3, 8  # rays of core and ring that tell something
# Share of the core that shows the body, as between its arms shows what is behind; and of the ring
# that may show other drones.
_SHOWN, _CROSSED = 0.03, 0.12
_STANDS_OUT = 0.25  # m, and a tenth of the distance, from its surroundings
_TOLD = 0.5  # share of the core whose depth must be known
_LIVE = 0.01  # share of its pixels that show something where a depth camera works
_SAME = 0.3  # m apart at which two finds are of one drone
_SIGMA = 0.05  # m, of a range so told; 2 % of it is added
_GATE = 3.0  # sigmas of the detector's range within which it is the thing that was found


class DepthCheck:
    """Checks finds by the depth images of one camera."""

    def __init__(self, camera: Camera, farthest: float) -> None:
        """farthest: m, beyond which depth is not used."""
        self._camera = camera
        self._farthest = farthest
        self._rays: NDArray[np.float32] = np.zeros((0, 0, 3), np.float32)
        self._blur = 0.0  # rad

    def checked(self, drones: Sequence[Detection], depth: NDArray[np.float32]) -> list[Detection]:
        """Return the finds that depth (h,w) m does not deny, with the ranges that it tells.

        depth: as in `DepthReader.read`. A find too far away, or where the depth camera cannot tell,
        stays as it is. One that shows hardly a surface tells nothing: it would show the ground.
        """
        if np.isfinite(depth).mean() < _LIVE:
            return list(drones)
        if self._rays.shape[:2] != depth.shape:
            camera = self._camera.scaled(depth.shape[1], depth.shape[0])
            self._rays, self._blur = camera.directions.astype(np.float32), _BLUR / camera.fx
        kept: list[Detection] = []
        for drone in sorted(drones, key=lambda d: d.sigma_range / d.range):
            told = self._check(drone, depth)
            if told is not None and not any(_apart(told, other) < _SAME for other in kept):
                kept.append(told)
        return sorted(kept, key=lambda d: d.range)

    def _check(self, drone: Detection, depth: NDArray[np.float32]) -> Detection | None:
        if drone.range + 2.0 * drone.sigma_range > self._farthest:
            return drone
        size, blur = math.atan2(_BODY, drone.range), self._blur
        cosine = self._rays @ drone.direction.astype(np.float32)
        core = depth[cosine > math.cos(_CORE * size + blur)]
        inner, outer = (math.cos(min(r * size + blur, math.pi)) for r in _RING)
        ring = depth[(cosine < inner) & (cosine > outer)]
        told = core > 0.0  # NaN, too, is unknown: stereo has holes round what is thin
        if told.sum() < max(_FEWEST[0], _TOLD * len(core)):
            return drone
        core, ring = core[told], ring[ring > 0.0]
        if len(ring) < _FEWEST[1]:
            return drone
        nearest, behind = _lower(core, _SHOWN), _lower(ring, _CROSSED)
        if behind < nearest + _STANDS_OUT + 0.1 * nearest:
            return None
        if abs(nearest - drone.range) > _GATE * drone.sigma_range + 0.1:
            return None
        return replace(drone, range=nearest, sigma_range=_SIGMA + 0.02 * nearest)


def _lower(values: NDArray[np.float32], share: float) -> float:
    """Return the value that this share of values (n,) is below."""
    k = int(share * (len(values) - 1))
    return float(np.partition(values, k)[k])


def _apart(one: Detection, other: Detection) -> float:
    """Return the distance [m] of two finds."""
    return norm(one.direction * one.range - other.direction * other.range)
