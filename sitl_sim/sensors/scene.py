"""Compiled kernels of the static scene: ground, sky, trunks and boxes, O(1) per pixel.

With the tables of `tables` a pixel needs one division to find its azimuth bin and one
comparison to know what it sees.
"""

# ruff: noqa: ANN001, ANN201 - numba infers the types of a kernel's arguments
from __future__ import annotations

import math

import numpy as np
from numba import njit

from sitl_sim.sensors.tables import (
    BARK_TEXELS,
    BINS,
    EBINS,
    FAR,
    FOG_B,
    FOG_G,
    FOG_R,
    FOG_RANGE,
    GROUND_TEXELS,
    HEIGHT,
    LEVEL,
    ONE,
    QUARTER,
    S_CAP,
    S_TOP,
    T_IN,
    TINY,
    ZERO,
    B,
    G,
    R,
    U,
    diamond,
    front_trunks,
    mip,
    texel,
)
from sitl_sim.sensors.textures import HUES, SKY_SHAPE

WALL_TEXELS = np.float32(128.0)  # per metre
T_MAX = np.float32(400.0)  # m, ground beyond is all haze
SHIFT = np.float32(2048.0)  # m, keeps texture coordinates positive
# Unsigned, as every index that cannot be negative: negative ones would count from the end.
_BYTE, _LOW, _NEXT = np.uintp(8), np.uintp(255), np.uintp(1)
_ROWS_PER_SKY, _BINS_PER_SKY = np.uintp(EBINS // SKY_SHAPE[0]), np.uintp(BINS // SKY_SHAPE[1])


@njit(inline="always", error_model="numpy")
def hit_box(px, py, pz, dx, dy, dz, boxes, start, which, b):  # type: ignore[no-untyped-def]
    """Return parameter t, box and face axis of the nearest box on a ray (d: of any length)."""
    nearest, found, face = FAR, -1, 0
    ix = ONE / (dx if abs(dx) > TINY else TINY)
    iy = ONE / (dy if abs(dy) > TINY else TINY)
    iz = ONE / (dz if abs(dz) > TINY else TINY)
    for k in range(start[b], start[b + 1]):
        i = which[k]
        ax, bx = (boxes[i, 0] - px) * ix, (boxes[i, 3] - px) * ix
        ay, by = (boxes[i, 1] - py) * iy, (boxes[i, 4] - py) * iy
        az, bz = (boxes[i, 2] - pz) * iz, (boxes[i, 5] - pz) * iz
        x_in, y_in, z_in = min(ax, bx), min(ay, by), min(az, bz)
        t_in = max(x_in, y_in, z_in)
        t_out = min(max(ax, bx), max(ay, by), max(az, bz))
        if t_in < t_out and t_out > ZERO and t_in < nearest:
            nearest, found = max(t_in, ZERO), i
            face = 0 if t_in == x_in else (1 if t_in == y_in else 2)
    return nearest, found, face


@njit(nogil=True, cache=True, error_model="numpy")
def scene_range(px, py, pz, dx, dy, dz, hill, table, count, boxes, start, which):  # type: ignore[no-untyped-def]
    """Return the distance [m] along the world ray d to the first static surface; inf: sky.

    hill: (3,) of `paint`.
    """
    rho = math.sqrt(dx * dx + dy * dy) + TINY
    s = dz / rho
    b = min(int((diamond(dx, dy) + np.float32(2)) * QUARTER), BINS - 1)
    norm = math.sqrt(rho * rho + dz * dz)
    t = FAR
    falls = s - (hill[0] * dx + hill[1] * dy) / rho
    if falls < ZERO:
        t = -hill[2] / falls
    for layer in range(count[b]):
        if table[layer, b, T_IN] >= t:
            break
        if s < table[layer, b, S_TOP]:
            t = table[layer, b, T_IN]
            break
        if s < table[layer, b, S_CAP]:
            t = (table[layer, b, HEIGHT] - pz) / s
            break
    distance = t * norm / rho
    if boxes.shape[0] > 0:
        near, found, _ = hit_box(px, py, pz, dx, dy, dz, boxes, start, which, b)
        if found >= 0:
            distance = min(distance, near * norm)
    return distance


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def paint(  # type: ignore[no-untyped-def]
    rays,
    rot,
    p,
    table,
    count,
    elevations,
    hill,
    boxes,
    start,
    which,
    ground,
    palette,
    macro,
    macro_frame,
    bark,
    wall,
    sky,
    haze,
    pixel_angle,
    out,
):
    """Colour every pixel of the static scene.

    rays: (3,h,w) camera frame. rot: (3,3) camera → world. p: (3,) camera, world [m]. hill: (3,)
    slope of the ground towards east and north (rise/run), and height [m] of the camera over it.
    elevations: (2,EBINS) of `ground_table`. ground, macro: hue << 8 | brightness. palette:
    (HUES × 256,) and sky: BGR as red << 16 | green << 8 | blue. macro_frame: (3,) x and y origin
    [m], texels per metre. out: (h,w,3) uint8 BGR.

    A row is painted in passes, and textures are packed: a pixel costs one look-up in each, and
    what is between the look-ups becomes SIMD.
    """
    h, w = rays.shape[1], rays.shape[2]
    px, py, pz = p[0], p[1], p[2]
    hill_east, hill_north, above = hill[0], hill[1], hill[2]
    r00, r01, r02 = rot[0, 0], rot[0, 1], rot[0, 2]
    r10, r11, r12 = rot[1, 0], rot[1, 1], rot[1, 2]
    r20, r21, r22 = rot[2, 0], rot[2, 1], rot[2, 2]
    bins, row = np.empty(w, np.int32), np.empty(w, np.int32)
    slope, reach = np.empty(w, np.float32), np.empty(w, np.float32)
    falls = np.empty(w, np.float32)  # slope of the ray against the ground's; negative: it meets it
    east, north = np.empty(w, np.float32), np.empty(w, np.float32)
    texel_u, texel_v = np.empty(w, np.int32), np.empty(w, np.int32)
    texel_m = np.empty(w, np.int32)
    colour = np.empty(w, np.uint32)
    rest = np.empty(w + 1, np.int32)  # columns that show more than the nearest trunks
    gain, mist = np.empty(w, np.float32), np.empty(w, np.float32)
    have_boxes = boxes.shape[0] > 0
    side = np.int32(macro.shape[0])
    last_macro = np.float32(macro.shape[0] - 1)
    light_of = macro.reshape(-1)
    mx, my, ms = macro_frame[0], macro_frame[1], macro_frame[2]
    levels, clears = elevations[0], elevations[1]
    haze_b, haze_g, haze_r = haze[0], haze[1], haze[2]
    near, top, upper, stem, bark_level, shade = front_trunks(table, count)
    layered = have_boxes or np.any(upper > top)  # some pixel shows more than the nearest trunk
    for y in range(h):
        for x in range(w):  # no branches: the compiler makes this loop SIMD
            a, b_, c_ = rays[0, y, x], rays[1, y, x], rays[2, y, x]
            dx = r00 * a + r01 * b_ + r02 * c_
            dy = r10 * a + r11 * b_ + r12 * c_
            dz = r20 * a + r21 * b_ + r22 * c_
            rho = np.sqrt(dx * dx + dy * dy) + TINY
            inv = ONE / rho
            t = dy / (abs(dx) + abs(dy) + TINY)
            back = (np.float32(2) if dy >= ZERO else np.float32(-2)) - t
            angle = back if dx < ZERO else t
            bins[x] = np.int32(min((angle + np.float32(2)) * QUARTER, np.float32(BINS - 1)))
            slope[x] = dz * inv
            down = dz - (hill_east * dx + hill_north * dy)
            falls[x] = down * inv
            elevation = abs(down) / (rho + abs(down))
            row[x] = np.int32(min(elevation * np.float32(EBINS), np.float32(EBINS - 1)))
            east[x] = dx * inv
            north[x] = dy * inv
            # Where the ray meets the ground; rays that do not are never asked for it.
            run = min(above / max(-down * inv, TINY), T_MAX)
            reach[x] = run
            gx, gy = px + dx * inv * run, py + dy * inv * run
            texel_u[x] = np.int32((gx + SHIFT) * GROUND_TEXELS)
            texel_v[x] = np.int32((gy + SHIFT) * GROUND_TEXELS)
            macro_u = np.int32(min(max((gx - mx) * ms, ZERO), last_macro))
            macro_v = np.int32(min(max((gy - my) * ms, ZERO), last_macro))
            texel_m[x] = macro_v * side + macro_u
        rests = np.int64(0)
        for x in range(w):
            b, s = np.uintp(bins[x]), slope[x]
            gain[x], mist[x] = ONE, ZERO
            if layered:
                rest[rests] = np.int32(x)  # counted without a branch, or written over
                boxed = have_boxes and start[b] < start[b + _NEXT]
                rests += np.int64(boxed or top[b] <= s < upper[b])
            if s < top[b] and near[b] < (reach[x] if falls[x] < ZERO else FAR):
                v = np.int32((pz + s * near[b] + SHIFT) * BARK_TEXELS)
                light = np.float32(bark[stem[b] + texel(np.int32(0), v, bark_level[b])])
                blue = np.int32(min(light * shade[b, 0] + shade[b, 3], np.float32(255)))
                green = np.int32(min(light * shade[b, 1] + shade[b, 4], np.float32(255)))
                red = np.int32(min(light * shade[b, 2] + shade[b, 5], np.float32(255)))
                colour[x] = np.uint32(red << np.int32(16) | green << np.int32(8) | blue)
            elif falls[x] < ZERO:
                e = np.uintp(row[x])
                leaf = np.uintp(ground[texel(texel_u[x], texel_v[x], np.int32(levels[e]))])
                lit = np.uintp(light_of[np.uintp(texel_m[x])])
                hue = min((leaf >> _BYTE) + (lit >> _BYTE), np.uintp(HUES - 1))
                colour[x] = palette[(hue << _BYTE) + (leaf & _LOW)]
                gain[x] = np.float32(np.int32(lit & _LOW)) * np.float32(1 / 230) * clears[e]
                mist[x] = ONE - clears[e]
            else:
                colour[x] = sky[np.uintp(row[x]) // _ROWS_PER_SKY, b // _BINS_PER_SKY]
        line = out[y].reshape(-1)
        for x in range(w):
            c = colour[x]
            blue_ = np.float32(np.int32(c & np.uint32(255)))
            green_ = np.float32(np.int32(c >> np.uint32(8) & np.uint32(255)))
            red_ = np.float32(np.int32(c >> np.uint32(16)))
            line[3 * x] = np.int32(min(blue_ * gain[x] + haze_b * mist[x], np.float32(255)))
            line[3 * x + 1] = np.int32(min(green_ * gain[x] + haze_g * mist[x], np.float32(255)))
            line[3 * x + 2] = np.int32(min(red_ * gain[x] + haze_r * mist[x], np.float32(255)))
        for n in range(rests):  # trunks behind and above the nearest ones, and boxes
            x = int(rest[n])
            b, s = bins[x], slope[x]
            boxed = have_boxes and start[b] < start[b + 1]
            limit = FAR
            ground_t = FAR
            if falls[x] < ZERO:
                ground_t = reach[x]
            kind = 0
            layer = 0
            for layer in range(count[b]):
                if table[layer, b, T_IN] >= ground_t:
                    break
                if s < table[layer, b, S_TOP]:
                    kind, limit = 1, table[layer, b, T_IN]
                    break
                if s < table[layer, b, S_CAP]:
                    kind, limit = 2, (table[layer, b, HEIGHT] - pz) / s
                    break
            if boxed:
                if kind == 0:
                    limit = ground_t
                dx, dy = east[x], north[x]
                t, i, face = hit_box(px, py, pz, dx, dy, s, boxes, start, which, b)
                if i >= 0 and t < limit:
                    hx, hy, hz = px + dx * t + SHIFT, py + dy * t + SHIFT, pz + s * t + SHIFT
                    tu, tv, cosine, light = hx, hz, abs(dy), np.float32(0.78)
                    if face == 0:
                        tu, cosine, light = hy, abs(dx), np.float32(0.92)
                    elif face == 2:
                        tv, cosine = hy, abs(s)
                        light = np.float32(1.05) if s < ZERO else np.float32(0.5)
                    level = mip(t * pixel_angle * WALL_TEXELS / math.sqrt(max(cosine, 0.1)))
                    u, v = np.int32(tu * WALL_TEXELS), np.int32(tv * WALL_TEXELS)
                    value = wall[texel(u, v, level)]
                    clear = np.float32(math.exp(-t / FOG_RANGE))
                    bright = np.float32(value) * light * clear
                    out[y, x, 0] = int(bright * np.float32(0.80) + haze[0] * (ONE - clear))
                    out[y, x, 1] = int(bright * np.float32(0.88) + haze[1] * (ONE - clear))
                    out[y, x, 2] = int(bright + haze[2] * (ONE - clear))
                    continue
            if kind > 0:
                v, level = pz + s * table[layer, b, T_IN] + SHIFT, np.int32(table[layer, b, LEVEL])
                sawn = ONE
                if kind == 2:  # the sawn top: lighter wood
                    v, sawn = py + north[x] * limit + SHIFT, np.float32(1.35)
                value = bark[texel(np.int32(table[layer, b, U]), np.int32(v * BARK_TEXELS), level)]
                light = np.float32(value) * sawn
                out[y, x, 0] = int(
                    min(light * table[layer, b, B] + table[layer, b, FOG_B], np.float32(255))
                )
                out[y, x, 1] = int(
                    min(light * table[layer, b, G] + table[layer, b, FOG_G], np.float32(255))
                )
                out[y, x, 2] = int(
                    min(light * table[layer, b, R] + table[layer, b, FOG_R], np.float32(255))
                )
