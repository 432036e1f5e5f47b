"""What a look draws once for each world: its sky down to the horizon, and its ground map."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sitl_sim.sensors.fisheye import Float64
from sitl_sim.sensors.looks.look import Light, Sky, WorldLook
from sitl_sim.sensors.looks.shapes import BOX, SPHERE
from sitl_sim.sensors.textures import SKY_SHAPE, fractal, packed

MAP = 768  # texels along a side of the ground map
OPAQUE = 5.0  # m, range of fog that hides the sky
_POOL = 8  # noise fields of each kind, made once per process


@lru_cache(maxsize=64)
def _field(beta: float, rows: int, columns: int, low: int, number: int) -> NDArray[np.float32]:
    rng = np.random.default_rng([0xF1E1D, number, rows])
    return fractal(rng, (rows, columns), beta, low).astype(np.float32)


def _pooled(rng: np.random.Generator, beta: float, shape: tuple[int, int], low: int = 1) -> Any:
    """Return noise (shape) from the pool, moved by the seed along its columns, maybe mirrored."""
    field = _field(beta, shape[0], shape[1], low, int(rng.integers(_POOL)))
    moved = np.roll(field, int(rng.integers(shape[1])), axis=1)
    return moved[:, ::-1] if rng.random() < 0.5 else moved


def sky(rng: np.random.Generator, look: Sky, light: Light, fog: float) -> NDArray[np.uint32]:
    """Return the sky (SKY_SHAPE) packed BGR by diamond elevation and azimuth; fog: m."""
    rows, cols = SKY_SHAPE
    if fog < OPAQUE:
        even = np.zeros((rows, cols, 3)) + look.haze
        return packed(np.clip(even, 0, 255).astype(np.uint8)).astype(np.uint32)
    e = (np.arange(rows, dtype=np.float32)[:, None] + 0.5) / rows  # 0 horizon … 1 zenith
    elevation = np.arctan2(e, 1 - e)
    degrees = np.degrees(elevation)
    up = np.clip(degrees / 60, 0, 1)[..., None] ** rng.uniform(0.4, 0.8)
    colour = look.haze * (1 - up) + look.zenith * up + np.zeros((rows, cols, 1))
    away = _angle_to(light.sun, elevation, cols)
    if look.kind != "overcast":
        warm = np.array([0.55, 0.8, 1.0]) if look.kind == "dusk" else np.array([0.9, 0.97, 1.0])
        glow = 60 * np.exp(-away / 0.25) + 30 * np.exp(-away / 0.7)
        colour = colour + glow[..., None] * warm
    cover = {"clear": 1.4, "cloudy": 0.0, "overcast": -1.2, "dusk": 0.4}[look.kind]
    clouds = _pooled(rng, 1.7, (2 * rows, cols), 4)[:rows] + 0.3 * _pooled(rng, 1.0, (rows, cols))
    dense = np.clip((clouds - cover - rng.uniform(-0.4, 0.4)) / 1.4, 0, 1)
    # Clouds thin out at the zenith, where the map's columns crowd together.
    dense = dense * np.clip((88 - degrees) / 30, 0, 1) * np.clip(degrees / 6, 0.2, 1)
    bright = light.ambient * 130 + light.direct * 130
    cloud = np.clip(bright * (0.85 + 0.12 * _pooled(rng, 1.4, (rows, cols), 2)[..., None]), 30, 250)
    colour = colour * (1 - dense[..., None]) + cloud * dense[..., None]
    if look.kind in ("clear", "dusk"):
        colour = np.where((away < 0.03)[..., None], 255.0, colour)
    colour = _horizon(rng, look, light, degrees, colour)
    result: NDArray[np.uint32] = packed(np.clip(colour, 0, 255).astype(np.uint8))
    return result


def _angle_to(sun: Float64, elevation: Any, cols: int) -> Any:
    a = (np.arange(cols) + 0.5) * 4 / cols - 2
    x, y = 1 - np.abs(a), np.where(np.abs(a) <= 1, a, np.copysign(2 - np.abs(a), a))
    length = np.hypot(x, y)
    across = (sun[0] * x + sun[1] * y) / length
    return np.arccos(np.clip(np.cos(elevation) * across + np.sin(elevation) * sun[2], -1, 1))


def _horizon(
    rng: np.random.Generator, look: Sky, light: Light, degrees: Any, colour: Any
) -> NDArray[np.float64]:
    """Draw what stands on the horizon: tree lines, hills or houses, two rows of them."""
    if look.horizon == "none":
        return np.asarray(colour, float)
    rows, cols = SKY_SHAPE
    lit = light.ambient + 0.5 * light.direct
    for depth in range(2):
        ridge = _pooled(rng, 1.2, (2, cols), 2)[0]
        tint = (0.75, 0.45)[depth] * rng.uniform(0.7, 1.2)
        if look.horizon == "forest":
            crowns = np.abs(_pooled(rng, 0.45, (2, cols), 40)[0])
            top = rng.uniform(2, 9) + 1.2 * ridge + rng.uniform(0.4, 1.6) * crowns
            own = np.array([50.0, 80, 62]) * np.exp(rng.normal(0, 0.25, 3))
        elif look.horizon == "hills":
            top = rng.uniform(1, 7) + 1.6 * ridge
            own = np.array([92.0, 108, 96]) * np.exp(rng.normal(0, 0.25, 3))
        else:
            blocks = rng.integers(12, 60)
            heights = rng.uniform(0, 11, blocks) * (rng.random(blocks) < 0.7)
            top = np.repeat(heights, -(-cols // blocks))[:cols]
            own = np.array([120.0, 124, 130]) * np.exp(rng.normal(0, 0.25, 3))
        there = np.clip((top[None] - degrees) / 0.25, 0, 1)[..., None]
        texture = 1 + 0.12 * _pooled(rng, 0.6, (rows, cols), 20)[..., None]
        if look.horizon == "city":
            columns, floors = np.arange(cols)[None] // 3, (degrees * 1.7).astype(int)
            texture = texture * np.where((columns + floors) % 2 == 0, 0.78, 1.05)[..., None]
        tinted = own * lit * texture * (1 - tint) + look.haze * tint
        colour = colour * (1 - there) + tinted * there
    return np.asarray(colour, float)


def ground_map(
    rng: np.random.Generator, rows: Float64, look: WorldLook, origin: Float64, size: float
) -> NDArray[np.uint16]:
    """Return light and share of the second ground (MAP,MAP) of the square at `origin` [m].

    share << 8 | light. Shapes (`Shapes.rows`) cast shadows away from the sun, and darken their
    feet.
    """
    scale = MAP / size
    shade = np.full((MAP, MAP), 255, np.uint8)
    feet = np.full((MAP, MAP), 255, np.uint8)
    sun = look.light.sun
    away = -sun[:2] / max(float(sun[2]), 0.06)  # m along the ground for each metre of height
    for row in rows:
        a, b, radius = row[1:4], row[4:7], row[7]
        low, high = (a[2], b[2]) if row[0] != SPHERE else (a[2] - radius, a[2] + radius)
        if row[0] == BOX:
            corners = np.array([[x, y] for x in (a[0], b[0]) for y in (a[1], b[1])])
            radius = 0.0
            ground = np.concatenate([corners + away * max(low, 0.0), corners + away * high])
        else:
            side = radius * np.array([[1, 0], [0.7, 0.7], [0, 1], [-0.7, 0.7]])
            ring = np.concatenate([side, -side])
            ends = (a[:2] + away * max(low, 0.0), b[:2] + away * min(high, 30.0))
            ground = np.concatenate([ends[0] + ring, ends[1] + ring])
        pixels = ((ground - origin) * scale)[:, None].astype(np.float32)
        outline = cv2.convexHull(pixels)
        points = np.round(np.clip(outline, -8000, 8000) * 16).astype(np.int32)
        cv2.fillConvexPoly(shade, points, 60, cv2.LINE_AA, 4)
        if row[0] != BOX and low <= 0.3:
            place = np.round((a[:2] - origin) * scale * 16).astype(int)
            ring_r = round((radius + 0.15) * scale * 16)
            at = (int(place[0]), int(place[1]))
            if max(map(abs, at)) < 1 << 20:
                cv2.circle(feet, at, ring_r, 140, -1, cv2.LINE_AA, 4)
    light = cv2.GaussianBlur(shade, (0, 0), 0.10 * scale).astype(np.float32)
    light *= cv2.GaussianBlur(feet, (0, 0), 0.15 * scale).astype(np.float32) / 255
    patches = _pooled(rng, 1.6, (MAP, MAP))
    light = np.clip(light * (0.9 + 0.08 * patches), 0, 255).astype(np.uint16)
    rough = _pooled(rng, 1.3, (MAP, MAP), 3) + 0.25 * _pooled(rng, 0.3, (MAP, MAP), 60)
    edge = np.quantile(rough[::7, ::7], 1 - min(look.patch, 1.0)) if look.patch > 0.01 else np.inf
    share = np.clip(128 + 60 * (rough - edge), 0, 255).astype(np.uint16)
    return np.ascontiguousarray(share << 8 | light)
