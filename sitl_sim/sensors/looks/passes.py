"""Passes of the painter over the rays of a tile: what is between the look-ups, as SIMD."""

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
    OFF_U,
    OFF_V,
    RADIUS,
    TINT,
)
from sitl_sim.sensors.looks.shapes import CYLINDER
from sitl_sim.sensors.scene import SHIFT
from sitl_sim.sensors.tables import BARK_TEXELS, GROUND_TEXELS
from sitl_sim.sensors.textures import LEVELS, SKY_SHAPE, TILE

DAPPLE_TEXELS = np.float32(60.0)  # per metre
# Numbers of a look and a picture that the kernel takes in one array.
(
    SUN, DIRECT, AMBIENT, HAZE, FOG, DAPPLE, COVER, CANOPY, PIXEL,
    MACRO_X, MACRO_Y, MACRO_SCALE, NUMBERS,
) = (0, 3, 6, 9, 12, 13, 14, 15, 16, 17, 18, 19, 20)  # fmt: skip
_FAST = {"contract", "nsz", "arcp"}
_ZERO, _ONE, _TINY, _MAX = np.float32(0), np.float32(1), np.float32(1e-9), np.float32(255)
_FAR, _END = np.float32(np.inf), np.float32(300.0)
_FINEST = np.int32(np.float32(1.5).view(np.int32))  # bits of the widest footprint of level 0
_MANTISSA, _COARSEST = np.int32((1 << 23) - 1), np.int32(LEVELS - 1)
_TEXELS, _WRAP = np.int32(4 * TILE * TILE), np.int32(TILE - 1)
_LOG_TILE = np.int32(math.log2(TILE))
_ROWS, _COLUMNS = np.float32(SKY_SHAPE[0]), np.float32(SKY_SHAPE[1] / 4)


@njit(inline="always", error_model="numpy")
def _mip(bits):  # type: ignore[no-untyped-def]
    """Return the mip level of a footprint in finest texels, given as the bits of a float32.

    As `tables.mip`, without a branch: floats are in the order of their bits, and doubling one adds
    one to its exponent.
    """
    return min(max((bits - _FINEST + _MANTISSA) >> np.int32(23), np.int32(0)), _COARSEST)


@njit(inline="always", error_model="numpy")
def _texel(u, v, level):  # type: ignore[no-untyped-def]
    """Return the index into a mip pyramid, as `tables.texel`, without a table."""
    before = (_TEXELS - (_TEXELS >> (level + level))) // np.int32(3)
    return before + (((v & _WRAP) >> level) << (_LOG_TILE - level)) + ((u & _WRAP) >> level)


@njit(nogil=True, cache=True, error_model="numpy", fastmath=_FAST)
def turn(rays, rot, dx, dy, dz):  # type: ignore[no-untyped-def]
    """Turn rays (3,n) of the camera into the world's dx, dy, dz (n,)."""
    r00, r01, r02 = rot[0, 0], rot[0, 1], rot[0, 2]
    r10, r11, r12 = rot[1, 0], rot[1, 1], rot[1, 2]
    r20, r21, r22 = rot[2, 0], rot[2, 1], rot[2, 2]
    for k in range(dx.shape[0]):
        a, b, c = rays[0, k], rays[1, k], rays[2, k]
        dx[k] = r00 * a + r01 * b + r02 * c
        dy[k] = r10 * a + r11 * b + r12 * c
        dz[k] = r20 * a + r21 * b + r22 * c


@njit(nogil=True, cache=True, error_model="numpy", fastmath=_FAST)
def ground_places(p, dx, dy, dz, best, number, side, macro_at, ground_at, shade_at):  # type: ignore[no-untyped-def]
    """Find where rays meet the ground: indices (n,) into its map, its texture, and the leaves.

    Those of rays that do not meet it are possible, too.
    """
    n = dx.shape[0]
    px, py, pixel = p[0], p[1], number[PIXEL]
    mx, my, scale = number[MACRO_X], number[MACRO_Y], number[MACRO_SCALE]
    last = np.float32(side - 1)
    fine, coarse = np.empty(n, np.float32), np.empty(n, np.float32)
    fine_bits, coarse_bits = fine.view(np.int32), coarse.view(np.int32)
    for k in range(n):
        # Between the long and the short side of the footprint: sharp, little shimmer.
        long = min(best[k], _END) * pixel / np.sqrt(max(-dz[k], np.float32(0.02)))
        fine[k] = long * GROUND_TEXELS
        coarse[k] = long * DAPPLE_TEXELS
    for k in range(n):
        t = min(best[k], _END)
        gx, gy = px + dx[k] * t, py + dy[k] * t
        mu = np.int32(min(max((gx - mx) * scale, _ZERO), last))
        mv = np.int32(min(max((gy - my) * scale, _ZERO), last))
        macro_at[k] = mv * side + mu
        ground_at[k] = _texel(
            np.int32((gx + SHIFT) * GROUND_TEXELS),
            np.int32((gy + SHIFT) * GROUND_TEXELS),
            _mip(fine_bits[k]),
        )
        shade_at[k] = _texel(
            np.int32((gx + SHIFT) * DAPPLE_TEXELS),
            np.int32((gy + SHIFT) * DAPPLE_TEXELS),
            _mip(coarse_bits[k]),
        )


@njit(nogil=True, cache=True, error_model="numpy", fastmath=_FAST)
def sky_places(dx, dy, dz, at):  # type: ignore[no-untyped-def]
    """Find the index (n,) into the sky in which rays end; that of rays below it is possible."""
    for k in range(dx.shape[0]):
        flat = np.sqrt(max(_ONE - dz[k] * dz[k], _ZERO))
        row = abs(dz[k]) / (flat + abs(dz[k]) + _TINY) * _ROWS
        a = dy[k] / (abs(dx[k]) + abs(dy[k]) + _TINY)
        back = (np.float32(2) if dy[k] >= _ZERO else np.float32(-2)) - a
        column = ((back if dx[k] < _ZERO else a) + np.float32(2)) * _COLUMNS
        at[k] = np.int32(min(row, _ROWS - _ONE)) * np.int32(SKY_SHAPE[1]) + np.int32(
            min(column, np.float32(SKY_SHAPE[1] - 1))
        )


@njit(nogil=True, cache=True, error_model="numpy", fastmath=_FAST)
def light_ground(number, flat, dapple, light, rank, gain):  # type: ignore[no-untyped-def]
    """Set the gain (3,n) of ground: light (n,) 0…230 of its map, rank (n,) of the leaves above."""
    n = light.shape[0]
    sunny = np.empty(n, np.float32)
    under = np.empty(n, np.float32)
    for k in range(n):
        lit = (np.float32(rank[k]) - np.float32(128)) * np.float32(0.02) + np.float32(0.5)
        let = _ONE - dapple * (_ONE - min(max(lit, _ZERO), _ONE))
        sunny[k] = np.float32(light[k]) * np.float32(1 / 230) * flat * let
        under[k] = np.float32(0.55) + np.float32(light[k]) * np.float32(0.45 / 230)
    for c in range(3):
        around, straight, own = number[AMBIENT + c], number[DIRECT + c], gain[c]
        for k in range(n):
            own[k] = around * under[k] + straight * sunny[k]


@njit(nogil=True, cache=True, error_model="numpy", fastmath=_FAST)
def bark_places(prim, p, number, dx, dy, dz, best, bark_at, shade_at, sunny, under):  # type: ignore[no-untyped-def]
    """Find where rays meet a capsule or cylinder: indices (n,) into its bark and the leaves.

    sunny: (n,) how much it faces the sun there. under: (n,) what the sky gives. Of rays that do not
    meet it the indices are possible, too.
    """
    n = dx.shape[0]
    ux, uy, uz = prim[AXIS], prim[AXIS + 1], prim[AXIS + 2]
    ax, ay, az = prim[ACROSS], prim[ACROSS + 1], prim[ACROSS + 2]
    e1x, e1y, e1z = prim[E1], prim[E1 + 1], prim[E1 + 2]
    e2x, e2y, e2z = prim[E2], prim[E2 + 1], prim[E2 + 2]
    length, start, around, off_v = prim[LENGTH], prim[ALONG], prim[AROUND], prim[OFF_V]
    turned = _ONE + prim[OFF_U]
    r = _ONE / prim[RADIUS]
    sawn = np.int32(prim[KIND]) == CYLINDER
    top = length - np.float32(0.002) if sawn else _FAR
    sx, sy, sz = number[SUN], number[SUN + 1], number[SUN + 2]
    px, py, pz, pixel = p[0], p[1], p[2], number[PIXEL]
    steep = _ONE / max(sz, np.float32(0.05))
    fine, coarse = np.empty(n, np.float32), np.empty(n, np.float32)
    fine_bits, coarse_bits = fine.view(np.int32), coarse.view(np.int32)
    texel_u, texel_v = np.empty(n, np.int32), np.empty(n, np.int32)
    for k in range(n):
        t = min(best[k], _END)
        lean = ux * dx[k] + uy * dy[k] + uz * dz[k]
        along = start + t * lean
        off = _ZERO if sawn else along - min(max(along, _ZERO), length)
        nx = (ax + t * (dx[k] - lean * ux) + off * ux) * r
        ny = (ay + t * (dy[k] - lean * uy) + off * uy) * r
        nz = (az + t * (dz[k] - lean * uz) + off * uz) * r
        c1 = nx * e1x + ny * e1y + nz * e1z
        c2 = nx * e2x + ny * e2y + nz * e2z
        a = c2 / (abs(c1) + abs(c2) + _TINY)
        back = (np.float32(2) if c2 >= _ZERO else np.float32(-2)) - a
        angle = back if c1 < _ZERO else a
        u = (angle * np.float32(0.25) + turned) * around * np.float32(512)
        v = (along + off_v) * BARK_TEXELS
        above = along >= top  # on the sawn top
        texel_u[k] = np.int32(c1 * BARK_TEXELS if above else u)
        texel_v[k] = np.int32(c2 * BARK_TEXELS if above else v)
        nx, ny, nz = ux if above else nx, uy if above else ny, uz if above else nz
        facing = max(-(nx * dx[k] + ny * dy[k] + nz * dz[k]), np.float32(0.15))
        fine[k] = t * pixel * BARK_TEXELS / np.sqrt(facing)
        coarse[k] = t * pixel * DAPPLE_TEXELS
        sunny[k] = max(nx * sx + ny * sy + nz * sz, _ZERO)
        # The ground throws less light than the sky.
        under[k] = np.float32(0.72) + np.float32(0.28) * nz
    for k in range(n):
        t = min(best[k], _END)
        rise = (pz + dz[k] * t) * steep
        bark_at[k] = _texel(texel_u[k], texel_v[k], _mip(fine_bits[k]))
        shade_at[k] = _texel(
            np.int32((px + dx[k] * t - sx * rise + SHIFT) * DAPPLE_TEXELS),
            np.int32((py + dy[k] * t - sy * rise + SHIFT) * DAPPLE_TEXELS),
            _mip(coarse_bits[k]),
        )


@njit(nogil=True, cache=True, error_model="numpy", fastmath=_FAST)
def light_bark(prim, place, who, number, dapple, rank, sunny, under, gain):  # type: ignore[no-untyped-def]
    """Set the gain (3,n) where `who` is `place`; sunny, under: of `bark_places`, rank: leaves."""
    for k in range(who.shape[0]):
        lit = (np.float32(rank[k]) - np.float32(128)) * np.float32(0.02) + np.float32(0.5)
        sunny[k] *= _ONE - dapple * (_ONE - min(max(lit, _ZERO), _ONE))
    for c in range(3):
        around, straight = number[AMBIENT + c] * prim[TINT + c], number[DIRECT + c] * prim[TINT + c]
        own = gain[c]
        for k in range(who.shape[0]):
            own[k] = around * under[k] + straight * sunny[k] if who[k] == place else own[k]


@njit(nogil=True, cache=True, error_model="numpy", fastmath=_FAST)
def clarity(best, thin, clear):  # type: ignore[no-untyped-def]
    """Set how clear (n,) the air is as far as `best`; thin: eighths of it lost per metre."""
    for k in range(best.shape[0]):
        # (1 − x/8)^8 is close to exp(−x), and SIMD.
        left = max(_ONE - min(best[k], _END) * thin, _ZERO)
        left *= left
        left *= left
        clear[k] = left * left


@njit(nogil=True, cache=True, error_model="numpy", fastmath=_FAST)
def mix(found, gain, clear, number):  # type: ignore[no-untyped-def]
    """Make colours found (n,), packed, what the camera gets: times gain (3,n), and with haze."""
    haze_b, haze_g, haze_r = number[HAZE], number[HAZE + 1], number[HAZE + 2]
    gain_b, gain_g, gain_r = gain[0], gain[1], gain[2]
    for k in range(found.shape[0]):
        c, left = found[k], clear[k]
        mist = _ONE - left
        b = np.float32(np.int32(c & np.uint32(255))) * gain_b[k] * left + haze_b * mist
        g = np.float32(np.int32(c >> np.uint32(8) & np.uint32(255))) * gain_g[k] * left
        r = np.float32(np.int32(c >> np.uint32(16))) * gain_r[k] * left
        blue, green = np.int32(min(b, _MAX)), np.int32(min(g + haze_g * mist, _MAX))
        red = np.int32(min(r + haze_r * mist, _MAX))
        found[k] = np.uint32(red << np.int32(16) | green << np.int32(8) | blue)
