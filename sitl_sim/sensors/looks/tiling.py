"""Which shapes a tile of the picture may show: a list for each tile, nearest first.

A tile is TILE_PX × TILE_PX pixels, bounded by a cone of directions; a shape's axis is an arc of
directions with an angular radius. A list holds all shapes that the tile shows, and some more.
"""

# ruff: noqa: ANN001, ANN201, ANN202 - numba infers the types of a kernel's arguments
from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sitl_sim.sensors.fisheye import Float32, Float64
from sitl_sim.sensors.looks.shapes import BOX, SPHERE

TILE_PX = 16
GROUP = 4  # tiles along a side of a group, which is asked first
LONGEST = 64  # shapes in a tile's list; farther ones are left out
_PARTS = 3  # of a long axis


def cones(rays: Float32, pixels: int) -> Float64:
    """Return (rows, columns, 4) axis and half-angle [rad] of each block of `pixels` × `pixels`."""
    h, w = rays.shape[1:]
    rows, columns = -(-h // pixels), -(-w // pixels)
    found = np.zeros((rows, columns, 4))
    for j in range(rows):
        for i in range(columns):
            ys = [j * pixels, min((j + 1) * pixels, h) - 1]
            xs = [i * pixels, min((i + 1) * pixels, w) - 1]
            block = rays[:, ys[0] : ys[1] + 1, xs[0] : xs[1] + 1].reshape(3, -1).astype(float)
            axis = block.mean(axis=1)
            axis /= np.linalg.norm(axis)
            # Half a pixel more: rays are those of the pixels' centres.
            angle = np.arccos(np.clip(axis @ block, -1, 1).min()) * (1 + 0.5 / pixels) + 2e-3
            found[j, i] = [*axis, angle]
    return found


@njit(nogil=True, cache=True, error_model="numpy")
def _arcs(a, b, radius, parts):  # type: ignore[no-untyped-def]
    """Return for each part of the axis a…b, seen from the origin: ends, normal, angular radius.

    (parts,10); an angular radius of π: all around.
    """
    out = np.zeros((parts, 10))
    for k in range(parts):
        s, e = a + (b - a) * (k / parts), a + (b - a) * ((k + 1) / parts)
        d = e - s
        along = -np.sum(s * d) / max(np.sum(d * d), 1e-12)
        nearest = s + d * min(max(along, 0.0), 1.0)
        away = math.sqrt(np.sum(nearest * nearest))
        if away <= radius * 1.001 + 1e-6:
            out[k, 9] = math.pi
            continue
        out[k, :3] = s / math.sqrt(np.sum(s * s))
        out[k, 3:6] = e / math.sqrt(np.sum(e * e))
        n = np.cross(out[k, :3], out[k, 3:6])
        length = math.sqrt(np.sum(n * n))
        if length > 1e-6:
            out[k, 6:9] = n / length
        out[k, 9] = math.asin(radius / away)
    return out


@njit(inline="always", error_model="numpy")
def _meets(arc, cone):  # type: ignore[no-untyped-def]
    """Return whether a cone of directions may show a part of a shape."""
    reach = arc[9] + cone[3]
    if reach >= 1.5:
        return True
    dx, dy, dz = cone[0], cone[1], cone[2]
    least = math.cos(reach)
    if dx * arc[0] + dy * arc[1] + dz * arc[2] >= least:
        return True
    if dx * arc[3] + dy * arc[4] + dz * arc[5] >= least:
        return True
    if abs(dx * arc[6] + dy * arc[7] + dz * arc[8]) > math.sin(reach):
        return False
    # Between the planes through the normal and each end.
    cx = arc[7] * arc[2] - arc[8] * arc[1]
    cy = arc[8] * arc[0] - arc[6] * arc[2]
    cz = arc[6] * arc[1] - arc[7] * arc[0]
    if dx * cx + dy * cy + dz * cz <= 0.0:
        return False
    cx = arc[4] * arc[8] - arc[5] * arc[7]
    cy = arc[5] * arc[6] - arc[3] * arc[8]
    cz = arc[3] * arc[7] - arc[4] * arc[6]
    return dx * cx + dy * cy + dz * cz > 0.0


@njit(nogil=True, cache=True, error_model="numpy")
def order(rows: Float64, p: Float64, reach: float) -> Any:
    """Return the shapes within `reach` [m] of p, nearest first, and the distance to each."""
    n = rows.shape[0]
    near = np.empty(n)
    for i in range(n):
        a, b = rows[i, 1:4] - p, rows[i, 4:7] - p
        if rows[i, 0] == BOX:
            gap = 0.0
            for k in range(3):
                gap += max(a[k], -b[k], 0.0) ** 2
            near[i] = math.sqrt(gap)
            continue
        d = b - a
        along = min(max(-np.sum(a * d) / max(np.sum(d * d), 1e-12), 0.0), 1.0)
        c = a + d * along
        near[i] = max(math.sqrt(np.sum(c * c)) - rows[i, 7], 0.0)
    ranked = np.argsort(near, kind="mergesort")
    kept = 0
    while kept < n and near[ranked[kept]] <= reach:
        kept += 1
    return ranked[:kept], near


@njit(nogil=True, cache=True, error_model="numpy")
def tile_lists(  # type: ignore[no-untyped-def]
    rows: Float64, ranked: NDArray[np.int64], p: Float64, r_wc: Float64, groups, tiles
):
    """Return for each tile the shapes (places in `ranked`), nearest first, and their number.

    groups: cones of GROUP × GROUP tiles. tiles: cones of tiles. Both as `cones` returns them.
    """
    down, across = tiles.shape[0], tiles.shape[1]
    lists = np.empty((down * across, LONGEST), np.int16)
    count = np.zeros(down * across, np.int32)
    last = np.full(down * across, -1, np.int32)
    to_camera = np.ascontiguousarray(r_wc.T)
    for place in range(ranked.shape[0]):
        row = rows[ranked[place]]
        a, b, radius, parts = row[1:4] - p, row[4:7] - p, row[7], _PARTS
        if row[0] == BOX:
            a, b, radius = (a + b) / 2, (a + b) / 2, math.sqrt(np.sum((b - a) ** 2)) / 2
        if row[0] == BOX or row[0] == SPHERE:
            parts = 1
        arcs = _arcs(to_camera @ a, to_camera @ b, radius, parts)
        for k in range(parts):
            for gj in range(groups.shape[0]):
                for gi in range(groups.shape[1]):
                    if not _meets(arcs[k], groups[gj, gi]):
                        continue
                    for j in range(gj * GROUP, min((gj + 1) * GROUP, down)):
                        for i in range(gi * GROUP, min((gi + 1) * GROUP, across)):
                            t = j * across + i
                            if last[t] == place or count[t] >= LONGEST:
                                continue
                            if _meets(arcs[k], tiles[j, i]):
                                lists[t, count[t]] = place
                                count[t] += 1
                                last[t] = place
    return lists, count
