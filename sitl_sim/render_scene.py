"""Compiled kernels of the static scene: ground, sky, trunks and boxes, O(1) per pixel.

A vertical cylinder covers an interval of azimuths, and in each azimuth an interval of slopes
(rise over horizontal run). So once per frame every trunk is written into a table over azimuth
bins: the nearest surface, its texture coordinate and colour; a taller trunk behind a shorter one
becomes a second layer. A pixel then needs one division to find its bin and one comparison to know
what it sees. Azimuth and elevation are "diamond" angles, y / (|x| + |y|): monotonic in the true
angle and free of trigonometry.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sitl_sim.fisheye import Float32, Float64
from sitl_sim.textures import HUES, LEVELS, SKY_SHAPE, TILE

BINS = 4096  # azimuth bins: 0.06°–0.11° each, a quarter of a pixel at 640 px
LAYERS = 4
# Fields of the azimuth table.
S_FOOT, S_TOP, S_CAP, T_IN, U, LEVEL, B, G, R, FOG_B, FOG_G, FOG_R, HEIGHT = range(13)
FIELDS = 13
EBINS = 512  # elevation bins of the ground table, horizon … nadir

SKY_ROWS, SKY_COLS = SKY_SHAPE
GROUND_TEXELS = np.float32(110.0)  # texels per metre
BARK_TEXELS = np.float32(240.0)
WALL_TEXELS = np.float32(128.0)
FOG_RANGE = 70.0  # m, distance of 1/e contrast
T_MAX = np.float32(400.0)  # m, ground beyond is all haze
SHIFT = np.float32(2048.0)  # m, keeps texture coordinates positive
ONE, HALF, TINY, ZERO = np.float32(1), np.float32(0.5), np.float32(1e-9), np.float32(0)
FAR = np.float32(np.inf)
_BYTE, _LOW = np.uintp(8), np.uintp(255)

_OFFSETS = np.array([sum((TILE >> i) ** 2 for i in range(l)) for l in range(LEVELS)], np.int32)
_LOG_TILE, _WRAP = np.int32(math.log2(TILE)), np.int32(TILE - 1)
_QUARTER = np.float32(BINS / 4)
# Unsigned, as every index that cannot be negative: negative ones would count from the end.
_BINS_PER_SKY, _ROWS_PER_SKY = np.uintp(BINS // SKY_COLS), np.uintp(EBINS // SKY_ROWS)


@njit(inline="always", error_model="numpy")
def diamond(x, y):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Diamond angle of (x, y) in [−2, 2], growing with atan2(y, x)."""
    a = y / (abs(x) + abs(y) + TINY)
    if x < ZERO:
        return (np.float32(2) if y >= ZERO else np.float32(-2)) - a
    return a


@njit(inline="always", error_model="numpy")
def mip(footprint):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Mip level for a pixel footprint in finest texels."""
    level = np.int32(0)
    while footprint > 1.5 and level < LEVELS - 1:
        footprint *= 0.5
        level += np.int32(1)
    return level


@njit(inline="always", error_model="numpy")
def texel(u, v, level):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Index into a mip pyramid of finest-level int32 coordinates (wrapped)."""
    x = (u & _WRAP) >> level
    y = (v & _WRAP) >> level
    return np.uintp(_OFFSETS[np.uintp(level)] + (y << (_LOG_TILE - level)) + x)


@njit(nogil=True, cache=True, error_model="numpy")
def trunk_table(  # type: ignore[no-untyped-def]  # noqa: ANN201
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
            first = int((low + 2.0) * _QUARTER)
            last = int((high + 2.0) * _QUARTER)
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
            row[S_FOOT] = -p[2] / t_in
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
def ground_table(height: float, pixel_angle: float, table: Float32):  # type: ignore[no-untyped-def]  # noqa: ANN201
    """(2,EBINS) mip level and clarity of the ground by diamond elevation, horizon first."""
    for i in range(EBINS):
        e = (i + 0.5) / EBINS
        t = height * (1 - e) / e
        r = math.sqrt(t * t + height * height)
        # Between the long (r²/z) and the short (r) side of the footprint: sharp, little shimmer.
        side = r * pixel_angle * (r / height) ** 0.6
        table[0, i] = mip(side * GROUND_TEXELS)
        table[1, i] = math.exp(-r / FOG_RANGE)


@njit(nogil=True, cache=True, error_model="numpy")
def box_lists(p: Float64, boxes: Float64, start, which):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Which boxes (n,6: min, max) each azimuth bin can see: which[start[b]:start[b+1]]."""
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
        spans[i, 0] = int(np.floor((middle + low + 2.0) * _QUARTER)) - 1
        spans[i, 1] = int(np.floor((middle + high + 2.0) * _QUARTER)) + 1
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


@njit(inline="always", error_model="numpy")
def hit_box(px, py, pz, dx, dy, dz, boxes, start, which, b):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Nearest box on the ray (d need not be a unit vector): parameter t, box and face axis."""
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
def scene_range(px, py, pz, dx, dy, dz, table, count, boxes, start, which):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Distance [m] along the world ray d to the first surface of the static scene; inf: sky."""
    rho = math.sqrt(dx * dx + dy * dy) + TINY
    s = dz / rho
    b = min(int((diamond(dx, dy) + np.float32(2)) * _QUARTER), BINS - 1)
    norm = math.sqrt(rho * rho + dz * dz)
    t = FAR
    if s < ZERO:
        t = -pz / s
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


@njit(nogil=True, cache=True, error_model="numpy")
def front_trunks(table, count):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """The azimuth table's nearest layer, packed small for the pixel loop.

    Returns near (BINS,) distance, inf: none; top, upper (BINS,) slope of its front edge, and of
    whatever else stands there; stem, level (BINS,) its column in the bark's pyramid; shade
    (BINS,6) gain and fog.
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
            stem[b] = texel(np.int32(table[0, b, U]), np.int32(0), level[b])
            shade[b] = table[0, b, B : B + 6]
    return near, top, upper, stem, level, shade


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def paint(  # type: ignore[no-untyped-def]  # noqa: ANN201
    rays, rot, p, table, count, elevations, boxes, start, which,  # noqa: ANN001
    ground, palette, macro, macro_frame, bark, wall, sky, haze, pixel_angle, out,  # noqa: ANN001
):  # fmt: skip
    """Colour every pixel of the static scene.

    rays: (3,h,w) camera frame. rot: (3,3) camera → world. p: (3,) camera, world [m]. elevations:
    (2,EBINS) of `ground_table`. ground, macro: hue << 8 | brightness. palette: (HUES × 256,)
    and sky: BGR as red << 16 | green << 8 | blue. macro_frame: (3,) x and y origin [m], texels
    per metre. out: (h,w,3) uint8 BGR.

    A row is painted in passes, and textures are packed: a pixel costs one look-up in each, and
    what is between the look-ups becomes SIMD.
    """
    h, w = rays.shape[1], rays.shape[2]
    px, py, pz = p[0], p[1], p[2]
    r00, r01, r02 = rot[0, 0], rot[0, 1], rot[0, 2]
    r10, r11, r12 = rot[1, 0], rot[1, 1], rot[1, 2]
    r20, r21, r22 = rot[2, 0], rot[2, 1], rot[2, 2]
    bins, row = np.empty(w, np.int32), np.empty(w, np.int32)
    slope, reach = np.empty(w, np.float32), np.empty(w, np.float32)
    east, north = np.empty(w, np.float32), np.empty(w, np.float32)
    texel_u, texel_v = np.empty(w, np.int32), np.empty(w, np.int32)
    texel_m = np.empty(w, np.int32)
    colour = np.empty(w, np.uint32)
    gain, mist = np.empty(w, np.float32), np.empty(w, np.float32)
    have_boxes = boxes.shape[0] > 0
    side = np.int32(macro.shape[0])
    last_macro = np.float32(macro.shape[0] - 1)
    light_of = macro.reshape(-1)
    mx, my, ms = macro_frame[0], macro_frame[1], macro_frame[2]
    levels, clears = elevations[0], elevations[1]
    haze_b, haze_g, haze_r = haze[0], haze[1], haze[2]
    near, top, upper, stem, bark_level, shade = front_trunks(table, count)
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
            bins[x] = np.int32(min((angle + np.float32(2)) * _QUARTER, np.float32(BINS - 1)))
            slope[x] = dz * inv
            elevation = abs(dz) / (rho + abs(dz))
            row[x] = np.int32(min(elevation * np.float32(EBINS), np.float32(EBINS - 1)))
            east[x] = dx * inv
            north[x] = dy * inv
            # Where the ray meets the ground; rays that do not are never asked for it.
            run = min(pz / max(-dz * inv, TINY), T_MAX)
            reach[x] = run
            gx, gy = px + dx * inv * run, py + dy * inv * run
            texel_u[x] = np.int32((gx + SHIFT) * GROUND_TEXELS)
            texel_v[x] = np.int32((gy + SHIFT) * GROUND_TEXELS)
            macro_u = np.int32(min(max((gx - mx) * ms, ZERO), last_macro))
            macro_v = np.int32(min(max((gy - my) * ms, ZERO), last_macro))
            texel_m[x] = macro_v * side + macro_u
        for x in range(w):
            b, s = np.uintp(bins[x]), slope[x]
            gain[x], mist[x] = ONE, ZERO
            if s < top[b] and near[b] < (reach[x] if s < ZERO else FAR):
                v = np.int32((pz + s * near[b] + SHIFT) * BARK_TEXELS)
                level = bark_level[b]
                light = np.float32(bark[stem[b] + texel(np.int32(0), v, level) - _OFFSETS[level]])
                blue = np.int32(min(light * shade[b, 0] + shade[b, 3], np.float32(255)))
                green = np.int32(min(light * shade[b, 1] + shade[b, 4], np.float32(255)))
                red = np.int32(min(light * shade[b, 2] + shade[b, 5], np.float32(255)))
                colour[x] = np.uint32(red << np.int32(16) | green << np.int32(8) | blue)
            elif s < ZERO:
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
        for x in range(w):  # what stands behind the nearest trunks and above them, and boxes
            b, s = bins[x], slope[x]
            boxed = have_boxes and start[b] < start[b + 1]
            if not boxed and (s >= upper[b] or s < top[b]):
                continue
            limit = FAR
            ground_t = FAR
            if s < ZERO:
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
