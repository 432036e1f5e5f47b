"""The static scene of a look: colour, depth and class of every pixel, tile by tile."""

# ruff: noqa: ANN001, ANN201, ANN202 - numba infers the types of a kernel's arguments
from __future__ import annotations

import math

import numpy as np
from numba import njit

from sitl_sim.sensors.fisheye import Float32
from sitl_sim.sensors.looks.hits import (
    ACROSS,
    ALONG,
    AXIS,
    KIND,
    MATERIAL,
    RADIUS,
    SEEN,
    TINT,
    bush_texel,
    meet,
)
from sitl_sim.sensors.looks.passes import (
    AMBIENT,
    CANOPY,
    COVER,
    DAPPLE,
    DAPPLE_TEXELS,
    DIRECT,
    FOG,
    PIXEL,
    SUN,
    bark_places,
    clarity,
    ground_places,
    light_bark,
    light_ground,
    mix,
    sky_places,
    turn,
)
from sitl_sim.sensors.looks.shapes import BOX, SPHERE
from sitl_sim.sensors.looks.terrain import meet_terrain
from sitl_sim.sensors.looks.tiling import TILE_PX
from sitl_sim.sensors.scene import SHIFT, WALL_TEXELS
from sitl_sim.sensors.tables import mip, texel

GROUND_A, GROUND_B, LEAVES, WALL, FIRST_BARK = range(5)  # rows of the materials
CANOPY_TEXELS = np.float32(55.0)  # per metre
_FAST = {"contract", "nsz", "arcp"}
_SKY, _GROUND = np.int32(-1), np.int32(-2)  # of `who`
_ZERO, _ONE, _FAR = np.float32(0), np.float32(1), np.float32(np.inf)
_BYTE, _LOW = np.uintp(8), np.uintp(255)


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
def _paint_shape(prims, k, dx, dy, dz, t, number, p, texels, colours):  # type: ignore[no-untyped-def]
    """Return the packed colour of a box or bush k where a ray meets it, and its normal."""
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
    else:
        r = _ONE / prims[k, RADIUS]
        nx, ny = (prims[k, ACROSS] + x) * r, (prims[k, ACROSS + 1] + y) * r
        nz = (prims[k, ACROSS + 2] + prims[k, ALONG] + z) * r
        u, v, level = bush_texel(prims, k, x, y, z, footprint)
        leaf = np.uintp(texels[material, texel(u, v, level)])
        found = colours[material, ((leaf >> np.uintp(11)) << _BYTE) + (leaf & _LOW)]
        # Leaves face all ways: half of the light does not depend on the sphere's own slope.
        nx, ny, nz = nx * np.float32(0.7), ny * np.float32(0.7), nz * np.float32(0.7)
    return found, nx, ny, nz


@njit(nogil=True, cache=True, error_model="numpy", fastmath=_FAST)
def _paint_shapes(  # type: ignore[no-untyped-def]
    prims, place, who, dx, dy, dz, best, p, number, texels, colours, found, gain
):
    """Paint the pixels whose `who` is `place`, a box or a bush: colour found (n,), gain (3,n)."""
    leaves = texels[LEAVES]
    for k in range(who.shape[0]):
        if who[k] != place:
            continue
        t = best[k]
        found[k], nx, ny, nz = _paint_shape(
            prims, place, dx[k], dy[k], dz[k], t, number, p, texels, colours
        )
        sunny = max(nx * number[SUN] + ny * number[SUN + 1] + nz * number[SUN + 2], _ZERO)
        if number[DAPPLE] > _ZERO and sunny > _ZERO:
            x, y, z = p[0] + dx[k] * t, p[1] + dy[k] * t, p[2] + dz[k] * t
            sunny *= _shade(leaves, x, y, z, number, t * number[PIXEL])
        under = np.float32(0.72) + np.float32(0.28) * nz
        for c in range(3):
            light = number[AMBIENT + c] * under + number[DIRECT + c] * sunny
            gain[c, k] = prims[place, TINT + c] * light


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

    rays: (tiles,3,TILE_PX²) unit, camera frame, of `tiled`. rot: (3,3) camera → world. p: (3,) m,
    world; its z is over the ground's zero. prims: of `prepare`. lists, count: of `tile_lists`.
    texels (m,n), colours (m,HUES × 256): of the materials. macro: (n,n) share of the second ground
    << 8 | light. sky: (rows,columns) packed BGR. profile: of `terrain`, empty where the ground is
    flat.

    A tile is painted in passes: a pixel costs one look-up in each texture, and what is between the
    look-ups becomes SIMD.
    """
    h, w = depth.shape
    px, py, pz = p[0], p[1], p[2]
    across = -(-w // TILE_PX)
    n = TILE_PX * TILE_PX
    dx, dy, dz = np.empty(n, np.float32), np.empty(n, np.float32), np.empty(n, np.float32)
    best, who = np.empty(n, np.float32), np.empty(n, np.int32)
    clear = np.empty(n, np.float32)
    found = np.empty(n, np.uint32)
    gain, kind = np.empty((3, n), np.float32), np.empty(n, np.uint8)
    macro_at, ground_at = np.zeros(n, np.int32), np.zeros(n, np.int32)
    shade_at, sky_at = np.zeros(n, np.int32), np.zeros(n, np.int32)
    light, rank = np.zeros(n, np.int32), np.full(n, np.int32(255))
    sunny, under = np.empty(n, np.float32), np.empty(n, np.float32)
    result = out.reshape(h, 3 * w)
    dapple = number[DAPPLE]
    dappled = dapple > _ZERO
    leaves = texels[LEAVES]
    uneven = profile.shape[0] > 0
    side = np.int32(macro.shape[0])
    share_of, sky_of = macro.reshape(-1), sky.reshape(-1)
    thin = np.float32(0.125) / number[FOG]
    cover = np.int32(number[COVER])
    flat = np.float32(max(number[SUN + 2], _ZERO))
    for tile in range(count.shape[0]):
        y0, x0 = (tile // across) * TILE_PX, (tile % across) * TILE_PX
        high, wide = min(TILE_PX, h - y0), min(TILE_PX, w - x0)
        turn(rays[tile], rot, dx, dy, dz)
        if uneven:
            meet_terrain(profile, pz, dx, dy, dz, best, who)
        else:
            for k in range(n):
                down = dz[k] < -np.float32(1e-4)
                best[k] = pz / (-dz[k] if down else _ONE) if down else _FAR
                who[k] = _GROUND if down else _SKY
        meet(prims, lists[tile], count[tile], dx, dy, dz, best, who, leaves, number[PIXEL])
        clarity(best, thin, clear)
        shapes, grounds = 0, 0
        for k in range(n):
            shapes += who[k] >= 0
            grounds += who[k] == _GROUND
            kind[k] = np.uint8(who[k] == _GROUND)
        if grounds > 0:
            ground_places(p, dx, dy, dz, best, number, side, macro_at, ground_at, shade_at)
            for k in range(n):
                if who[k] == _GROUND:
                    here = np.uintp(share_of[np.uintp(macro_at[k])])
                    material = GROUND_B if (here >> _BYTE) > np.uintp(128) else GROUND_A
                    light[k] = np.int32(here & _LOW)
                    texture = texels[material, np.uintp(ground_at[k])]
                    found[k] = colours[material, np.uintp(texture & 0x1FFF)]
                    if dappled:
                        rank[k] = np.int32(leaves[np.uintp(shade_at[k])] >> np.uint16(8))
            light_ground(number, flat, dapple, light, rank, gain)
        if shapes + grounds < n:
            sky_places(dx, dy, dz, sky_at)
            for k in range(n):
                if who[k] != _SKY:
                    continue
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
                found[k] = sky_of[np.uintp(sky_at[k])]
        if shapes > 0:
            for listed in range(count[tile]):
                place = np.int32(lists[tile, listed])
                prim = prims[place]
                covered = 0
                for k in range(n):
                    covered += who[k] == place
                if covered == 0:
                    continue
                for k in range(n):
                    kind[k] = np.uint8(prim[SEEN]) if who[k] == place else kind[k]
                if np.int32(prim[KIND]) in (BOX, SPHERE):
                    _paint_shapes(
                        prims, place, who, dx, dy, dz, best, p, number, texels, colours, found, gain
                    )
                    continue
                bark_places(prim, p, number, dx, dy, dz, best, ground_at, shade_at, sunny, under)
                bark = np.uintp(prim[MATERIAL])
                for k in range(n):
                    if who[k] == place:
                        texture = texels[bark, np.uintp(ground_at[k])]
                        found[k] = colours[bark, np.uintp(texture & 0x1FFF)]
                        if dappled:
                            rank[k] = np.int32(leaves[np.uintp(shade_at[k])] >> np.uint16(8))
                light_bark(prim, place, who, number, dapple, rank, sunny, under, gain)
        mix(found, gain, clear, number)
        for j in range(high):
            line, far, classes = result[y0 + j], depth[y0 + j], seen[y0 + j]
            first, at = j * TILE_PX, 3 * x0
            for i in range(wide):
                bgr = found[first + i]
                line[at + 3 * i] = np.uint8(bgr)
                line[at + 3 * i + 1] = np.uint8(bgr >> np.uint32(8))
                line[at + 3 * i + 2] = np.uint8(bgr >> np.uint32(16))
            for i in range(wide):
                far[x0 + i] = best[first + i]
                classes[x0 + i] = kind[first + i]


def tiled(rays: Float32) -> Float32:
    """Return rays (3,h,w) tile by tile: (tiles,3,TILE_PX²); tiles at the edge repeat it."""
    down, across = (-(-size // TILE_PX) for size in rays.shape[1:])
    missing = (down * TILE_PX - rays.shape[1], across * TILE_PX - rays.shape[2])
    whole = np.pad(rays, ((0, 0), (0, missing[0]), (0, missing[1])), "edge")
    blocks = whole.reshape(3, down, TILE_PX, across, TILE_PX).transpose(1, 3, 0, 2, 4)
    return np.ascontiguousarray(blocks.reshape(down * across, 3, TILE_PX**2))
