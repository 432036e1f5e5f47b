"""The height of the ground: flat, or uneven as a grid of heights in `world.json`; metres, ENU."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

REACH = 60.0  # m from the origin to each edge of a generated grid
GRID = 2.0  # m between its points
LEVELLED = 10.0  # m
TERRACES, RISER = (6.0, 14.0), 0.5  # m: their width; over how much of it a step rises
LEVELS = 2.0  # m above or below the origin from which terraces lead back
HILLS = 6  # plane waves that are added up
WAVELENGTHS = (18.0, 45.0)  # m


class Ground:
    """The ground of a world; flat at 0 where the world has no `terrain`.

    Between the points of the grid the height is bilinear; beyond the grid it is that of the edge.
    """

    def __init__(self, world: dict[str, Any]) -> None:
        """Take `terrain` of a world as in `world.json`: x (K,), y (L,), z (L,K), all m."""
        terrain = world.get("terrain")
        self.flat = terrain is None
        if terrain is not None:
            self.x, self.y = (np.array(terrain[k], float) for k in "xy")
            self.z = np.array(terrain["z"], float).reshape(len(self.y), len(self.x))

    def height(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the height (...,) m of the ground at x, y (...,) m."""
        if self.flat:
            return np.zeros(np.broadcast_shapes(np.shape(x), np.shape(y)))
        height: Floats = self.plane(x, y)[0]
        return height

    def normal(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the upward unit normal (...,3) of the ground at x, y (...,) m."""
        _, east, north = self.plane(x, y)
        normal = np.stack([-east, -north, np.ones_like(east)], axis=-1)
        unit: Floats = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
        return unit

    def plane(self, x: ArrayLike, y: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Return the height [m] and the slopes towards east and north (rise/run), each (...,)."""
        at_x, at_y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        if self.flat:
            return np.zeros(at_x.shape), np.zeros(at_x.shape), np.zeros(at_x.shape)
        gx, gy, gz = self.x, self.y, self.z
        i = np.clip(np.searchsorted(gx, at_x) - 1, 0, len(gx) - 2)
        j = np.clip(np.searchsorted(gy, at_y) - 1, 0, len(gy) - 2)
        wide, deep = gx[i + 1] - gx[i], gy[j + 1] - gy[j]
        a = np.clip((at_x - gx[i]) / wide, 0.0, 1.0)
        b = np.clip((at_y - gy[j]) / deep, 0.0, 1.0)
        low = gz[j, i] * (1 - a) + gz[j, i + 1] * a
        high = gz[j + 1, i] * (1 - a) + gz[j + 1, i + 1] * a
        east = ((gz[j, i + 1] - gz[j, i]) * (1 - b) + (gz[j + 1, i + 1] - gz[j + 1, i]) * b) / wide
        north = (high - low) / deep
        inside_x = (at_x >= gx[0]) & (at_x <= gx[-1])
        inside_y = (at_y >= gy[0]) & (at_y <= gy[-1])
        return low * (1 - b) + high * b, np.where(inside_x, east, 0), np.where(inside_y, north, 0)

    def ranges(self, p: Floats, down: Floats) -> Floats:
        """Return the range (n,) m from p (n,3) m along `down` (n,3), unit vectors, to the ground.

        Infinite where the ray does not point at the ground. The ground is taken as the plane
        below each point, and then as the plane where the ray meets that one.
        """
        x, y = p[:, 0], p[:, 1]
        for _ in range(2 if not self.flat else 1):
            height, east, north = self.plane(x, y)
            above = p[:, 2] - height - east * (p[:, 0] - x) - north * (p[:, 1] - y)
            falls = east * down[:, 0] + north * down[:, 1] - down[:, 2]
            with np.errstate(divide="ignore", invalid="ignore"):
                away = np.where(falls > 1e-6, above / falls, np.inf)
            reach = np.where(np.isfinite(away), np.clip(away, 0.0, 100.0), 0.0)
            x, y = p[:, 0] + reach * down[:, 0], p[:, 1] + reach * down[:, 1]
        return away


def sloping(slope_deg: float, rng: np.random.Generator) -> dict[str, Any]:
    """Return `terrain` of one plane through the origin that rises in a random direction."""
    towards, rise = rng.uniform(0.0, 2 * math.pi), math.tan(math.radians(slope_deg))
    axis = np.array([-REACH, REACH])
    height = rise * (math.cos(towards) * axis + math.sin(towards) * axis[:, None])
    return {"x": axis.tolist(), "y": axis.tolist(), "z": height.round(4).tolist()}


def uneven(
    slope_deg: float, rng: np.random.Generator, boxes: Sequence[dict[str, Any]] = ()
) -> dict[str, Any]:
    """Return `terrain` of gentle hills: its steepest slope is `slope_deg`, the origin is at 0.

    The height is a sum of plane waves with random directions, wavelengths and phases. It is 0 under
    boxes, where walls begin, and grows over `LEVELLED` metres around them.
    """
    axis = np.arange(-REACH, REACH + GRID / 2, GRID)
    x, y = np.meshgrid(axis, axis)
    height = np.zeros_like(x)
    for _ in range(HILLS):
        towards, length = rng.uniform(0.0, 2 * math.pi), rng.uniform(*WAVELENGTHS)
        along = (math.cos(towards) * x + math.sin(towards) * y) * 2 * math.pi / length
        height += length * np.sin(along + rng.uniform(0.0, 2 * math.pi))
    middle = len(axis) // 2
    height = (height - height[middle, middle]) * _room(x, y, boxes)
    north, east = np.gradient(height, GRID)
    height *= math.tan(math.radians(slope_deg)) / float(np.hypot(east, north).max())
    return {"x": axis.tolist(), "y": axis.tolist(), "z": height.round(4).tolist()}


def stepped(step: float, rng: np.random.Generator) -> dict[str, Any]:
    """Return `terrain` of terraces: every 6 to 14 m to the north a step of `step` m, up or down.

    A step rises over `RISER` metres. The terrace around the origin is at 0.
    """
    rows = round(2 * REACH / RISER) + 1
    axis = np.linspace(-REACH, REACH, rows)
    height = np.zeros(rows)
    for towards in (1.0, -1.0):
        at, level = rng.uniform(*TERRACES) / 2, 0.0
        while at < REACH:
            up = rng.random() < 0.5 - 0.5 * level / LEVELS
            level += step if up else -step
            height[towards * axis > at] = level
            at += rng.uniform(*TERRACES)
    z = np.repeat(height[:, None], 2, axis=1)
    return {"x": [-REACH, REACH], "y": axis.round(4).tolist(), "z": z.round(4).tolist()}


def _room(x: Floats, y: Floats, boxes: Sequence[dict[str, Any]]) -> Floats:
    """Return 0 within a grid step of a box, 1 beyond `LEVELLED`, and what lies between."""
    share = np.ones_like(x)
    for box in boxes:
        (x0, y0, _), (x1, y1, _) = box["min"], box["max"]
        aside_x = np.maximum(np.maximum(x0 - x, x - x1), 0.0)
        aside_y = np.maximum(np.maximum(y0 - y, y - y1), 0.0)
        away = (np.hypot(aside_x, aside_y) - GRID) / LEVELLED
        share = np.minimum(share, np.clip(away, 0.0, 1.0))
    return share
