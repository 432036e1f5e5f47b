"""Tables of the static scene for one camera pose, built once per picture for the pixel kernels.

A vertical cylinder covers an interval of azimuths, and in each azimuth an interval of slopes
(rise over horizontal run). So once per frame every trunk is written into a table over azimuth
bins: the nearest surface, its texture coordinate and colour; a taller trunk behind a shorter one
becomes a second layer. Azimuth and elevation are "diamond" angles, y / (|x| + |y|): monotonic in
the true angle and free of trigonometry.
"""

# ruff: noqa: ANN001, ANN201 - numba infers the types of a kernel's arguments
from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sitl_sim.sensors.fisheye import Float32, Float64
from sitl_sim.sensors.textures import LEVELS, TILE

BINS = 4096  # azimuth bins: 0.06°–0.11° each, a quarter of a pixel at 640 px
LAYERS = 4
# Fields of the azimuth table.
S_TOP, S_CAP, T_IN, U, LEVEL, B, G, R, FOG_B, FOG_G, FOG_R, HEIGHT = range(12)
FIELDS = 12
EBINS = 512  # elevation bins of the ground table, horizon … nadir

GROUND_TEXELS = np.float32(110.0)  # texels per metre
BARK_TEXELS = np.float32(240.0)
FOG_RANGE = 70.0  # m, distance of 1/e contrast
ONE, TINY, ZERO = np.float32(1), np.float32(1e-9), np.float32(0)
FAR = np.float32(np.inf)

_OFFSETS = np.array([sum((TILE >> i) ** 2 for i in range(l)) for l in range(LEVELS)], np.int32)
_LOG_TILE, _WRAP = np.int32(math.log2(TILE)), np.int32(TILE - 1)
QUARTER = np.float32(BINS / 4)


@njit(inline="always", error_model="numpy")
def diamond(x, y):  # type: ignore[no-untyped-def]
    """Return the diamond angle of (x, y) in [−2, 2]; it grows with atan2(y, x)."""
    a = y / (abs(x) + abs(y) + TINY)
    if x < ZERO:
        return (np.float32(2) if y >= ZERO else np.float32(-2)) - a
    return a


@njit(inline="always", error_model="numpy")
def mip(footprint):  # type: ignore[no-untyped-def]
    """Return the mip level for a pixel footprint in finest texels."""
    level = np.int32(0)
    while footprint > 1.5 and level < LEVELS - 1:
        footprint *= 0.5
        level += np.int32(1)
    return level


@njit(inline="always", error_model="numpy")
def texel(u, v, level):  # type: ignore[no-untyped-def]
    """Return the index into a mip pyramid for finest-level int32 coordinates (wrapped)."""
    x = (u & _WRAP) >> level
    y = (v & _WRAP) >> level
    return np.uintp(_OFFSETS[np.uintp(level)] + (y << (_LOG_TILE - level)) + x)


@njit(nogil=True, cache=True, error_model="numpy")
def trunk_table(  # type: ignore[no-untyped-def]
    p: Float64,
    cylinders: Float64,
    tint: Float64,
    bins: Float64,
    sun: Float64,
    haze: Float32,
    pixel_angle: float,
    table: Float32,
    count: NDArray[np.int32],
):
    """Fill the azimuth table for the camera at p.

    cylinders: (n,4) x, y, radius, height [m, world]. tint: (n,4) BGR gain, texture offset.
    bins: (BINS,2) unit direction of each bin's middle. sun: (3,) unit, towards it.
    table: (LAYERS, BINS, FIELDS). count: (BINS,) layers in use.
    """
    count[:] = 0
    n = cylinders.shape[0]
    power = np.empty(n)
    for i in range(n):
        dx, dy = cylinders[i, 0] - p[0], cylinders[i, 1] - p[1]
        power[i] = dx * dx + dy * dy - cylinders[i, 2] ** 2
    # Disjoint circles occlude each other in the order of their power distance, on every ray.
    for i in np.argsort(power, kind="mergesort"):
        radius, height = cylinders[i, 2], cylinders[i, 3]
        cx, cy = cylinders[i, 0] - p[0], cylinders[i, 1] - p[1]
        distance = math.sqrt(cx * cx + cy * cy)
        if distance > 5.0 * FOG_RANGE + radius:
            continue
        first, last = 0, BINS - 1
        if power[i] > 0.0:
            half = math.asin(radius / distance)
            c, s = math.cos(half), math.sin(half)
            low = diamond(np.float32(cx * c + cy * s), np.float32(cy * c - cx * s))
            high = diamond(np.float32(cx * c - cy * s), np.float32(cy * c + cx * s))
            first = int((low + 2.0) * QUARTER)
            last = int((high + 2.0) * QUARTER)
            if last < first:
                last += BINS
        tiles = max(1.0, np.round(2 * math.pi * radius * BARK_TEXELS / TILE))
        for index in range(first, last + 1):
            b = index & (BINS - 1)
            ux, uy = bins[b, 0], bins[b, 1]
            along = cx * ux + cy * uy
            across = cx * uy - cy * ux
            inside = radius * radius - across * across
            if inside <= 0.0:
                continue
            chord = math.sqrt(inside)
            t_in = max(along - chord, 0.02)
            t_out = along + chord
            if t_out <= t_in:
                continue
            rise = height - p[2]
            top, cap = rise / t_in, rise / t_out
            layer = count[b]
            if layer >= LAYERS:
                continue
            if layer > 0:
                before = table[layer - 1, b]
                if max(top, cap) <= max(before[S_TOP], before[S_CAP]):
                    continue
            count[b] = layer + 1
            nx, ny = (t_in * ux - cx) / radius, (t_in * uy - cy) / radius
            phi = math.atan2(ny, nx) / (2 * math.pi) + tint[i, 3]
            light = 0.50 + 0.62 * max(0.0, nx * sun[0] + ny * sun[1])
            clear = math.exp(-t_in / FOG_RANGE)
            row = table[layer, b]
            row[S_TOP] = top
            row[S_CAP] = cap
            row[T_IN] = t_in
            row[U] = (phi + 1.0) * tiles * TILE
            facing = max(0.15, -(nx * ux + ny * uy))
            row[LEVEL] = mip(t_in * pixel_angle * BARK_TEXELS / math.sqrt(facing))
            for c in range(3):
                row[B + c] = tint[i, c] * light * clear
                row[FOG_B + c] = haze[c] * (1 - clear)
            row[HEIGHT] = height


@njit(nogil=True, cache=True, error_model="numpy")
def ground_table(height: float, pixel_angle: float, table: Float32):  # type: ignore[no-untyped-def]
    """Fill (2,EBINS) mip level and clarity of the ground by diamond elevation, horizon first."""
    for i in range(EBINS):
        e = (i + 0.5) / EBINS
        t = height * (1 - e) / e
        r = math.sqrt(t * t + height * height)
        # Between the long (r²/z) and the short (r) side of the footprint: sharp, little shimmer.
        side = r * pixel_angle * (r / height) ** 0.6
        table[0, i] = mip(side * GROUND_TEXELS)
        table[1, i] = math.exp(-r / FOG_RANGE)


@njit(nogil=True, cache=True, error_model="numpy")
def box_lists(p: Float64, boxes: Float64, start, which):  # type: ignore[no-untyped-def]
    """List the boxes (n,6: min, max) in each azimuth bin: which[start[b]:start[b+1]]."""
    n = boxes.shape[0]
    spans = np.empty((n, 2), np.int64)
    for i in range(n):
        x0, x1 = boxes[i, 0] - p[0], boxes[i, 3] - p[0]
        y0, y1 = boxes[i, 1] - p[1], boxes[i, 4] - p[1]
        spans[i, 0], spans[i, 1] = 0, BINS - 1
        if x0 < 0.01 and x1 > -0.01 and y0 < 0.01 and y1 > -0.01:
            continue
        middle = diamond(np.float32(x0 + x1), np.float32(y0 + y1))
        low, high = 0.0, 0.0
        for k in range(4):
            a = diamond(np.float32(x0 if k & 1 else x1), np.float32(y0 if k & 2 else y1)) - middle
            a -= 4.0 * np.round(a / 4.0)
            low, high = min(low, a), max(high, a)
        spans[i, 0] = int(np.floor((middle + low + 2.0) * QUARTER)) - 1
        spans[i, 1] = int(np.floor((middle + high + 2.0) * QUARTER)) + 1
    start[:] = 0
    for i in range(n):
        for index in range(spans[i, 0], spans[i, 1] + 1):
            start[(index & (BINS - 1)) + 1] += 1
    for b in range(BINS):
        start[b + 1] += start[b]
    fill = start[:-1].copy()
    for i in range(n):
        for index in range(spans[i, 0], spans[i, 1] + 1):
            b = index & (BINS - 1)
            if fill[b] < start[b + 1]:
                which[fill[b]] = i
                fill[b] += 1


@njit(nogil=True, cache=True, error_model="numpy")
def front_trunks(table, count):  # type: ignore[no-untyped-def]
    """Return the nearest layer of the azimuth table, packed for the pixel loop.

    near: (BINS,) distance, inf: none. top, upper: (BINS,) slope of its front edge, and of all
    layers. stem, level: (BINS,) its column in the bark, and mip level. shade: (BINS,6) gain, fog.
    """
    near, top, upper = np.full(BINS, FAR), np.full(BINS, -FAR), np.full(BINS, -FAR)
    stem, level = np.zeros(BINS, np.int32), np.zeros(BINS, np.int32)
    shade = np.zeros((BINS, 6), np.float32)
    for b in range(BINS):
        if count[b] > 0:
            near[b], top[b] = table[0, b, T_IN], table[0, b, S_TOP]
            upper[b] = table[0, b, S_CAP]
            for layer in range(1, count[b]):
                upper[b] = max(upper[b], table[layer, b, S_TOP], table[layer, b, S_CAP])
            level[b] = np.int32(table[0, b, LEVEL])
            stem[b] = texel(np.int32(table[0, b, U]), np.int32(0), level[b]) - _OFFSETS[level[b]]
            shade[b] = table[0, b, B : B + 6]
    return near, top, upper, stem, level, shade
