"""Worlds as data: cylinders and boxes in the form of `world.json`; metres, ENU."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.distance import to_cylinder
from mavlink_bridge.shared.parts import PartKind
from mavlink_bridge.shared.settings import StrictModel

_PACKAGED = ("forest", "thicket", "tunnel", "missions", "empty")
GENERATORS = PartKind(
    "generator",
    "swarm_companion.worlds",
    {name: f"sitl_sim.worlds.generators:{name}" for name in _PACKAGED},
)

Point2 = Annotated[list[float], Field(min_length=2, max_length=2)]  # [x, y] m
Point3 = Annotated[list[float], Field(min_length=3, max_length=3)]  # [x, y, z] m


def _rising(band: list[float]) -> list[float]:
    if band[0] >= band[1]:
        raise ValueError(f"must rise, got {band[0]:g}, {band[1]:g}")
    return band


Band = Annotated[list[float], Field(min_length=2, max_length=2), AfterValidator(_rising)]


class Cylinder(StrictModel):
    """A vertical trunk."""

    x: float
    y: float
    radius: float = Field(gt=0)
    height: float = Field(8.0, gt=0)


class Box(StrictModel):
    """An axis-aligned block."""

    min: Point3
    max: Point3


class WorldConfig(StrictModel):
    """A generator with its parameters, explicit shapes, or both."""

    generator: Annotated[str, AfterValidator(GENERATORS.check)] = Field(
        "empty",
        description="forest, thicket, tunnel, missions, empty; your own by the name of its entry "
        "point, or module:function.",
    )
    options: dict[str, Any] = Field({}, description="For your own generator, which reads them.")
    rows: int = Field(7, ge=1, le=100, description="forest: trunks along y.")
    columns: int = Field(7, ge=1, le=100, description="forest: trunks along x.")
    spacing: float = Field(7.0, gt=0, description="forest: centre to centre [m].")
    staggered: bool = Field(False, description="forest: every other row by half a spacing.")
    radius: float = Field(1.0, gt=0, description="forest: of each trunk [m].")
    jitter: float = Field(
        1.0, ge=0, description="forest: each trunk is moved up to this [m] along x and along y."
    )
    height: float = Field(8.0, gt=0, description="Of each trunk [m].")
    area: list[float] = Field(
        [-10.0, -10.0, 10.0, 10.0],
        min_length=4,
        max_length=4,
        description="thicket: x, y of two corners [m].",
    )
    density: float = Field(0.1, gt=0, le=1, description="thicket: trunks per m².")
    radii: list[float] = Field(
        [0.2, 0.5], min_length=2, max_length=2, description="thicket: least and largest radius [m]."
    )
    gap: float = Field(1.2, ge=0, description="thicket: least room between two trunks [m].")
    opening: list[float] = Field(
        [2.0, 2.0], min_length=2, max_length=2, description="tunnel: width and height [m]."
    )
    sill: float = Field(1.0, ge=0, description="tunnel: height of its floor [m].")
    thickness: list[float] = Field(
        [2.0, 4.0], min_length=2, max_length=2, description="tunnel: least and largest length [m]."
    )
    wall: list[float] = Field(
        [30.0, 8.0],
        min_length=2,
        max_length=2,
        description="tunnel: length and height of the wall [m].",
    )
    ground: Literal["flat", "slope", "uneven", "steps"] = Field(
        "flat",
        description="slope: one plane through the origin; uneven: gentle hills; steps: terraces. "
        "Heights of trunks and targets count from it.",
    )
    step: float = Field(0.4, gt=0, le=1.0, description="steps: height of each [m].")
    slope_deg: float = Field(
        10.0, gt=0, le=30, description="slope: its angle; uneven: the steepest [degrees]."
    )
    lean_deg: float = Field(
        0.0, ge=0, le=30, description="forest, thicket: trunks lean by up to this [degrees]."
    )
    branches: float = Field(0.0, ge=0, le=20, description="forest, thicket: per trunk, mean.")
    bushes: int = Field(0, ge=0, le=500, description="forest, thicket: number of bushes.")
    look: str = Field(
        "plain",
        description="How the world looks: plain, random, or a name of docs/scenarios.md.",
    )
    missions: str | None = Field(None, description="missions: the JSON file that holds them.")
    obstacles: str | None = Field(
        None,
        description="File of obstacles, beside those made or listed: trunks as CSV or GeoJSON, or "
        "a point cloud as PCD or PLY (extra `clouds`).",
    )
    cloud_heights: Band = Field(
        [0.5, 4.0],
        description="Point cloud: what lies between these heights above the ground becomes "
        "obstacles [m]; the drones should fly there.",
    )
    cloud_cell: float = Field(
        0.2,
        ge=0.05,
        le=2.0,
        description="Point cloud: edge of the cells that stand for what is no trunk [m]; points "
        "less than a cell apart belong together, so choose no less than their spacing.",
    )
    cloud_ground: Literal["lowest", "zero"] = Field(
        "lowest",
        description="Point cloud: the ground is where the lowest points around are, or z = 0 "
        "(a cloud without its ground).",
    )
    cylinders: list[Cylinder] = Field([])
    boxes: list[Box] = Field([])


def surface_distance(position: Vector, world: dict[str, Any]) -> Vector:
    """Return the signed distance (...,) m from points (...,3) to the nearest obstacle surface."""
    nearest = np.full(position.shape[:-1], np.inf)
    for c in world.get("cylinders", []):
        radial = to_cylinder(position, c["x"], c["y"], c["radius"])
        above = position[..., 2] - c["height"]
        outside = np.hypot(np.maximum(radial, 0), np.maximum(above, 0))
        inside = (radial < 0) & (above < 0)
        nearest = np.minimum(nearest, np.where(inside, np.maximum(radial, above), outside))
    for c in world.get("capsules", []):
        a, b = np.array(c["a"], float), np.array(c["b"], float)
        along = np.clip((position - a) @ (b - a) / max(float((b - a) @ (b - a)), 1e-12), 0, 1)
        axis = a + along[..., None] * (b - a)
        nearest = np.minimum(nearest, np.linalg.norm(position - axis, axis=-1) - c["radius"])
    for c in world.get("spheres", []):
        away = np.linalg.norm(position - np.array(c["centre"], float), axis=-1)
        nearest = np.minimum(nearest, away - c["radius"])
    for b in world.get("boxes", []):
        low, high = np.array(b["min"]), np.array(b["max"])
        gap = np.maximum(np.maximum(low - position, position - high), 0)
        depth = np.minimum(position - low, high - position).min(axis=-1)
        nearest = np.minimum(nearest, np.where(depth > 0, -depth, np.linalg.norm(gap, axis=-1)))
    return nearest


class Occluders:
    """The obstacles of a world as arrays, to compute lines of sight; eq. (6)."""

    def __init__(self, world: dict[str, Any]) -> None:
        """Take the obstacles of a world as in `world.json`."""
        rows = [[c["x"], c["y"], c["radius"], c["height"]] for c in world.get("cylinders", [])]
        self.cylinders = np.array(rows, float).reshape(-1, 4)
        self.boxes = [(np.array(b["min"]), np.array(b["max"])) for b in world.get("boxes", [])]
        capsules = [[*c["a"], *c["b"], c["radius"]] for c in world.get("capsules", [])]
        capsules += [[*c["centre"], *c["centre"], c["radius"]] for c in world.get("spheres", [])]
        self.capsules = np.array(capsules, float).reshape(-1, 7)  # spheres are capsules, too

    def free(
        self, viewpoint: Vector, points: Vector, own: NDArray[np.int_] | None = None
    ) -> NDArray[np.bool_]:
        """Return (n,) whether the segments from `viewpoint` to `points` (n,3) m meet no obstacle.

        viewpoint: (3,) m, one for all, or (n,3). own: (n,) index of the cylinder that each point
        belongs to; this cylinder does not hide it.
        """
        d = points - viewpoint
        length2 = np.maximum((d[:, :2] ** 2).sum(axis=1), 1e-9)[:, None]
        x, y = self.cylinders[:, 0] - viewpoint[..., :1], self.cylinders[:, 1] - viewpoint[..., 1:2]
        along = np.clip((d[:, :1] * x + d[:, 1:2] * y) / length2, 0.0, 1.0)
        miss2 = (along * d[:, :1] - x) ** 2 + (along * d[:, 1:2] - y) ** 2
        below = viewpoint[..., 2:] + along * d[:, 2:] < self.cylinders[:, 3]
        meets = (miss2 < self.cylinders[:, 2] ** 2) & below
        if own is not None:
            meets[np.arange(len(points)), own] = False
        free: NDArray[np.bool_] = ~meets.any(axis=1)
        if len(self.capsules):
            free &= ~_segments_meet_capsules(viewpoint, d, self.capsules)
        for low, high in self.boxes:
            free &= ~_segment_meets_box(viewpoint, d, low, high)
        return free


def _segment_meets_box(
    viewpoint: Vector, d: Vector, low: Vector, high: Vector
) -> NDArray[np.bool_]:
    """Return whether segments viewpoint + s·d, s in [0, 1], meet a box, by the slab test."""
    safe = np.where(np.abs(d) < 1e-12, 1e-12, d)
    near, far = (low - viewpoint) / safe, (high - viewpoint) / safe
    enter = np.minimum(near, far).max(axis=1)
    leave = np.maximum(near, far).min(axis=1)
    meets: NDArray[np.bool_] = (enter < leave) & (leave > 0.0) & (enter < 1.0)
    return meets


def _segments_meet_capsules(viewpoint: Vector, d: Vector, capsules: Vector) -> NDArray[np.bool_]:
    """Return whether segments viewpoint + s·d, s in [0, 1], come within a capsule's radius.

    capsules: (m,7) a, b, radius. Nearest points of two segments: Ericson, Real-Time Collision
    Detection, 5.1.9.
    """
    a, axis, radius = capsules[:, :3], capsules[:, 3:6] - capsules[:, :3], capsules[:, 6]
    r = np.atleast_2d(viewpoint)[:, None] - a
    dd = np.maximum((d * d).sum(axis=1), 1e-12)[:, None]
    aa = np.maximum((axis * axis).sum(axis=1), 1e-12)
    across = d @ axis.T
    on_axis, on_sight = (r * axis).sum(axis=2), (r * d[:, None]).sum(axis=2)
    least = np.maximum(dd * aa - across**2, 1e-12)
    s = np.clip((across * on_axis - on_sight * aa) / least, 0.0, 1.0)
    t = np.clip((across * s + on_axis) / aa, 0.0, 1.0)
    s = np.clip((across * t - on_sight) / dd, 0.0, 1.0)
    gap = r + s[..., None] * d[:, None] - t[..., None] * axis
    meets: NDArray[np.bool_] = ((gap**2).sum(axis=2) < radius**2).any(axis=1)
    return meets
