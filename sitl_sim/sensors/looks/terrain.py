"""Uneven ground under a camera: its profile in each direction, and rays against it."""

# ruff: noqa: ANN001, ANN201 - numba infers the types of a kernel's arguments
from __future__ import annotations

import math

import numpy as np
from numba import njit

from sitl_sim.sensors.fisheye import Float32, Float64
from sitl_sim.sensors.tables import diamond

DIRECTIONS, STEPS = 1024, 120
FIRST, LAST = 0.15, 90.0  # m, of the profile
_ZERO, _ONE, _TINY, _FAR = np.float32(0), np.float32(1), np.float32(1e-9), np.float32(np.inf)
_SKY, _GROUND = np.int32(-1), np.int32(-2)


@njit(nogil=True, cache=True, error_model="numpy")
def profile_of(p: Float64, gx: Float64, gy: Float64, gz: Float64, out: Float32):  # type: ignore[no-untyped-def]
    """Fill out (3,DIRECTIONS,STEPS): distance, height [m], largest slope from the camera so far.

    gx (K,), gy (L,), gz (L,K): grid of heights [m, world], evenly spaced, bilinear between.
    """
    step_x, step_y = gx[1] - gx[0], gy[1] - gy[0]
    growth = (LAST / FIRST) ** (1.0 / (STEPS - 2))
    for d in range(DIRECTIONS):
        a = (d + 0.5) * 4 / DIRECTIONS - 2
        ux = 1 - abs(a)
        uy = a if abs(a) <= 1 else math.copysign(2 - abs(a), a)
        length = math.sqrt(ux * ux + uy * uy)
        ux, uy = ux / length, uy / length
        highest = -np.inf
        r = 0.02
        for k in range(STEPS):
            fx = min(max((p[0] + ux * r - gx[0]) / step_x, 0.0), gx.shape[0] - 1.001)
            fy = min(max((p[1] + uy * r - gy[0]) / step_y, 0.0), gy.shape[0] - 1.001)
            i, j = int(fx), int(fy)
            fx -= i
            fy -= j
            low = gz[j, i] * (1 - fx) + gz[j, i + 1] * fx
            high = gz[j + 1, i] * (1 - fx) + gz[j + 1, i + 1] * fx
            z = low * (1 - fy) + high * fy
            highest = max(highest, (z - p[2]) / r)
            out[0, d, k], out[1, d, k], out[2, d, k] = r, z, highest
            r = FIRST if k == 0 else r * growth


@njit(nogil=True, cache=True, error_model="numpy")
def meet_terrain(profile, pz, dx, dy, dz, best, who):  # type: ignore[no-untyped-def]
    """Meet the ground: the first step of the profile that rises above the ray, interpolated."""
    for i in range(best.shape[0]):
        best[i], who[i] = _FAR, _SKY
        flat = math.sqrt(dx[i] * dx[i] + dy[i] * dy[i]) + _TINY
        slope = dz[i] / flat
        d = min(np.int32((diamond(dx[i], dy[i]) + 2) * (DIRECTIONS / 4)), DIRECTIONS - 1)
        rises = profile[2, d]
        if slope > rises[STEPS - 1]:
            continue
        low, high = 0, STEPS - 1
        while low < high:
            middle = (low + high) >> 1
            if rises[middle] >= slope:
                high = middle
            else:
                low = middle + 1
        r1, z1 = profile[0, d, low], profile[1, d, low]
        r = r1
        if low > 0:
            r0, z0 = profile[0, d, low - 1], profile[1, d, low - 1]
            m = (z1 - z0) / (r1 - r0)
            r = min(max((z0 - m * r0 - pz) / (slope - m - _TINY), r0), r1)
        elif slope < _ZERO:
            r = min((z1 - pz) / slope, r1)
        best[i] = r * math.sqrt(_ONE + slope * slope)
        who[i] = _GROUND
