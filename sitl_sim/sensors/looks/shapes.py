"""The shapes of a world as rows for the kernels: cylinders, capsules, spheres, boxes.

A row is (KIND, a (3), b (3), RADIUS): a to b is the axis of a cylinder or capsule, both are the
centre of a sphere, and the corners of a box; metres, world.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sitl_sim.sensors.fisheye import Float64

CYLINDER, CAPSULE, SPHERE, BOX = range(4)
ROW = 8
_SUNK = 1.0  # m that a cylinder reaches into the ground
_TALL = 100.0


class Seen(IntEnum):
    """What a pixel shows; the values of a class map."""

    SKY = 0
    GROUND = 1
    TRUNK = 2
    BRANCH = 3
    BUSH = 4
    WALL = 5
    THING = 6
    DRONE = 7
    BIRD = 8


_OF_KIND = {"branch": Seen.BRANCH, "pole": Seen.THING, "person": Seen.THING, "bush": Seen.BUSH}


@dataclass(frozen=True)
class Shapes:
    """Rows (n,ROW) of the shapes and what each shows (n,) as in `Seen`."""

    rows: Float64
    seen: NDArray[np.uint8]

    @staticmethod
    def of(world: dict[str, Any]) -> Shapes:
        """Take the obstacles of a world as in `world.json`; a shape's `kind` may name it."""
        rows: list[list[float]] = []
        seen: list[int] = []
        for c in world.get("cylinders", []):
            foot, top = float(c.get("foot", 0.0)), min(float(c.get("height") or _TALL), _TALL)
            axis = [c["x"], c["y"], foot - _SUNK, c["x"], c["y"], top]
            rows.append([CYLINDER, *axis, c["radius"]])
            seen.append(_OF_KIND.get(c.get("kind", ""), Seen.TRUNK))
        for c in world.get("capsules", []):
            rows.append([CAPSULE, *c["a"], *c["b"], c["radius"]])
            seen.append(_OF_KIND.get(c.get("kind", ""), Seen.TRUNK))
        for c in world.get("spheres", []):
            rows.append([SPHERE, *c["centre"], *c["centre"], c["radius"]])
            seen.append(_OF_KIND.get(c.get("kind", ""), Seen.BUSH))
        for b in world.get("boxes", []):
            rows.append([BOX, *b["min"], *b["max"], 0.0])
            seen.append(Seen.WALL)
        return Shapes(np.array(rows, float).reshape(-1, ROW), np.array(seen, np.uint8))
