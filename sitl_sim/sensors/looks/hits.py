"""Rays against shapes, a tile of rays at a time: branch-free loops, which become SIMD.

`prims` holds the shapes of one picture around the camera, nearest first; its columns are named
below. A tile's rays are three arrays; `best` and `who` hold the nearest hit so far.
"""

# ruff: noqa: ANN001, ANN201 - numba infers the types of a kernel's arguments
from __future__ import annotations

import math

import numpy as np
from numba import njit

from sitl_sim.sensors.looks.shapes import BOX, CAPSULE, CYLINDER, SPHERE
from sitl_sim.sensors.tables import diamond, mip, texel

# Columns: kind, distance; axis or lower corner (3), length; what of the camera's place from a is
# across the axis, or upper corner (3); its square − r²; what of it is along; radius, and its square
# − r² in all; two directions across the axis (3 each); material, tiles around, offsets; tint (3).
(KIND, NEAR, AXIS, LENGTH, ACROSS, SHORT, ALONG, RADIUS, WHOLE, E1, E2, MATERIAL, AROUND, OFF_U) = (
    0, 1, 2, 5, 6, 9, 10, 11, 12, 13, 16, 19, 20, 21,
)  # fmt: skip
OFF_V, TINT, SEEN, FIELDS = 22, 23, 26, 27
LEAF_TEXELS = np.float32(150.0)  # per metre of a bush
_ZERO, _ONE, _TINY = np.float32(0), np.float32(1), np.float32(1e-9)
_FAST = {"contract", "nsz", "arcp"}


@njit(nogil=True, cache=True, error_model="numpy")
def prepare(rows, finish, ranked, near, p):  # type: ignore[no-untyped-def]
    """Return the rows (k,FIELDS) float32 of the shapes `ranked` around a camera at p.

    rows: as `Shapes.rows`. finish: (n,8) material, tiles around, offsets u, v, tint (3), seen.
    """
    out = np.zeros((ranked.shape[0], FIELDS), np.float32)
    for k in range(ranked.shape[0]):
        row, own = rows[ranked[k]], out[k]
        a, b, r = row[1:4] - p, row[4:7] - p, row[7]
        own[KIND], own[NEAR] = row[0], near[ranked[k]]
        own[MATERIAL], own[AROUND] = finish[ranked[k], 0], finish[ranked[k], 1]
        own[OFF_U], own[OFF_V] = finish[ranked[k], 2], finish[ranked[k], 3]
        own[TINT : TINT + 3] = finish[ranked[k], 4:7]
        own[SEEN] = finish[ranked[k], 7]
        own[RADIUS] = r
        if row[0] == BOX:
            own[AXIS : AXIS + 3], own[ACROSS : ACROSS + 3] = a, b
            continue
        u = b - a
        length = math.sqrt(np.sum(u * u))
        u = u / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
        along = -np.sum(u * a)
        across = -a - along * u
        own[AXIS : AXIS + 3], own[LENGTH], own[ACROSS : ACROSS + 3] = u, length, across
        own[SHORT] = np.sum(across * across) - r * r
        own[ALONG], own[WHOLE] = along, np.sum(a * a) - r * r
        side = np.array([1.0, 0.0, 0.0]) if abs(u[0]) < 0.7 else np.array([0.0, 1.0, 0.0])
        e1 = np.cross(u, side)
        e1 = e1 / math.sqrt(np.sum(e1 * e1))
        own[E1 : E1 + 3], own[E2 : E2 + 3] = e1, np.cross(u, e1)
    return out


@njit(nogil=True, cache=True, error_model="numpy", fastmath=_FAST)
def meet_capsule(prim, place, dx, dy, dz, best, who, flat):  # type: ignore[no-untyped-def]
    """Meet a capsule or, with `flat` ends, a cylinder, whose upper end counts."""
    ux, uy, uz, length = prim[AXIS], prim[AXIS + 1], prim[AXIS + 2], prim[LENGTH]
    ax, ay, az = prim[ACROSS], prim[ACROSS + 1], prim[ACROSS + 2]
    c, along, whole = prim[SHORT], prim[ALONG], prim[WHOLE]
    r2 = prim[RADIUS] * prim[RADIUS]
    for i in range(best.shape[0]):
        bard = ux * dx[i] + uy * dy[i] + uz * dz[i]
        a = max(_ONE - bard * bard, _TINY)
        b = dx[i] * ax + dy[i] * ay + dz[i] * az
        h = b * b - a * c
        t = (-b - np.sqrt(max(h, _ZERO))) / a
        y = along + t * bard
        within = (y >= _ZERO) & (y <= length)
        if flat:
            end = (length - along) / (bard if abs(bard) > _TINY else _TINY)
            square = c + r2 + end * (2 * b + end * a)
            met = within & (h > _ZERO)
            capped = (square < r2) & (along > length)
            distance = end if capped else t
            met = met | capped
        else:
            end = _ZERO if y < _ZERO else length
            half = b + (along - end) * bard
            root = half * half - (whole - 2 * end * along + end * end)
            cap = -half - np.sqrt(max(root, _ZERO))
            distance = t if within else cap
            met = (h > _ZERO) & (within | (root > _ZERO))
        met = met & (distance > _ZERO) & (distance < best[i])
        best[i] = distance if met else best[i]
        who[i] = place if met else who[i]


@njit(nogil=True, cache=True, error_model="numpy", fastmath=_FAST)
def meet_box(prim, place, dx, dy, dz, best, who):  # type: ignore[no-untyped-def]
    """Meet an axis-aligned box."""
    for i in range(best.shape[0]):
        ix = _ONE / (dx[i] if abs(dx[i]) > _TINY else _TINY)
        iy = _ONE / (dy[i] if abs(dy[i]) > _TINY else _TINY)
        iz = _ONE / (dz[i] if abs(dz[i]) > _TINY else _TINY)
        x0, x1 = prim[AXIS] * ix, prim[ACROSS] * ix
        y0, y1 = prim[AXIS + 1] * iy, prim[ACROSS + 1] * iy
        z0, z1 = prim[AXIS + 2] * iz, prim[ACROSS + 2] * iz
        enter = max(min(x0, x1), min(y0, y1), min(z0, z1))
        leave = min(max(x0, x1), max(y0, y1), max(z0, z1))
        met = (enter < leave) & (enter > _ZERO) & (enter < best[i])
        best[i] = enter if met else best[i]
        who[i] = place if met else who[i]


@njit(nogil=True, cache=True, error_model="numpy", fastmath=_FAST)
def meet_bush(prims, place, dx, dy, dz, best, who, leaves, pixel):  # type: ignore[no-untyped-def]
    """Meet a sphere of leaves: dense in its middle, with gaps towards its outline."""
    prim = prims[place]
    ax, ay, az = prim[ACROSS], prim[ACROSS + 1], prim[ACROSS + 2]
    up, r = prim[ALONG], prim[RADIUS]
    for i in range(best.shape[0]):
        b = dx[i] * ax + dy[i] * ay + dz[i] * (az + up)
        h = b * b - prim[WHOLE]
        if h <= _ZERO:
            continue
        t = -b - math.sqrt(h)
        if t <= _ZERO or t >= best[i]:
            continue
        u, v, level = bush_texel(prims, place, dx[i] * t, dy[i] * t, dz[i] * t, t * pixel)
        rank = np.float32(leaves[texel(u, v, level)] >> np.uint16(8))
        if rank < np.float32(60) + np.float32(330) * math.sqrt(h) / r:
            best[i], who[i] = t, place


@njit(inline="always", error_model="numpy")
def bush_texel(prims, k, x, y, z, footprint):  # type: ignore[no-untyped-def]
    """Return texture coordinates and mip level of a sphere's surface at x, y, z from the camera."""
    nx, ny = prims[k, ACROSS] + x, prims[k, ACROSS + 1] + y
    nz = prims[k, ACROSS + 2] + prims[k, ALONG] + z
    around = (diamond(nx, ny) * np.float32(0.25) + _ONE + prims[k, OFF_U]) * prims[k, AROUND]
    u = np.int32(around * np.float32(512))
    v = np.int32((nz + np.float32(64) + prims[k, OFF_V]) * LEAF_TEXELS)
    return u, v, mip(footprint * LEAF_TEXELS)


@njit(nogil=True, cache=True, error_model="numpy")
def meet(prims, listed, count, dx, dy, dz, best, who, leaves, pixel):  # type: ignore[no-untyped-def]
    """Meet all shapes of a tile's list, which is nearest first."""
    for k in range(count):
        prim = prims[listed[k]]
        if prim[NEAR] > best.max():
            break
        kind = np.int32(prim[KIND])
        if kind in (CAPSULE, CYLINDER):
            meet_capsule(prim, listed[k], dx, dy, dz, best, who, kind == CYLINDER)
        elif kind == SPHERE:
            meet_bush(prims, listed[k], dx, dy, dz, best, who, leaves, pixel)
        else:
            meet_box(prim, listed[k], dx, dy, dz, best, who)
