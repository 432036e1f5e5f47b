"""Seeded worlds as data: cylinders and boxes in the form of `world.json`; metres, ENU."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mavlink_bridge.settings import StrictModel

Vector = NDArray[np.float64]


class Cylinder(StrictModel):
    """A vertical trunk."""

    x: float
    y: float
    radius: float = Field(gt=0)
    height: float = Field(8.0, gt=0)


class Box(StrictModel):
    """An axis-aligned block."""

    min: list[float] = Field(min_length=3, max_length=3)
    max: list[float] = Field(min_length=3, max_length=3)


class WorldConfig(StrictModel):
    """A generator with its parameters, or explicit shapes."""

    generator: Literal["forest", "empty"] = "empty"
    rows: int = Field(7, ge=1, le=100, description="forest: trunks along y.")
    columns: int = Field(7, ge=1, le=100, description="forest: trunks along x.")
    spacing: float = Field(7.0, gt=0, description="forest: centre to centre [m].")
    radius: float = Field(1.0, gt=0, description="forest: of each trunk [m].")
    jitter: float = Field(1.0, ge=0, description="forest: each trunk is moved up to this [m] "
                          "along x and along y.")  # fmt: skip
    height: float = Field(8.0, gt=0, description="Of each trunk [m].")
    cylinders: list[Cylinder] = Field([])
    boxes: list[Box] = Field([])


def build(config: WorldConfig, seed: int) -> dict[str, Any]:
    """`cylinders` and `boxes` as plain data; the same seed, the same world."""
    cylinders = [c.model_dump() for c in config.cylinders]
    if config.generator == "forest":
        cylinders += forest(config, np.random.default_rng([seed, 1]))
    return {"cylinders": cylinders, "boxes": [b.model_dump() for b in config.boxes]}


def forest(config: WorldConfig, rng: np.random.Generator) -> list[dict[str, float]]:
    """A grid of trunks around the origin, each moved at random: the paper's scenarios 1 and 2."""
    x = (np.arange(config.columns) - (config.columns - 1) / 2) * config.spacing
    y = (np.arange(config.rows) - (config.rows - 1) / 2) * config.spacing
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    grid = grid + rng.uniform(-config.jitter, config.jitter, grid.shape)
    return [
        {
            "x": round(float(cx), 4),
            "y": round(float(cy), 4),
            "radius": config.radius,
            "height": config.height,
        }
        for cx, cy in grid
    ]


def surface_distance(position: Vector, world: dict[str, Any]) -> Vector:
    """Signed distance (...,) [m] from each point (...,3) to the nearest obstacle surface."""
    nearest = np.full(position.shape[:-1], np.inf)
    for c in world.get("cylinders", []):
        radial = np.hypot(position[..., 0] - c["x"], position[..., 1] - c["y"]) - c["radius"]
        above = position[..., 2] - c["height"]
        outside = np.hypot(np.maximum(radial, 0), np.maximum(above, 0))
        inside = (radial < 0) & (above < 0)
        nearest = np.minimum(nearest, np.where(inside, np.maximum(radial, above), outside))
    for b in world.get("boxes", []):
        low, high = np.array(b["min"]), np.array(b["max"])
        gap = np.maximum(np.maximum(low - position, position - high), 0)
        depth = np.minimum(position - low, high - position).min(axis=-1)
        nearest = np.minimum(nearest, np.where(depth > 0, -depth, np.linalg.norm(gap, axis=-1)))
    return nearest


def sight_line_free(eye: Vector, points: Vector, world: dict[str, Any]) -> NDArray[np.bool_]:
    """Whether the segment from `eye` (3,) to each of `points` (n,3) meets no obstacle; eq. (6)."""
    free = np.ones(len(points), bool)
    d = points - eye
    length2 = np.maximum((d[:, :2] ** 2).sum(axis=1), 1e-9)
    for c in world.get("cylinders", []):
        to_axis = np.array([c["x"], c["y"]]) - eye[:2]
        along = np.clip(d[:, :2] @ to_axis / length2, 0.0, 1.0)
        miss = np.hypot(*(along[:, None] * d[:, :2] - to_axis).T)
        below = eye[2] + along * d[:, 2] < c["height"]
        free &= ~((miss < c["radius"]) & below)
    for b in world.get("boxes", []):
        free &= ~_segment_meets_box(eye, d, np.array(b["min"]), np.array(b["max"]))
    return free


def _segment_meets_box(eye: Vector, d: Vector, low: Vector, high: Vector) -> NDArray[np.bool_]:
    """Slab test of segments eye + s·d, s in [0, 1]."""
    safe = np.where(np.abs(d) < 1e-12, 1e-12, d)
    near, far = (low - eye) / safe, (high - eye) / safe
    enter = np.minimum(near, far).max(axis=1)
    leave = np.maximum(near, far).min(axis=1)
    meets: NDArray[np.bool_] = (enter < leave) & (leave > 0.0) & (enter < 1.0)
    return meets
