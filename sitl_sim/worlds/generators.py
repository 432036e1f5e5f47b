"""Seeded generators of obstacles: forests, pillars, thickets, a wall with a tunnel; and the user's.

A generator takes the section `world` and a random generator of the seed, and returns `Generated`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mavlink_bridge.shared.explain import Key
from mavlink_bridge.shared.settings import Document, SettingsError, StrictModel, validate
from sitl_sim.worlds.ground import Ground, sloping, stepped, uneven
from sitl_sim.worlds.varied import add_bush, add_trunk
from sitl_sim.worlds.world import GENERATORS, Box, Cylinder, WorldConfig

Generated = dict[str, list[dict[str, Any]]]
"""`cylinders` and `boxes`; either may be left out."""
_ATTEMPTS = 200  # to find a free place for one more trunk


def build(config: WorldConfig, seed: int) -> dict[str, Any]:
    """Return `cylinders`, `boxes` and uneven `terrain` as in `world.json`, by the seed."""
    rng = np.random.default_rng([seed, 1])
    made = _made(config, rng)
    cylinders = [c.model_dump() for c in [*config.cylinders, *made.cylinders]]
    boxes = [b.model_dump() for b in [*config.boxes, *made.boxes]]
    world: dict[str, Any] = {"cylinders": cylinders, "boxes": boxes}
    if config.ground != "flat":
        drawn = np.random.default_rng([seed, 8])
        if config.ground == "uneven":
            world["terrain"] = uneven(config.slope_deg, drawn, boxes)
        elif config.ground == "steps":
            world["terrain"] = stepped(config.step, drawn)
        else:
            world["terrain"] = sloping(config.slope_deg, drawn)
        ground = Ground(world)
        for c in cylinders:
            c["height"] = round(c["height"] + float(ground.height(c["x"], c["y"])), 4)
    if config.lean_deg or config.branches or config.bushes:
        return grown(world, config, np.random.default_rng([seed, 5]))
    return world


class Obstacles(StrictModel):
    """What a generator returns; shapes as `world.cylinders` and `world.boxes` of a scenario."""

    cylinders: list[Cylinder] = Field([])
    boxes: list[Box] = Field([])


def _made(config: WorldConfig, rng: np.random.Generator) -> Obstacles:
    """Return the obstacles of the generator that the world names.

    Raises:
        SettingsError: what it returns are no obstacles.
    """
    generated = GENERATORS.load(config.generator)(config, rng)
    where = f"world.generator: {config.generator}: returned"
    if not isinstance(generated, dict):
        raise SettingsError([f"{where} no mapping of cylinders and boxes: {generated!r}"])
    places = dict.fromkeys(_paths((), generated), where)
    return validate(Obstacles, Document(generated, places), where)


def _paths(path: Key, value: Any) -> Iterator[Key]:
    """Yield the key path of every value."""
    yield path
    inner = value.items() if isinstance(value, dict) else ()
    for key, item in enumerate(value) if isinstance(value, list) else inner:
        yield from _paths((*path, key), item)


def empty(config: WorldConfig, rng: np.random.Generator) -> Generated:
    """Return nothing: the world holds only what the scenario lists."""
    return {}


missions = empty  # a mission's obstacles are listed by then


def grown(world: dict[str, Any], config: WorldConfig, rng: np.random.Generator) -> dict[str, Any]:
    """Return the world with trunks that lean, branches and bushes: `capsules` and `spheres`.

    A trunk that leans keeps its place, radius and length. Bushes stand at the feet of trunks.
    """
    made: dict[str, Any] = {**world, "cylinders": [], "capsules": [], "spheres": []}
    for c in world["cylinders"]:
        at = (c["x"], c["y"], float(c.get("foot", 0.0)), c["radius"])
        add_trunk(made, rng, at, c["height"], config.lean_deg, config.branches)
    for k in rng.integers(0, max(len(world["cylinders"]), 1), config.bushes):
        if world["cylinders"]:
            beside = world["cylinders"][k]
            away, angle = beside["radius"] + rng.uniform(0.1, 0.5), rng.uniform(-np.pi, np.pi)
            foot = float(beside.get("foot", 0.0))
            x, y = beside["x"] + away * np.cos(angle), beside["y"] + away * np.sin(angle)
            add_bush(made, rng, (float(x), float(y), foot), float(rng.uniform(0.3, 0.8)))
    return made


def forest(config: WorldConfig, rng: np.random.Generator) -> Generated:
    """Return a grid of trunks around the origin, each moved at random (scenarios 1 and 2)."""
    x = (np.arange(config.columns) - (config.columns - 1) / 2) * config.spacing
    y = (np.arange(config.rows) - (config.rows - 1) / 2) * config.spacing
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    if config.staggered:
        grid[1::2, :, 0] += config.spacing / 2
    places = grid.reshape(-1, 2)
    places = places + rng.uniform(-config.jitter, config.jitter, places.shape)
    return {"cylinders": [_trunk(x, y, config.radius, config.height) for x, y in places]}


def thicket(config: WorldConfig, rng: np.random.Generator) -> Generated:
    """Return `density` trunks per m² over `area`, of random radii and at least `gap` apart.

    Places are drawn one after another, and drawn again where they are too near to an earlier one;
    a trunk without a free place is left out.
    """
    x0, y0, x1, y1 = config.area
    low, high = config.radii
    kept: NDArray[np.float64] = np.zeros((0, 3))
    for _ in range(round(config.density * (x1 - x0) * (y1 - y0))):
        radius = rng.uniform(low, high)
        for place in rng.uniform((x0, y0), (x1, y1), (_ATTEMPTS, 2)):
            apart = np.hypot(*(kept[:, :2] - place).T) - kept[:, 2] - radius
            if (apart >= config.gap).all():
                kept = np.vstack([kept, [*place, radius]])
                break
    return {"cylinders": [_trunk(x, y, r, config.height) for x, y, r in kept]}


def tunnel(config: WorldConfig, rng: np.random.Generator) -> Generated:
    """Return a wall along x with one opening, whose middle is above the origin; faces at ±y.

    The seed draws the thickness of the wall, which is the length of the tunnel.
    """
    half = rng.uniform(config.thickness[0], config.thickness[1]) / 2
    wide, high = config.opening[0] / 2, config.opening[1] / 2
    low, top, end = config.sill, config.sill + 2 * high, config.wall[0] / 2
    blocks = [
        (-end, 0.0, -wide, config.wall[1]),
        (wide, 0.0, end, config.wall[1]),
        (-wide, 0.0, wide, low),
        (-wide, top, wide, config.wall[1]),
    ]
    boxes = [
        {"min": [x0, round(-half, 4), z0], "max": [x1, round(half, 4), z1]}
        for x0, z0, x1, z1 in blocks
    ]
    return {"boxes": boxes}


def _trunk(x: float, y: float, radius: float, height: float) -> dict[str, float]:
    return {
        "x": round(float(x), 4),
        "y": round(float(y), 4),
        "radius": round(float(radius), 4),
        "height": height,
    }
