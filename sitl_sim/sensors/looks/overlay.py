"""Drones, birds and leaves drawn over the static scene, hidden by what its depth says is nearer."""

# ruff: noqa: ANN001, ANN201 - numba infers the types of a kernel's arguments
from __future__ import annotations

import math

import numpy as np
from numba import njit

from sitl_sim.sensors.drones import _place, _trace

_ZERO, _ONE, _MAX = np.float32(0), np.float32(1), np.float32(255)
_NEAREST, _FARTHEST = 0.05, 60.0  # m; nearer is the drone that carries the camera
_COARSE = 45.0  # px across; a body that appears larger needs no samples within pixels


@njit(nogil=True, cache=True, error_model="numpy")
def overlay(  # type: ignore[no-untyped-def]
    rays,
    p,
    r_wc,
    places,
    turns,
    which,
    parts_all,
    lights,
    sun,
    haze,
    fog,
    f,
    lens,
    reach,
    depth,
    out,
    owner,
):
    """Draw bodies into out (h,w,3), far to near; return the pixels (m,2) that each covers.

    places (m,3), turns (m,3,3) body → world, which (m,) row of parts_all, lights (m,3) BGR gains.
    reach: rad, the farthest off the axis that a pixel looks. depth (h,w): of the static scene.
    owner (h,w) int8: set to the body's number where it covers most of a pixel. The two columns
    are pixels covered, without and with what is in front; other bodies do not count.
    """
    h, w = rays.shape[1], rays.shape[2]
    m = places.shape[0]
    shown = np.zeros((m, 2))
    away = np.empty(m)
    for j in range(m):
        away[j] = np.sqrt(np.sum((places[j] - p) ** 2))
    rgba = np.zeros(4, np.float32)
    samples = np.array([-0.25, 0.25], np.float32)
    for j in np.argsort(-away, kind="mergesort"):
        if away[j] < _NEAREST or away[j] > _FARTHEST:
            continue
        parts = parts_all[which[j]]
        size = np.max(np.abs(parts[:, 9:12])) * 2.0 + np.max(parts[:, 12])
        ahead = min(max(np.sum(r_wc[:, 2] * (places[j] - p)) / away[j], -1.0), 1.0)
        if size < away[j] and math.acos(ahead) - math.asin(size / away[j]) > reach:
            continue
        maps, origins, suns, frames = _place(
            parts, p, r_wc, places[j], turns[j], sun, f, lens, w, h
        )
        x0, y0 = frames[:, 0].min(), frames[:, 1].min()
        x1, y1 = frames[:, 2].max(), frames[:, 3].max()
        clear = np.float32(math.exp(-away[j] / fog))
        ss = 2 if f * 2 * size / away[j] < _COARSE else 1
        active = np.empty(parts.shape[0], np.uintp)
        row = np.empty(parts.shape[0], np.uintp)
        share = np.float32(1.0 / (ss * ss))
        for y in range(y0, y1):
            n_row = 0
            for i in range(parts.shape[0]):
                if frames[i, 1] <= y < frames[i, 3] and frames[i, 0] < frames[i, 2]:
                    row[n_row] = np.uintp(i)
                    n_row += 1
            for x in range(x0, x1):
                n_active = 0
                for k in range(n_row):
                    if frames[row[k], 0] <= x < frames[row[k], 2]:
                        active[n_active] = row[k]
                        n_active += 1
                if n_active == 0:
                    continue
                xa, xb = max(x - 1, 0), min(x + 1, w - 1)
                ya, yb = max(y - 1, 0), min(y + 1, h - 1)
                total_b = total_g = total_r = total_a = _ZERO
                for sy in range(ss):
                    for sx in range(ss):
                        dx, dy, dz = rays[0, y, x], rays[1, y, x], rays[2, y, x]
                        if ss == 2:
                            fx = samples[sx] / np.float32(xb - xa)
                            fy = samples[sy] / np.float32(yb - ya)
                            dx += fx * (rays[0, y, xb] - rays[0, y, xa])
                            dx += fy * (rays[0, yb, x] - rays[0, ya, x])
                            dy += fx * (rays[1, y, xb] - rays[1, y, xa])
                            dy += fy * (rays[1, yb, x] - rays[1, ya, x])
                            dz += fx * (rays[2, y, xb] - rays[2, y, xa])
                            dz += fy * (rays[2, yb, x] - rays[2, ya, x])
                        t = _trace(dx, dy, dz, maps, origins, suns, parts, active, n_active, rgba)
                        if rgba[3] <= _ZERO:
                            continue
                        shown[j, 0] += rgba[3] * share
                        if t > depth[y, x]:
                            continue
                        shown[j, 1] += rgba[3] * share
                        total_b += rgba[0] * rgba[3]
                        total_g += rgba[1] * rgba[3]
                        total_r += rgba[2] * rgba[3]
                        total_a += rgba[3]
                if total_a > _ZERO:
                    cover = total_a * share
                    back = _ONE - cover
                    mist = (_ONE - clear) * cover
                    lit = clear * share
                    b = out[y, x, 0] * back + lit * total_b * lights[j, 0] + haze[0] * mist
                    g = out[y, x, 1] * back + lit * total_g * lights[j, 1] + haze[1] * mist
                    r = out[y, x, 2] * back + lit * total_r * lights[j, 2] + haze[2] * mist
                    out[y, x, 0] = int(min(b, _MAX))
                    out[y, x, 1] = int(min(g, _MAX))
                    out[y, x, 2] = int(min(r, _MAX))
                    if cover > np.float32(0.5):
                        owner[y, x] = j
    return shown
