"""Texture tiles of ground, bark, leaves and walls, made once per process and coloured by palettes.

A tile is periodic, TILE × TILE, with two channels: brightness 0…255, and an index 0…31 that a
palette turns into a colour. Of leaves the second channel is a rank 0…255: a leaf is there where
its rank is below the cover. A tile depends on its kind and variant alone.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sitl_sim.sensors.fisheye import Float64
from sitl_sim.sensors.textures import HUES, TILE, fractal, packed, pyramid

VARIANTS = 6  # of each kind; a world takes one of them
_Rng = np.random.Generator
_Layers = NDArray[np.float32]  # (TILE, TILE, 2)


def _noise(rng: _Rng, beta: float, low: int = 1) -> Float64:
    return fractal(rng, (TILE, TILE), beta, low)


def _layers(bright: Any, index: Any) -> _Layers:
    return np.stack([bright, index], axis=-1).astype(np.float32)


def _stamp(layers: _Layers, x: int, y: int, mask: Any, value: tuple[float, float]) -> None:
    """Blend a mask (h,w) 0…255 of one value into the tile at x, y, wrapped around its edges."""
    h, w = mask.shape
    rows, cols = (np.arange(h) - h // 2 + y) % TILE, (np.arange(w) - w // 2 + x) % TILE
    patch, share = layers[np.ix_(rows, cols)], mask[..., None].astype(np.float32) / 255
    layers[np.ix_(rows, cols)] = patch * (1 - share) + np.array(value, np.float32) * share


def _ellipses(
    rng: _Rng,
    layers: _Layers,
    count: int,
    size: tuple[float, float],
    thin: tuple[float, float],
    value: Callable[[], tuple[float, float]],
    angle: tuple[float, float] = (0, 180),
) -> None:
    """Scatter ellipses (leaves, pebbles, blades) of half-length `size` [texels] over the tile."""
    for _ in range(count):
        long = rng.uniform(*size)
        half = int(long) + 2
        mask = np.zeros((2 * half + 1, 2 * half + 1), np.uint8)
        axes = (max(int(long), 1), max(round(long * rng.uniform(*thin)), 1))
        turn = float(rng.uniform(*angle))
        cv2.ellipse(mask, (half, half), axes, turn, 0, 360, 225, -1, cv2.LINE_AA)
        x, y = (int(k) for k in rng.integers(0, TILE, 2))
        _stamp(layers, x, y, mask, value())


def _cells(rng: _Rng, count: int, stretch: float = 1.0) -> tuple[Float64, Float64, NDArray[Any]]:
    """Return distances (TILE,TILE) [texels] to the nearest and second seed, and its number."""
    at = rng.uniform(0, TILE, (count, 2)) * [1.0, 1.0 / stretch]
    period = np.array([TILE, TILE / stretch])
    every = np.concatenate([at + period * [i, j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
    from scipy.spatial import cKDTree

    y, x = np.mgrid[0:TILE, 0:TILE]
    points = np.stack([x, y / stretch], axis=-1).reshape(-1, 2)
    away, who = cKDTree(every).query(points, k=2)
    shape = (TILE, TILE)
    return away[:, 0].reshape(shape), away[:, 1].reshape(shape), (who[:, 0] % count).reshape(shape)


def _litter(rng: _Rng) -> _Layers:
    layers = _layers(105 + 20 * _noise(rng, 1.0, 3), 9 + 4 * _noise(rng, 1.2, 4))
    _ellipses(
        rng, layers, 2200, (2.5, 8), (0.35, 0.6), lambda: (rng.normal(128, 38), rng.uniform(0, 26))
    )
    _ellipses(rng, layers, 200, (6, 22), (0.05, 0.1), lambda: (rng.normal(90, 30), 3))
    return layers


def _grass(rng: _Rng) -> _Layers:
    layers = _layers(80 + 14 * _noise(rng, 1.0, 3), 14 + 5 * _noise(rng, 1.3, 3))
    _ellipses(
        rng,
        layers,
        3800,
        (5, 15),
        (0.06, 0.14),
        lambda: (rng.normal(122, 36), rng.normal(14, 7)),
        (45, 135) if rng.random() < 0.5 else (0, 180),
    )
    return layers


def _asphalt(rng: _Rng) -> _Layers:
    bright = 112 + 15 * rng.standard_normal((TILE, TILE)) + 12 * _noise(rng, 1.8)
    layers = _layers(bright, 12 + 6 * _noise(rng, 1.6))
    near, second, _ = _cells(rng, int(rng.integers(4, 14)))
    crack = np.clip(1.6 - (second - near) + 1.2 * _noise(rng, 1.5, 8), 0, 1)
    layers[..., 0] -= (60 * crack * (rng.random() < 0.7)).astype(np.float32)
    _ellipses(rng, layers, 900, (1, 2.5), (0.6, 1), lambda: (rng.normal(135, 40), 20))
    return layers


def _sand(rng: _Rng) -> _Layers:
    y = np.mgrid[0:TILE, 0:TILE][0]
    waves = int(rng.integers(14, 34))
    ripple = np.sin(2 * np.pi * waves * y / TILE + 2.2 * _noise(rng, 1.8, 2))
    bright = 128 + rng.uniform(0, 16) * ripple + 8 * _noise(rng, 0.5, 4) + 7 * _noise(rng, 1.8)
    return _layers(bright, 15 + 5 * _noise(rng, 1.5))


def _snow(rng: _Rng) -> _Layers:
    bright = 128 + 7 * _noise(rng, 1.6, 2) + 3 * rng.standard_normal((TILE, TILE))
    layers = _layers(bright, 16 + 5 * _noise(rng, 1.6))
    _ellipses(
        rng, layers, int(rng.integers(0, 70)), (3, 12), (0.1, 0.4), lambda: (rng.uniform(50, 90), 2)
    )
    return layers


def _mud(rng: _Rng) -> _Layers:
    lumps = _noise(rng, 1.3, 3)
    bright = 112 + 24 * np.tanh(lumps) + 6 * rng.standard_normal((TILE, TILE))
    layers = _layers(bright, 10 + 5 * _noise(rng, 1.6))
    wet = np.clip((_noise(rng, 1.9) - 0.9) * 4, 0, 1)
    layers[..., 0] += (wet * (190 - layers[..., 0])).astype(np.float32)  # puddles mirror the sky
    layers[..., 1] += (wet * (31 - layers[..., 1])).astype(np.float32)
    return layers


def _field(rng: _Rng) -> _Layers:
    x = np.mgrid[0:TILE, 0:TILE][1]
    rows = np.sin(2 * np.pi * int(rng.integers(5, 12)) * x / TILE + 0.3 * _noise(rng, 1.6, 2))
    layers = _layers(110 + 32 * rows + 13 * _noise(rng, 0.8, 4), 10 + 6 * rows)
    _ellipses(
        rng, layers, 1400, (4, 11), (0.07, 0.15), lambda: (rng.normal(140, 35), rng.uniform(16, 31))
    )
    return layers


def _gravel(rng: _Rng) -> _Layers:
    near, second, who = _cells(rng, int(rng.integers(700, 2600)))
    tone = rng.normal(125, 30, 2600)[who]
    bright = tone * np.clip((second - near) / 4.0, 0.35, 1.0) + 6 * rng.standard_normal(who.shape)
    return _layers(bright, rng.uniform(0, 31, 2600)[who])


def _moss(rng: _Rng) -> _Layers:
    near, _, who = _cells(rng, 900)
    bright = 130 - 5 * near + rng.normal(0, 10, 900)[who] + 10 * _noise(rng, 0.6, 6)
    return _layers(bright, 15 + 7 * _noise(rng, 1.4, 2))


def _tiles(rng: _Rng) -> _Layers:
    return _courses(rng, int(rng.choice([4, 8, 16])), 0, rng.uniform(0.5, 1.3))


def _plain(rng: _Rng) -> _Layers:
    return _layers(128 + 4 * _noise(rng, 1.8), 15 + 3 * _noise(rng, 1.8))


def _courses(rng: _Rng, cols: int, shift: float, joint: float) -> _Layers:
    """Return stones or bricks with mortar joints and stains."""
    rows = cols if shift == 0 else 2 * cols
    y, x = np.mgrid[0:TILE, 0:TILE]
    course = y * rows // TILE
    moved = (x + (course % 2) * int(TILE / cols * shift)) % TILE
    line = ((y * rows) % TILE < 2 * rows) | ((moved * cols) % TILE < 2 * cols)
    tone = rng.normal(130, 16, (rows, cols))[course, moved * cols // TILE]
    tone = tone + 9 * _noise(rng, 0.7, 4) + 12 * _noise(rng, 2.0)
    index = rng.uniform(4, 28, (rows, cols))[course, moved * cols // TILE]
    return _layers(np.where(line, joint * tone, tone), index)


def _furrows(rng: _Rng) -> _Layers:
    """Return long vertical furrows (oak, poplar, spruce)."""
    squeeze = int(rng.choice([4, 8, 16]))
    ridges = cv2.resize(
        fractal(rng, (TILE // squeeze, TILE), 0.9, int(rng.integers(4, 9))).astype(np.float32),
        (TILE, TILE),
        interpolation=cv2.INTER_CUBIC,
    )
    depth = np.minimum(np.abs(ridges) * 1.6, 1.4)
    bright = 70 + rng.uniform(40, 75) * depth + 14 * _noise(rng, 0.8, 3) + 18 * _noise(rng, 2.0)
    return _layers(bright, 8 + 7 * depth + 5 * _noise(rng, 1.6))


def _plates(rng: _Rng) -> _Layers:
    """Return plates with dark cracks between them (pine)."""
    near, second, who = _cells(rng, int(rng.integers(90, 260)), rng.uniform(1.6, 3.5))
    crack = np.clip((second - near) / rng.uniform(3, 7), 0.25, 1.0)
    bright = (128 + rng.normal(0, 16, 260)[who] + 13 * _noise(rng, 0.8, 4)) * crack
    return _layers(bright, 12 + rng.normal(0, 5, 260)[who] + 8 * crack)


def _smooth(rng: _Rng) -> _Layers:
    """Return smooth bark with blotches (beech, plane)."""
    blotch = np.tanh(2.5 * _noise(rng, 1.6, 2))
    bright = 122 + 14 * blotch + 8 * _noise(rng, 0.9, 6) + 5 * rng.standard_normal((TILE, TILE))
    return _layers(bright, 15 + 11 * blotch)


def _birch(rng: _Rng) -> _Layers:
    """Return pale bark with dark level dashes and patches (birch)."""
    layers = _layers(158 + 10 * _noise(rng, 1.5, 2), 24 + 4 * _noise(rng, 1.4))
    dark = lambda: (rng.uniform(25, 95), rng.uniform(0, 8))  # noqa: E731
    _ellipses(rng, layers, int(rng.integers(120, 330)), (4, 26), (0.05, 0.14), dark, (-4, 4))
    _ellipses(rng, layers, int(rng.integers(4, 26)), (12, 45), (0.25, 0.8), dark, (-15, 15))
    return layers


def _mossy(rng: _Rng) -> _Layers:
    """Return furrowed bark with moss and lichen on it."""
    layers = _furrows(rng)
    moss = np.clip((_noise(rng, 1.7, 2) + rng.uniform(-0.6, 0.8)) * 2, 0, 1)[..., None]
    green = _layers(115 + 22 * _noise(rng, 0.7, 8), np.full((TILE, TILE), 29.0))
    return (layers * (1 - moss) + green * moss).astype(np.float32)


def _planks(rng: _Rng) -> _Layers:
    boards = int(rng.choice([4, 8, 16]))
    x = np.mgrid[0:TILE, 0:TILE][1]
    tone = rng.normal(128, 17, boards)[x * boards // TILE]
    grain = cv2.resize(fractal(rng, (TILE // 32, TILE), 0.8, 4).astype(np.float32), (TILE, TILE))
    bright = (tone + 12 * grain) * np.where((x * boards) % TILE < 2 * boards, 0.4, 1.0)
    return _layers(bright, 15 + 6 * grain)


def _stripes(rng: _Rng) -> _Layers:
    """Return level bands of two colours (painted poles, warning tape)."""
    y = np.mgrid[0:TILE, 0:TILE][0]
    band = (y * int(rng.choice([4, 8, 16])) // TILE) % 2
    return _layers(128 + 6 * _noise(rng, 1.5), np.where(band, 2.0, 29.0))


def _leaves(rng: _Rng) -> _Layers:
    """Return leaves: brightness, and rank 0…255 (uniform, so that a cover is a threshold)."""
    layers = _layers(60 + 10 * _noise(rng, 1.0, 3), 160 + 45 * _noise(rng, 1.2, 3))
    long = rng.uniform(4, 13)
    thin = (0.08, 0.2) if rng.random() < 0.35 else (0.35, 0.65)
    for part in range(4):  # later leaves lie in front: brighter, and of lower rank
        middle = 225 - 58 * part
        value = lambda m=middle, k=part: (  # noqa: E731
            rng.normal(82 + 22 * k, 24),
            rng.normal(m, 28),
        )
        _ellipses(rng, layers, 420, (0.6 * long, 1.5 * long), thin, value)
    order = layers[..., 1].ravel().argsort().argsort()
    layers[..., 1] = (order * (256 / order.size)).reshape(TILE, TILE)
    return layers


GROUNDS: dict[str, Callable[[_Rng], _Layers]] = {
    "litter": _litter,
    "grass": _grass,
    "asphalt": _asphalt,
    "sand": _sand,
    "snow": _snow,
    "mud": _mud,
    "field": _field,
    "gravel": _gravel,
    "moss": _moss,
    "paving": _tiles,
    "plain": _plain,
}
BARKS: dict[str, Callable[[_Rng], _Layers]] = {
    "furrows": _furrows,
    "plates": _plates,
    "smooth": _smooth,
    "birch": _birch,
    "mossy": _mossy,
    "planks": _planks,
    "stripes": _stripes,
    "plain": _plain,
}
WALLS: dict[str, Callable[[_Rng], _Layers]] = {
    "bricks": lambda rng: _courses(rng, int(rng.choice([4, 8])), 0.5, rng.uniform(0.6, 1.3)),
    "concrete": lambda rng: _courses(rng, 1, 0, 0.8),
    "planks": _planks,
    "plain": _plain,
}
_KINDS: dict[str, dict[str, Callable[[_Rng], _Layers]]] = {
    "ground": GROUNDS,
    "bark": BARKS,
    "wall": WALLS,
    "leaves": {"leaves": _leaves},
}


@lru_cache(maxsize=256)
def tile(family: str, kind: str, variant: int) -> NDArray[np.uint16]:
    """Return the mip pyramid (Σ n²/4^l,) of a tile: index << 8 | brightness."""
    kinds = _KINDS[family]
    seed = [sorted(_KINDS).index(family), sorted(kinds).index(kind), variant % VARIANTS, 0x711E]
    layers = kinds[kind](np.random.default_rng(seed))
    top = 255 if family == "leaves" else HUES - 1
    limited = np.clip(layers, [0, 0], [255, top]).astype(np.uint8)
    result: NDArray[np.uint16] = packed(pyramid(limited))
    return result


def palette(stops: Float64, contrast: float) -> NDArray[np.uint32]:
    """Return packed BGR colours (HUES × 256,) of each index and brightness.

    stops: (k,3) BGR from the first index to the last, at brightness 128. contrast: 1: as the tile.
    """
    at = np.linspace(0, len(stops) - 1, HUES)
    base = np.stack([np.interp(at, np.arange(len(stops)), stops[:, c]) for c in range(3)], axis=-1)
    gain = np.maximum(1 + contrast * (np.arange(256) / 128.0 - 1), 0.0)[None, :, None]
    colours = np.clip(base[:, None] * gain, 0, 255).astype(np.uint8)
    result: NDArray[np.uint32] = packed(colours).ravel()
    return result
