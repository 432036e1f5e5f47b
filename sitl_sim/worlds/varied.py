"""Worlds of many kinds of obstacles, on ground that may be uneven; metres, ENU.

Trunks of any radius, upright and leaning, with branches; bushes, poles, people, walls; in the form
of `world.json`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sitl_sim.worlds.ground import Ground, uneven

REACH = 26.0  # m from the origin to the world's edges
RADII = (0.1, 1.5)  # m, of trunks
MOST_LEAN = 15.0  # degrees
_TALL = (5.0, 14.0)  # m, of trunks
_ATTEMPTS = 60
_Rng = np.random.Generator
_World = dict[str, Any]


def varied(rng: _Rng, slope_deg: float = 10.0, open_ground: float = 0.0) -> _World:
    """Return a world drawn from `rng`; a third of them have slopes of up to `slope_deg`.

    open_ground: share of worlds with few trunks or none, where the horizon shows.
    """
    world: _World = {"cylinders": [], "boxes": [], "capsules": [], "spheres": []}
    if slope_deg > 0.0 and rng.random() < 0.35:
        world["terrain"] = uneven(float(rng.uniform(0.3, 1.0)) * slope_deg, rng)
    ground = Ground(world)
    few = open_ground > 0.0 and rng.random() < open_ground
    places = _places(rng, (0, 6) if few else (15, 90))
    branchy = rng.uniform(0, 3) if rng.random() < 0.4 else 0.0
    lean = rng.uniform(0, MOST_LEAN) if rng.random() < 0.6 else 0.0
    for x, y, radius in places:
        foot = float(ground.height(x, y))
        add_trunk(world, rng, (x, y, foot, radius), float(rng.uniform(*_TALL)), lean, branchy)
    if rng.random() < 0.5:
        _bushes(world, rng, ground, int(rng.integers(4, 40)))
    if rng.random() < 0.35:
        _poles(world, rng, ground, int(rng.integers(1, 8)))
    if rng.random() < 0.3:
        _people(world, rng, ground, int(rng.integers(1, 6)))
    if rng.random() < 0.3:
        _walls(world, rng, ground, int(rng.integers(1, 6)))
    return world


def _places(rng: _Rng, count: tuple[int, int]) -> list[tuple[float, float, float]]:
    """Return x, y, radius of trunks: dense where they are thin, apart from each other."""
    low = float(np.exp(rng.uniform(math.log(RADII[0]), math.log(0.8))))
    high = float(min(low * np.exp(rng.uniform(0.1, 1.6)), RADII[1]))
    gap = float(rng.uniform(1.4, 4.0))
    kept = np.zeros((0, 3))
    for _ in range(int(rng.integers(*count))):
        radius = float(np.exp(rng.uniform(math.log(low), math.log(high))))
        for place in rng.uniform(-REACH, REACH, (_ATTEMPTS, 2)):
            if (np.hypot(*(kept[:, :2] - place).T) - kept[:, 2] - radius >= gap).all():
                kept = np.vstack([kept, [*place, radius]])
                break
    return [(float(x), float(y), float(r)) for x, y, r in kept]


def add_trunk(
    world: _World,
    rng: _Rng,
    at: tuple[float, float, float, float],
    tall: float,
    lean_deg: float,
    branchy: float,
) -> None:
    """Add a trunk at x, y, height of its foot, radius, and its branches; m.

    tall: m. A trunk that leans is a capsule, by 20 % to 100 % of `lean_deg`. branchy: mean number.
    """
    x, y, foot, radius = at
    tilt = math.radians(float(rng.uniform(0.2, 1.0)) * lean_deg)
    towards = float(rng.uniform(-math.pi, math.pi))
    axis = np.array(
        [math.sin(tilt) * math.cos(towards), math.sin(tilt) * math.sin(towards), math.cos(tilt)]
    )
    base = np.array([x, y, foot])
    if math.degrees(tilt) < 1.0:
        axis = np.array([0.0, 0.0, 1.0])
        height = round(foot + tall, 4)
        cylinder = {
            "x": round(x, 4),
            "y": round(y, 4),
            "radius": round(radius, 4),
            "height": height,
        }
        world["cylinders"].append(cylinder | ({"foot": round(foot, 4)} if foot else {}))
    else:
        world["capsules"].append(capsule(base - 0.5 * axis, base + tall * axis, radius))
    for _ in range(int(rng.poisson(branchy))):
        turn, rise = float(rng.uniform(-math.pi, math.pi)), float(rng.uniform(-0.2, 0.9))
        way = np.array([math.cos(turn), math.sin(turn), rise])
        start = base + axis * float(rng.uniform(1.0, 0.8 * tall))
        long = radius + float(rng.uniform(0.5, 2.2))
        thick = float(np.clip(rng.uniform(0.12, 0.35) * radius, 0.03, 0.15))
        end = start + long * way / np.linalg.norm(way)
        world["capsules"].append(capsule(start, end, thick) | {"kind": "branch"})


def capsule(a: Any, b: Any, radius: float) -> dict[str, Any]:
    """Return a capsule as in `world.json`."""
    return {
        "a": np.round(a, 4).tolist(),
        "b": np.round(b, 4).tolist(),
        "radius": round(float(radius), 4),
    }


def _bushes(world: _World, rng: _Rng, ground: Ground, count: int) -> None:
    for x, y in rng.uniform(-REACH, REACH, (count, 2)):
        size = float(rng.uniform(0.3, 1.1))
        add_bush(world, rng, (float(x), float(y), float(ground.height(x, y))), size)


def add_bush(world: _World, rng: _Rng, at: tuple[float, float, float], size: float) -> None:
    """Add a bush at x, y, height of the ground: one to four spheres of up to `size` [m]."""
    x, y, foot = at
    for _ in range(int(rng.integers(1, 5))):
        radius = size * float(rng.uniform(0.5, 1.0))
        east, north = x + rng.normal(0, 0.5 * size), y + rng.normal(0, 0.5 * size)
        up = foot + radius * float(rng.uniform(0.4, 1.3))
        centre = [round(float(east), 4), round(float(north), 4), round(up, 4)]
        world["spheres"].append({"centre": centre, "radius": round(radius, 4)})


def _poles(world: _World, rng: _Rng, ground: Ground, count: int) -> None:
    for x, y in rng.uniform(-REACH, REACH, (count, 2)):
        foot = float(ground.height(x, y))
        world["cylinders"].append(
            {
                "x": round(float(x), 4),
                "y": round(float(y), 4),
                "radius": round(float(rng.uniform(0.04, 0.15)), 4),
                "height": round(foot + float(rng.uniform(2.5, 9.0)), 4),
                "kind": "pole",
            }
            | ({"foot": round(foot, 4)} if foot else {})
        )


def _people(world: _World, rng: _Rng, ground: Ground, count: int) -> None:
    """Add people: legs, trunk of the body, and head."""
    for x, y in rng.uniform(-REACH, REACH, (count, 2)):
        foot = np.array([x, y, float(ground.height(x, y))])
        k = float(rng.uniform(0.9, 1.1))
        turn = float(rng.uniform(-math.pi, math.pi))
        side = 0.1 * k * np.array([math.cos(turn), math.sin(turn), 0.0])
        up = np.array([0.0, 0.0, k])
        for sign in (1, -1):
            leg = capsule(foot + sign * side, foot + sign * side + 0.85 * up, 0.08 * k)
            world["capsules"].append(leg | {"kind": "person"})
        chest = capsule(foot + 0.95 * up, foot + 1.35 * up, 0.2 * k)
        head = capsule(foot + 1.62 * up, foot + 1.68 * up, 0.11 * k)
        world["capsules"] += [chest | {"kind": "person"}, head | {"kind": "person"}]


def _walls(world: _World, rng: _Rng, ground: Ground, count: int) -> None:
    for x, y in rng.uniform(-20, 20, (count, 2)):
        foot = float(ground.height(x, y))
        low = np.array([x, y, foot - 1.0])
        size = np.array([*rng.uniform(0.3, 8.0, 2), 1.0 + rng.uniform(0.6, 7.0)])
        world["boxes"].append(
            {"min": np.round(low, 4).tolist(), "max": np.round(low + size, 4).tolist()}
        )
