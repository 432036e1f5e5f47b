"""The static scene of a look: colour, depth and class of every pixel, tile by tile."""

# ruff: noqa: ANN001, ANN201, ANN202 - numba infers the types of a kernel's arguments
from __future__ import annotations

import math

import numpy as np
from numba import njit

from sitl_sim.sensors.looks.hits import (
    ACROSS,
    ALONG,
    AROUND,
    AXIS,
    E1,
    E2,
    KIND,
    LENGTH,
    MATERIAL,
    OFF_U,
    OFF_V,
    RADIUS,
    SEEN,
    TINT,
    bush_texel,
    meet,
)
from sitl_sim.sensors.looks.shapes import BOX, CYLINDER, SPHERE
from sitl_sim.sensors.looks.terrain import meet_terrain
from sitl_sim.sensors.looks.tiling import TILE_PX
from sitl_sim.sensors.scene import SHIFT, WALL_TEXELS
from sitl_sim.sensors.tables import BARK_TEXELS, GROUND_TEXELS, diamond, mip, texel
from sitl_sim.sensors.textures import SKY_SHAPE

GROUND_A, GROUND_B, LEAVES, WALL, FIRST_BARK = range(5)  # rows of the materials
DAPPLE_TEXELS, CANOPY_TEXELS = np.float32(60.0), np.float32(55.0)  # per metre
# Numbers of a look and a picture that the kernel takes in one array.
(
    SUN, DIRECT, AMBIENT, HAZE, FOG, DAPPLE, COVER, CANOPY, PIXEL,
    MACRO_X, MACRO_Y, MACRO_SCALE, NUMBERS,
) = (0, 3, 6, 9, 12, 13, 14, 15, 16, 17, 18, 19, 20)  # fmt: skip
_FAST = {"contract", "nsz", "arcp"}
_SKY, _GROUND = np.int32(-1), np.int32(-2)  # of `who`
_ZERO, _ONE, _TINY, _MAX = np.float32(0), np.float32(1), np.float32(1e-9), np.float32(255)
_FAR, _END = np.float32(np.inf), np.float32(300.0)
_BYTE, _LOW = np.uintp(8), np.uintp(255)
_ROWS, _COLUMNS = np.float32(SKY_SHAPE[0]), np.float32(SKY_SHAPE[1] / 4)


@njit(inline="always", error_model="numpy")
def _shade(leaves, x, y, z, number, footprint):  # type: ignore[no-untyped-def]
    """Return the share of sunlight 0…1 that leaves let through to a point in the world."""
    rise = z / max(number[SUN + 2], np.float32(0.05))
    u = np.int32((x - number[SUN] * rise + SHIFT) * DAPPLE_TEXELS)
    v = np.int32((y - number[SUN + 1] * rise + SHIFT) * DAPPLE_TEXELS)
    rank = leaves[texel(u, v, mip(footprint * DAPPLE_TEXELS))] >> np.uint16(8)
    lit = (np.float32(rank) - np.float32(128)) * np.float32(0.02) + np.float32(0.5)
    return _ONE - number[DAPPLE] * (_ONE - min(max(lit, _ZERO), _ONE))


@njit(inline="always", error_model="numpy")
def _colour(texels, colours, material, u, v, level):  # type: ignore[no-untyped-def]
    return colours[material, np.uintp(texels[material, texel(u, v, level)] & 0x1FFF)]


@njit(inline="always", error_model="numpy")
def _paint_shape(prims, k, dx, dy, dz, t, p, number, texels, colours):  # type: ignore[no-untyped-def]
    """Return the packed colour of shape k where a ray meets it, and its normal."""
    x, y, z = dx * t, dy * t, dz * t
    kind = np.int32(prims[k, KIND])
    footprint = t * number[PIXEL]
    material = np.int32(prims[k, MATERIAL])
    if kind == BOX:
        nx = ny = nz = _ZERO
        thin = np.float32(0.003)
        if min(abs(x - prims[k, AXIS]), abs(x - prims[k, ACROSS])) < thin + t * np.float32(1e-4):
            nx = _ONE if dx < _ZERO else -_ONE
        elif min(
            abs(y - prims[k, AXIS + 1]), abs(y - prims[k, ACROSS + 1])
        ) < thin + t * np.float32(1e-4):
            ny = _ONE if dy < _ZERO else -_ONE
        else:
            nz = _ONE if dz < _ZERO else -_ONE
        u_m, v_m = p[0] + x + SHIFT, p[2] + z + SHIFT
        if nx != _ZERO:
            u_m = p[1] + y + SHIFT
        elif nz != _ZERO:
            v_m = p[1] + y + SHIFT
        facing = max(-(nx * dx + ny * dy + nz * dz), np.float32(0.1))
        level = mip(footprint * WALL_TEXELS / math.sqrt(facing))
        found = _colour(
            texels,
            colours,
            material,
            np.int32(u_m * WALL_TEXELS),
            np.int32(v_m * WALL_TEXELS),
            level,
        )
    elif kind == SPHERE:
        r = _ONE / prims[k, RADIUS]
        nx, ny = (prims[k, ACROSS] + x) * r, (prims[k, ACROSS + 1] + y) * r
        nz = (prims[k, ACROSS + 2] + prims[k, ALONG] + z) * r
        u, v, level = bush_texel(prims, k, x, y, z, footprint)
        leaf = np.uintp(texels[material, texel(u, v, level)])
        found = colours[material, ((leaf >> np.uintp(11)) << _BYTE) + (leaf & _LOW)]
        # Leaves face all ways: half of the light does not depend on the sphere's own slope.
        nx, ny, nz = nx * np.float32(0.7), ny * np.float32(0.7), nz * np.float32(0.7)
    else:
        along = (
            prims[k, ALONG] + prims[k, AXIS] * x + prims[k, AXIS + 1] * y + prims[k, AXIS + 2] * z
        )
        end = min(max(along, _ZERO), prims[k, LENGTH])
        if kind == CYLINDER:
            end = along
        r, d = _ONE / prims[k, RADIUS], along - end
        lean = prims[k, AXIS] * dx + prims[k, AXIS + 1] * dy + prims[k, AXIS + 2] * dz
        nx = (prims[k, ACROSS] + t * (dx - lean * prims[k, AXIS]) + d * prims[k, AXIS]) * r
        ny = (
            prims[k, ACROSS + 1] + t * (dy - lean * prims[k, AXIS + 1]) + d * prims[k, AXIS + 1]
        ) * r
        nz = (
            prims[k, ACROSS + 2] + t * (dz - lean * prims[k, AXIS + 2]) + d * prims[k, AXIS + 2]
        ) * r
        c1 = nx * prims[k, E1] + ny * prims[k, E1 + 1] + nz * prims[k, E1 + 2]
        c2 = nx * prims[k, E2] + ny * prims[k, E2 + 1] + nz * prims[k, E2 + 2]
        around = (diamond(c1, c2) * np.float32(0.25) + _ONE + prims[k, OFF_U]) * prims[k, AROUND]
        u, v = np.int32(around * np.float32(512)), np.int32((along + prims[k, OFF_V]) * BARK_TEXELS)
        if kind == CYLINDER and along >= prims[k, LENGTH] - np.float32(0.002):  # the sawn top
            nx, ny, nz = prims[k, AXIS], prims[k, AXIS + 1], prims[k, AXIS + 2]
            u, v = np.int32(c1 * BARK_TEXELS), np.int32(c2 * BARK_TEXELS)
        facing = max(-(nx * dx + ny * dy + nz * dz), np.float32(0.15))
        level = mip(footprint * BARK_TEXELS / math.sqrt(facing))
        found = _colour(texels, colours, material, u, v, level)
    return found, nx, ny, nz


@njit(nogil=True, cache=True, error_model="numpy", fastmath=_FAST)
def paint(  # type: ignore[no-untyped-def]
    rays,
    rot,
    p,
    prims,
    lists,
    count,
    number,
    texels,
    colours,
    macro,
    sky,
    profile,
    out,
    depth,
    seen,
):
    """Paint out (h,w,3) uint8 BGR, depth (h,w) [m] along the ray (sky: inf), seen (h,w) uint8.

    rays: (3,h,w) unit, camera frame. rot: (3,3) camera → world. p: (3,) m, world; its z is over
    the ground's zero. prims: of `prepare`. lists, count: of `tile_lists`. texels (m,n), colours
    (m,HUES × 256): of the materials. macro: (n,n) share of the second ground << 8 | light. sky:
    (rows,columns) packed BGR. profile: of `terrain`, empty where the ground is flat.
    """
    h, w = rays.shape[1], rays.shape[2]
    px, py, pz = p[0], p[1], p[2]
    across = -(-w // TILE_PX)
    n = TILE_PX * TILE_PX
    dx, dy, dz = np.empty(n, np.float32), np.empty(n, np.float32), np.empty(n, np.float32)
    best, who = np.empty(n, np.float32), np.empty(n, np.int32)
    clear = np.empty(n, np.float32)
    found = np.empty(n, np.uint32)
    gain = np.empty((3, n), np.float32)
    dappled = number[DAPPLE] > _ZERO
    leaves = texels[LEAVES]
    uneven = profile.shape[0] > 0
    side, last = np.int32(macro.shape[0]), np.float32(macro.shape[0] - 1)
    share_of = macro.reshape(-1)
    thin = np.float32(0.125) / number[FOG]
    cover = np.int32(number[COVER])
    flat = np.float32(max(number[SUN + 2], _ZERO))
    result = out.reshape(h, 3 * w)
    for tile in range(count.shape[0]):
        y0, x0 = (tile // across) * TILE_PX, (tile % across) * TILE_PX
        high, wide = min(TILE_PX, h - y0), min(TILE_PX, w - x0)
        for j in range(TILE_PX):
            y = min(y0 + j, h - 1)
            for i in range(TILE_PX):
                x = min(x0 + i, w - 1)
                a, b, c = rays[0, y, x], rays[1, y, x], rays[2, y, x]
                k = j * TILE_PX + i
                dx[k] = rot[0, 0] * a + rot[0, 1] * b + rot[0, 2] * c
                dy[k] = rot[1, 0] * a + rot[1, 1] * b + rot[1, 2] * c
                dz[k] = rot[2, 0] * a + rot[2, 1] * b + rot[2, 2] * c
        if uneven:
            meet_terrain(profile, pz, dx, dy, dz, best, who)
        else:
            for k in range(n):
                down = dz[k] < -np.float32(1e-4)
                best[k] = pz / (-dz[k] if down else _ONE) if down else _FAR
                who[k] = _GROUND if down else _SKY
        meet(prims, lists[tile], count[tile], dx, dy, dz, best, who, leaves, number[PIXEL])
        for k in range(n):
            # (1 − x/8)^8 is close to exp(−x), and SIMD.
            left = max(_ONE - min(best[k], _END) * thin, _ZERO)
            left *= left
            left *= left
            clear[k] = left * left
        for k in range(n):
            t, place = best[k], who[k]
            if place >= 0:
                found[k], nx, ny, nz = _paint_shape(
                    prims, place, dx[k], dy[k], dz[k], t, p, number, texels, colours
                )
                sunny = max(nx * number[SUN] + ny * number[SUN + 1] + nz * number[SUN + 2], _ZERO)
                if dappled and sunny > _ZERO:
                    x, y, z = px + dx[k] * t, py + dy[k] * t, pz + dz[k] * t
                    sunny *= _shade(leaves, x, y, z, number, t * number[PIXEL])
                # The ground throws less light than the sky.
                under = np.float32(0.72) + np.float32(0.28) * nz
                for c in range(3):
                    light = number[AMBIENT + c] * under + number[DIRECT + c] * sunny
                    gain[c, k] = prims[place, TINT + c] * light
            elif place == _GROUND:
                t = min(t, _END)
                gx, gy = px + dx[k] * t, py + dy[k] * t
                u, v = (
                    np.int32((gx + SHIFT) * GROUND_TEXELS),
                    np.int32((gy + SHIFT) * GROUND_TEXELS),
                )
                mu = np.int32(min(max((gx - number[MACRO_X]) * number[MACRO_SCALE], _ZERO), last))
                mv = np.int32(min(max((gy - number[MACRO_Y]) * number[MACRO_SCALE], _ZERO), last))
                here = np.uintp(share_of[mv * side + mu])
                # Between the long and the short side of the footprint: sharp, little shimmer.
                footprint = t * number[PIXEL]
                long = footprint / math.sqrt(max(-dz[k], np.float32(0.02)))
                level = mip(long * GROUND_TEXELS)
                material = GROUND_B if (here >> _BYTE) > np.uintp(128) else GROUND_A
                found[k] = _colour(texels, colours, material, u, v, level)
                sunny = np.float32(here & _LOW) * np.float32(1 / 230) * flat
                if dappled:
                    sunny *= _shade(leaves, gx, gy, _ZERO, number, long)
                under = np.float32(0.55) + np.float32(here & _LOW) * np.float32(0.45 / 230)
                for c in range(3):
                    gain[c, k] = number[AMBIENT + c] * under + number[DIRECT + c] * sunny
            else:
                clear[k] = _ONE
                for c in range(3):
                    gain[c, k] = _ONE
                if cover > 0 and dz[k] > np.float32(0.05):
                    t = (number[CANOPY] - pz) / dz[k]
                    u = np.int32((px + dx[k] * t + SHIFT) * CANOPY_TEXELS)
                    v = np.int32((py + dy[k] * t + SHIFT) * CANOPY_TEXELS)
                    leaf = np.uintp(leaves[texel(u, v, mip(t * number[PIXEL] * CANOPY_TEXELS))])
                    if np.int32(leaf >> _BYTE) < cover:
                        hue = leaf >> np.uintp(11)
                        found[k] = colours[LEAVES, (hue << _BYTE) + (leaf & _LOW)]
                        left = max(_ONE - t * thin, _ZERO)
                        clear[k] = left * left * left * left
                        for c in range(3):
                            gain[c, k] = number[AMBIENT + c] * np.float32(0.8)
                        continue
                flat_length = math.sqrt(max(_ONE - dz[k] * dz[k], _ZERO))
                row = abs(dz[k]) / (flat_length + abs(dz[k]) + _TINY) * _ROWS
                column = (diamond(dx[k], dy[k]) + np.float32(2)) * _COLUMNS
                found[k] = sky[
                    np.uintp(min(row, _ROWS - _ONE)),
                    np.uintp(min(column, np.float32(SKY_SHAPE[1] - 1))),
                ]
        for j in range(high):
            line = result[y0 + j]
            for i in range(wide):
                k = j * TILE_PX + i
                at = 3 * (x0 + i)
                c = found[k]
                mist = _ONE - clear[k]
                b_ = np.float32(np.int32(c & np.uint32(255))) * gain[0, k] * clear[k]
                g_ = (
                    np.float32(np.int32(c >> np.uint32(8) & np.uint32(255))) * gain[1, k] * clear[k]
                )
                r_ = np.float32(np.int32(c >> np.uint32(16))) * gain[2, k] * clear[k]
                line[at] = np.uint8(np.int32(min(b_ + number[HAZE] * mist, _MAX)))
                line[at + 1] = np.uint8(np.int32(min(g_ + number[HAZE + 1] * mist, _MAX)))
                line[at + 2] = np.uint8(np.int32(min(r_ + number[HAZE + 2] * mist, _MAX)))
                depth[y0 + j, x0 + i] = best[k]
                place = who[k]
                seen[y0 + j, x0 + i] = (
                    np.uint8(prims[place, SEEN])
                    if place >= 0
                    else (np.uint8(1) if place == _GROUND else np.uint8(0))
                )
