"""Drones in the picture: each a set of ellipsoids (hull, arms, motors, propellers, marker).

All parts are ellipsoids because one affine map takes a camera ray to the unit sphere: nine
multiplications and a square root per part and ray.
"""

# ruff: noqa: ANN001, ANN201, ANN202 - numba infers the types of a kernel's arguments
from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from sitl_sim.sensors.fisheye import Float32
from sitl_sim.sensors.scene import scene_range
from sitl_sim.sensors.tables import FOG_RANGE

# Fields of a part, world-independent: 3×3 body → unit sphere, centre, bounding radius, BGR,
# opacity, share of the light that does not depend on the surface's slope.
PART_FIELDS = 9 + 3 + 1 + 3 + 1 + 1
MAGENTA = (200.0, 20.0, 235.0)


@dataclass(frozen=True)
class Look:
    """Appearance of a drone.

    body, marker: BGR 0…255. marker_radius: of the saturated ball around the centre [m]; 0: none.
    """

    body: tuple[float, float, float] = (62.0, 60.0, 58.0)
    marker: tuple[float, float, float] = MAGENTA
    marker_radius: float = 0.10

    def parts(self, radius: float) -> Float32:
        """Return the parts (n, PART_FIELDS) of a drone whose propeller tips reach `radius` [m]."""
        k = radius / 0.2
        a, grey = 0.0955 * k, (70.0, 70.0, 72.0)
        dark = (self.body[0] * 0.55, self.body[1] * 0.55, self.body[2] * 0.55)
        rows = []
        if self.marker_radius > 0.0:
            m = self.marker_radius
            rows.append(_part((m, m, m), (0, 0, 0), 0, self.marker, 1.0, 0.55))
        rows.append(_part((0.115 * k, 0.05 * k, 0.034 * k), (0, 0, 0), 0, self.body, 1.0, 0.3))
        rows.append(_part((0.05 * k, 0.034 * k, 0.022 * k), (0, 0, 0.04 * k), 0, dark, 1.0, 0.3))
        for turn in (0.25 * math.pi, -0.25 * math.pi):
            arm = (0.15 * k, 0.013 * k, 0.008 * k)
            rows.append(_part(arm, (0, 0, 0), turn, self.body, 1.0, 0.3))
        for sx in (1, -1):
            for sy in (1, -1):
                x, y = sx * a, sy * a
                motor = (0.017 * k, 0.017 * k, 0.022 * k)
                rows.append(_part(motor, (x, y, 0.012 * k), 0, dark, 1.0, 0.3))
                disc = (0.0645 * k, 0.0645 * k, 0.006 * k)
                rows.append(_part(disc, (x, y, 0.032 * k), 0, grey, 0.38, 0.8))
        return np.array(rows, np.float32)


def _part(
    axes: tuple[float, float, float],
    centre: tuple[float, float, float],
    turn: float,
    colour: tuple[float, float, float],
    opacity: float,
    flat: float,
) -> list[float]:
    c, s = math.cos(turn), math.sin(turn)
    to_unit = np.diag(1 / np.array(axes)) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
    return [*to_unit.ravel(), *centre, max(axes), *colour, opacity, flat]


@njit(nogil=True, cache=True, error_model="numpy")
def _place(parts, p, r_wc, drone_p, r_wd, sun, f, lens, w, h):  # type: ignore[no-untyped-def]
    """Return each part's map of camera rays to the unit sphere, camera there, sun, pixel box."""
    n = parts.shape[0]
    maps = np.empty((n, 3, 3), np.float32)
    origins = np.empty((n, 4), np.float32)  # and |origin|² − 1
    suns = np.empty(3, np.float32)
    frames = np.empty((n, 4), np.int64)
    for c in range(3):
        suns[c] = r_wc[0, c] * sun[0] + r_wc[1, c] * sun[1] + r_wc[2, c] * sun[2]
    body_c = np.ascontiguousarray(r_wd.T) @ r_wc
    to_camera = np.ascontiguousarray(body_c.T)
    eye_b = np.ascontiguousarray(r_wd.T) @ (p - drone_p)
    for i in range(n):
        to_unit = parts[i, :9].astype(np.float64).reshape(3, 3)
        maps[i] = (to_unit @ body_c).astype(np.float32)
        offset = eye_b - parts[i, 9:12]
        eye = to_unit @ offset
        origins[i, :3] = eye.astype(np.float32)
        origins[i, 3] = np.sum(eye * eye) - 1.0
        centre_c = to_camera @ (-offset)
        x, y, z = centre_c[0], centre_c[1], centre_c[2]
        rho = math.sqrt(x * x + y * y)
        distance = math.sqrt(rho * rho + z * z)
        bound = parts[i, 12]
        if distance < bound * 1.2:
            frames[i, 0], frames[i, 1], frames[i, 2], frames[i, 3] = 0, 0, w, h
            continue
        theta = math.atan2(rho, z)
        angle = math.asin(bound / distance)
        t2 = theta * theta
        bent = theta * (1.0 + t2 * (lens[4] + t2 * (lens[5] + t2 * (lens[6] + t2 * lens[7]))))
        rho1 = max(rho, 1e-9)
        u, v = lens[2] + lens[0] * bent / rho1 * x, lens[3] + lens[1] * bent / rho1 * y
        # The lens stretches by θ / sin θ across the radius; worst over the part's sphere.
        worst = min(theta + angle, 2.6)
        size_u = size_v = f * angle * max(1.0, worst / max(math.sin(worst), 1e-3)) + 1.5
        if angle < 0.35:
            # First order: how far the ellipsoid reaches along the gradients of u and of v.
            rx, ry = (x / rho, y / rho) if rho > 1e-9 else (1.0, 0.0)
            stretch = theta / max(math.sin(theta), 1e-6) if theta > 1e-6 else 1.0
            co, si = math.cos(theta), math.sin(theta)
            reach_u = reach_v = 0.0
            gu = np.array([rx * rx * co + stretch * ry * ry, rx * ry * (co - stretch), -rx * si])
            gv = np.array([rx * ry * (co - stretch), ry * ry * co + stretch * rx * rx, -ry * si])
            gu, gv = to_unit @ (body_c @ gu), to_unit @ (body_c @ gv)
            for k in range(3):
                axis2 = 1.0 / np.sum(to_unit[k] ** 2)
                reach_u += (axis2 * gu[k]) ** 2
                reach_v += (axis2 * gv[k]) ** 2
            margin = f / distance * (1.0 + 1.2 * angle)
            size_u = min(size_u, math.sqrt(reach_u) * margin + 1.5)
            size_v = min(size_v, math.sqrt(reach_v) * margin + 1.5)
        frames[i, 0], frames[i, 1] = max(0, math.floor(u - size_u)), max(0, math.floor(v - size_v))
        frames[i, 2] = min(w, math.ceil(u + size_u) + 1)
        frames[i, 3] = min(h, math.ceil(v + size_v) + 1)
        if theta > 2.2:
            frames[i, 2] = frames[i, 0]
    return maps, origins, suns, frames


@njit(inline="always", error_model="numpy")
def _trace(dx, dy, dz, maps, origins, suns, parts, active, n_active, out):  # type: ignore[no-untyped-def]
    """Trace one ray (camera frame) through a drone's parts: out = B, G, R, opacity; the distance.

    The nearest opaque part hides the others; translucent discs (propellers) before it blend.
    """
    nearest, solid, is_solid = np.float32(np.inf), np.uintp(0), False
    veil_t, veil, veil_part = np.float32(np.inf), np.float32(0), np.uintp(0)
    is_veil = False
    for k in range(n_active):
        i = active[k]
        ux = maps[i, 0, 0] * dx + maps[i, 0, 1] * dy + maps[i, 0, 2] * dz
        uy = maps[i, 1, 0] * dx + maps[i, 1, 1] * dy + maps[i, 1, 2] * dz
        uz = maps[i, 2, 0] * dx + maps[i, 2, 1] * dy + maps[i, 2, 2] * dz
        a = ux * ux + uy * uy + uz * uz
        b = ux * origins[i, 0] + uy * origins[i, 1] + uz * origins[i, 2]
        c = origins[i, 3]
        root = b * b - a * c
        if root <= np.float32(0):
            continue
        t = (-b - math.sqrt(root)) / a
        if t <= np.float32(0):
            continue
        if parts[i, 16] >= np.float32(1):
            if t < nearest:
                nearest, solid, is_solid = t, i, True
        else:
            # The farther of two discs hidden by the nearer adds to the same veil.
            if t < veil_t:
                veil_t, veil_part, is_veil = t, i, True
            veil = veil + (np.float32(1) - veil) * parts[i, 16]
    if veil_t >= nearest:
        veil = np.float32(0)
    if not is_solid and not is_veil:
        out[3] = np.float32(0)
        return nearest
    out[0], out[1], out[2] = np.float32(0), np.float32(0), np.float32(0)
    out[3] = veil
    if is_solid:
        i = solid
        m = maps[i]
        ux = m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz
        uy = m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz
        uz = m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz
        ux = origins[i, 0] + nearest * ux
        uy = origins[i, 1] + nearest * uy
        uz = origins[i, 2] + nearest * uz
        nx = m[0, 0] * ux + m[1, 0] * uy + m[2, 0] * uz
        ny = m[0, 1] * ux + m[1, 1] * uy + m[2, 1] * uz
        nz = m[0, 2] * ux + m[1, 2] * uy + m[2, 2] * uz
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        sunny = max((nx * suns[0] + ny * suns[1] + nz * suns[2]) / length, np.float32(0))
        flat = parts[solid, 17]
        light = flat + (np.float32(1) - flat) * (np.float32(0.35) + np.float32(0.85) * sunny)
        for c in range(3):
            out[c] = light * parts[solid, 13 + c]
        out[3] = np.float32(1)
    if veil > np.float32(0):
        for c in range(3):
            if is_solid:
                out[c] = out[c] * (np.float32(1) - veil) + veil * parts[veil_part, 13 + c]
            else:
                out[c] = parts[veil_part, 13 + c]
    return min(nearest, veil_t)


@njit(nogil=True, cache=True, error_model="numpy")
def draw_drones(  # type: ignore[no-untyped-def]
    rays,
    p,
    r_wc,
    drones_p,
    drones_r,
    looks,
    parts_all,
    sun,
    haze,
    f,
    lens,
    hill,
    table,
    count,
    boxes,
    start,
    which,
    image,
    depth,
):
    """Composite drones into image (h,w,3), far to near, or into depth (h,w) if it has rows.

    f: largest px/rad. lens: (8,) fx, fy, cx, cy, k1…k4.
    hill: (3,) of `scene.paint`.
    drones_p (m,3), drones_r (m,3,3) body → world, looks (m,) row of parts_all (k,n,fields).
    """
    h, w = rays.shape[1], rays.shape[2]
    rot = r_wc.astype(np.float32)
    px, py, pz = np.float32(p[0]), np.float32(p[1]), np.float32(p[2])
    into_depth = depth.shape[0] > 0
    m = drones_p.shape[0]
    distance = np.empty(m)
    for j in range(m):
        distance[j] = np.sqrt(np.sum((drones_p[j] - p) ** 2))
    reach = 0.0  # rad, the farthest off the axis that a pixel looks
    for y in (0, h - 1):
        for x in (0, w - 1):
            ray = rays[:, y, x]
            reach = max(reach, math.acos(ray[2] / math.sqrt(np.sum(ray * ray))))
    rgba = np.zeros(4, np.float32)
    samples = np.array([-0.25, 0.25], np.float32)
    for j in np.argsort(-distance, kind="mergesort"):
        # Nearer than 5 cm is the drone that carries the camera.
        if distance[j] < 0.05 or distance[j] > 60.0:
            continue
        parts = parts_all[looks[j]]
        # A drone wholly outside the field of view costs no more than this.
        size = np.max(np.abs(parts[:, 9:12])) * 2.0 + np.max(parts[:, 12])
        ahead = np.sum(r_wc[:, 2] * (drones_p[j] - p)) / distance[j]
        if size < distance[j] and math.acos(ahead) - math.asin(size / distance[j]) > reach:
            continue
        maps, origins, suns, frames = _place(
            parts, p, r_wc, drones_p[j], drones_r[j], sun, f, lens, w, h
        )
        x0, y0 = frames[:, 0].min(), frames[:, 1].min()
        x1, y1 = frames[:, 2].max(), frames[:, 3].max()
        clear = np.float32(math.exp(-distance[j] / FOG_RANGE))
        # Far drones are small and need sub-pixel samples; near ones only cost time.
        ss = 2 if f * 0.4 / distance[j] < 45.0 and not into_depth else 1
        active = np.empty(parts.shape[0], np.uintp)
        row = np.empty(parts.shape[0], np.uintp)
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
                total_b = total_g = total_r = total_a = np.float32(0)
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
                        if rgba[3] <= np.float32(0):
                            continue
                        wx = rot[0, 0] * dx + rot[0, 1] * dy + rot[0, 2] * dz
                        wy = rot[1, 0] * dx + rot[1, 1] * dy + rot[1, 2] * dz
                        wz = rot[2, 0] * dx + rot[2, 1] * dy + rot[2, 2] * dz
                        wall = scene_range(
                            px, py, pz, wx, wy, wz, hill, table, count, boxes, start, which
                        )
                        if t > wall:
                            continue
                        if into_depth:
                            if rgba[3] > np.float32(0.99) and t < depth[y, x]:
                                depth[y, x] = t
                            continue
                        total_b += rgba[0] * rgba[3]
                        total_g += rgba[1] * rgba[3]
                        total_r += rgba[2] * rgba[3]
                        total_a += rgba[3]
                if total_a > np.float32(0):
                    n = np.float32(ss * ss)
                    back = np.float32(1) - total_a / n
                    mist = (np.float32(1) - clear) * total_a / n
                    b = image[y, x, 0] * back + clear * total_b / n + haze[0] * mist
                    g = image[y, x, 1] * back + clear * total_g / n + haze[1] * mist
                    r = image[y, x, 2] * back + clear * total_r / n + haze[2] * mist
                    image[y, x, 0] = int(min(b, np.float32(255)))
                    image[y, x, 1] = int(min(g, np.float32(255)))
                    image[y, x, 2] = int(min(r, np.float32(255)))


def stack_parts(looks: list[Look], radius: float) -> Float32:
    """Return parts (k, n, PART_FIELDS), padded with parts of zero size that no ray can hit."""
    each = [look.parts(radius) for look in looks]
    n = max(len(parts) for parts in each)
    result = np.zeros((len(each), n, PART_FIELDS), np.float32)
    for row, parts in zip(result, each, strict=True):
        row[: len(parts)] = parts
        row[len(parts) :, :9] = np.eye(3, dtype=np.float32).ravel() * 1e6
    return result
