"""Seeded textures of the rendered world: ground, bark, wall, sky, and light on the ground.

All are built once. Tiling textures are stored with their mip levels, one after another, so that a
kernel picks a level by distance and never samples finer than a pixel.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sitl_sim.sensors.fisheye import Float32, Float64

UInt8 = NDArray[np.uint8]

TILE = 512  # texels along a side of the finest level
LEVELS = 10
HUES = 32  # columns of the ground palette: 0 = dry litter … 31 = moss
SKY_SHAPE = (256, 1024)  # bins of elevation (diamond, horizon … zenith) and of azimuth


def fractal(rng: np.random.Generator, shape: tuple[int, int], beta: float, low: int = 1) -> Float64:
    """Return periodic 1/f^beta noise of mean 0 and variance 1, without less than `low` cycles."""
    fy = np.fft.fftfreq(shape[0], 1 / shape[0])[:, None]
    fx = np.fft.rfftfreq(shape[1], 1 / shape[1])[None]
    f = np.hypot(fy, fx)
    spectrum = np.fft.rfft2(rng.standard_normal(shape)) * np.where(
        f >= low, np.maximum(f, 1) ** (-beta), 0
    )
    noise = np.fft.irfft2(spectrum, s=shape)
    result: Float64 = (noise - noise.mean()) / noise.std()
    return result


def pyramid(texture: UInt8) -> UInt8:
    """Return all mip levels of (n,n,c), finest first, flat (Σ n²/4^l, c)."""
    levels = [texture.reshape(-1, texture.shape[2])]
    image = texture.astype(np.float32)
    for _ in range(LEVELS - 1):
        half = image.shape[0] // 2
        image = image.reshape(half, 2, half, 2, -1).mean(axis=(1, 3))
        levels.append(np.clip(image + 0.5, 0, 255).astype(np.uint8).reshape(-1, image.shape[2]))
    return np.ascontiguousarray(np.concatenate(levels))


def packed(channels: UInt8) -> NDArray[Any]:
    """Pack channels (…, c) → (…), channel 0 in the lowest byte; two: uint16, three: uint32."""
    shifted = (channels[..., c].astype(np.uint32) << 8 * c for c in range(channels.shape[-1]))
    kind = np.uint16 if channels.shape[-1] == 2 else np.uint32
    return np.ascontiguousarray(sum(shifted, start=np.uint32(0)).astype(kind))


def _to_byte(values: Float64) -> UInt8:
    return np.clip(values, 0, 255).astype(np.uint8)


def ground(rng: np.random.Generator) -> UInt8:
    """Return a forest floor of soil, leaves and twigs; two channels: brightness, hue index."""
    n = TILE
    bright = 118 + 20 * fractal(rng, (n, n), 1.0, 3) + 9 * rng.standard_normal((n, n))
    hue = 9 + 3.5 * fractal(rng, (n, n), 1.2, 4)
    layers = np.stack([bright, hue], axis=-1).astype(np.float32)
    # Each leaf's image is wrapped around the edges: the tile stays periodic.
    for index in range(2600):
        size = rng.uniform(2.5, 8.0)
        thin = rng.uniform(0.08, 0.18) if index % 9 == 0 else rng.uniform(0.35, 0.6)
        if index % 9 == 0:
            size *= 2.2
        angle = rng.uniform(0, 180)
        colour = (float(rng.normal(128, 34)), float(rng.uniform(0, 20)))
        cx, cy = rng.integers(0, n, 2)
        half = int(size) + 2
        stamp = np.zeros((2 * half + 1, 2 * half + 1), np.uint8)
        axes = (max(int(size), 1), max(int(size * thin), 1))
        cv2.ellipse(stamp, (half, half), axes, angle, 0, 360, 255, -1, cv2.LINE_AA)
        rows = (np.arange(-half, half + 1) + cy) % n
        cols = (np.arange(-half, half + 1) + cx) % n
        alpha = stamp[..., None].astype(np.float32) / 255 * 0.85
        patch = layers[np.ix_(rows, cols)]
        layers[np.ix_(rows, cols)] = patch * (1 - alpha) + np.array(colour, np.float32) * alpha
    layers[..., 1] = np.clip(layers[..., 1], 0, HUES - 1)
    return pyramid(_to_byte(layers.astype(float)))


def palette(rng: np.random.Generator) -> UInt8:
    """Return colours (HUES, 256, 3) BGR of each hue index and brightness of the ground."""
    stops = np.array([[46, 84, 122], [52, 96, 138], [58, 92, 118], [52, 98, 92], [48, 104, 78]])
    at = np.linspace(0, len(stops) - 1, HUES)
    base = np.stack([np.interp(at, np.arange(len(stops)), stops[:, c]) for c in range(3)], axis=-1)
    base += rng.normal(0, 1.5, base.shape)
    gain = np.arange(256)[None, :, None] / 118.0
    return _to_byte(base[:, None] * gain)


def bark(rng: np.random.Generator) -> UInt8:
    """Return bark with vertical furrows, one channel; rows: height, columns: arc length."""
    n = TILE
    stretched = cv2.resize(
        fractal(rng, (n // 8, n), 0.9, 6).astype(np.float32), (n, n), interpolation=cv2.INTER_CUBIC
    )
    furrows = np.minimum(np.abs(stretched) * 1.6, 1.4)
    value = 78 + 62 * furrows + 15 * fractal(rng, (n, n), 0.8, 3) + 18 * fractal(rng, (n, n), 2.0)
    return pyramid(_to_byte(value)[..., None])


def wall(rng: np.random.Generator) -> UInt8:
    """Return masonry, one channel: courses of bricks with mortar joints and stains."""
    n, rows, cols = TILE, 16, 8
    y, x = np.mgrid[0:n, 0:n]
    course = y * rows // n
    shifted = (x + (course % 2) * (n // cols // 2)) % n
    joint = ((y * rows) % n < 1.7 * rows) | ((shifted * cols) % n < 1.7 * cols)
    tone = rng.normal(150, 13, (rows, cols))[course, shifted * cols // n]
    tone += 9 * fractal(rng, (n, n), 0.7, 4) + 12 * fractal(rng, (n, n), 2.0)
    return pyramid(_to_byte(np.where(joint, 0.72 * tone, tone))[..., None])


def sky(rng: np.random.Generator, haze: Float32) -> UInt8:
    """Return a sky (SKY_SHAPE, 3) BGR by diamond elevation and azimuth, with a far tree line."""
    rows, cols = 2 * SKY_SHAPE[0], 2 * SKY_SHAPE[1]
    e = (np.arange(rows)[:, None] + 0.5) / rows  # 0 horizon … 1 zenith
    elevation = np.degrees(np.arctan2(e, 1 - e))
    up = np.clip(elevation / 60, 0, 1)[..., None] ** 0.6
    colour = np.array(haze)[None, None] * (1 - up) + np.array([214.0, 158, 104]) * up
    clouds = fractal(rng, (rows * 2, cols), 1.7, 4)[:rows] + 0.25 * fractal(rng, (rows, cols), 1.0)
    # Clouds thin out at the zenith, where the map's columns crowd together.
    cover = np.clip((clouds - 0.1) / 1.4, 0, 1) * np.clip((88 - elevation) / 30, 0, 1)
    cover *= np.clip(elevation / 6, 0, 1)
    colour = colour * (1 - cover[..., None]) + np.array([246.0, 246, 243]) * cover[..., None]
    ridge = fractal(rng, (2, cols), 1.1, 2)[0]
    crowns = np.abs(fractal(rng, (2, cols), 0.45, 40)[0])
    for depth, (height, tint) in enumerate(((4.6, 0.80), (3.0, 0.62))):
        top = height + 0.8 * np.roll(ridge, 333 * depth) + 0.7 * np.roll(crowns, 77 * depth)
        tree = np.clip((top[None] - elevation) / 0.25, 0, 1)[..., None]
        green = np.array([86.0, 112, 92]) * (1 - tint) + np.array(haze) * tint
        texture = 1 + 0.05 * fractal(rng, (rows, cols), 0.7, 20)[..., None]
        colour = colour * (1 - tree) + green * texture * tree
    small = cv2.resize(colour, SKY_SHAPE[::-1], interpolation=cv2.INTER_AREA)
    return _to_byte(np.asarray(small, float))


def ground_light(
    rng: np.random.Generator, cylinders: Float64, sun: Float64, origin: Float64, size: float, n: int
) -> UInt8:
    """Return light 0…255 and moss 0…HUES (n, n, 2) on the square [origin, origin + size]².

    The trunks (rows x, y, radius, height) cast shadows towards −sun and darken their feet.
    """
    scale = n / size
    shade = np.full((n, n), 255, np.uint8)
    length = np.hypot(*sun[:2])
    along = -sun[:2] / max(length, 1e-6)
    side = np.array([-along[1], along[0]])
    for x, y, radius, height in cylinders:
        reach = min(height, 40.0) * length / max(sun[2], 0.1)
        foot = np.array([x, y]) - origin
        corners = [foot + side * radius, foot - side * radius]
        corners += [c + along * reach for c in corners[::-1]]
        polygon = np.round(np.array(corners) * scale * 16).astype(np.int32)
        cv2.fillPoly(shade, [polygon], 165, cv2.LINE_AA, 4)
    blurred = cv2.GaussianBlur(shade, (0, 0), 0.12 * scale).astype(np.float32)
    foot_ring = np.full((n, n), 255, np.uint8)
    for x, y, radius, _ in cylinders:
        centre = np.round((np.array([x, y]) - origin) * scale).astype(int)
        cv2.circle(
            foot_ring, (int(centre[0]), int(centre[1])), int((radius + 0.12) * scale), 150, -1
        )
    blurred *= cv2.GaussianBlur(foot_ring, (0, 0), 0.15 * scale).astype(np.float32) / 255
    patches = 0.9 + 0.09 * fractal(rng, (n, n), 1.6)
    light = np.clip(blurred * patches, 0, 255)
    moss = np.clip(4 + 5.0 * fractal(rng, (n, n), 1.4), 0, HUES)
    return np.ascontiguousarray(np.stack([light, moss], axis=-1).astype(np.uint8))
