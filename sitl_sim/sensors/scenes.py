"""Seeded scenes with known truth: a world, a camera in it, drones around the camera.

For measuring and training perception, not for flights. World W = ENU, camera C = x right, y down,
z forward.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.frames import quaternion_from_euler
from sitl_sim.sensors.fisheye import R_BC, Lens, rotation
from sitl_sim.sensors.perfect_detector import camera_rays, seen
from sitl_sim.worlds.ground import Ground
from sitl_sim.worlds.varied import varied as varied_world
from sitl_sim.worlds.world import Occluders, surface_distance

RADIUS = 0.2  # m, of a drone
CORE = 0.1  # m, radius of hull and marker: the part of a drone whose visibility counts
_SPOTS = 32  # points on a drone's core whose visibility is computed
_SCENES_PER_WORLD = 25


@dataclass(frozen=True)
class Scene:
    """One camera pose and its truth.

    p: (3,) m and q: (4,) body → world of the camera's drone. drones: (m,3) m, attitudes: (m,4),
    velocities: (m,3) m/s and ids: (m,) of the other drones. visible: (m,) share of each core that
    the picture shows. time [s] and own_v: (3,) m/s only where scenes follow one another.
    """

    world: dict[str, Any]
    p: Vector
    q: Vector
    drones: Vector
    attitudes: Vector
    velocities: Vector
    ids: NDArray[np.int_]
    visible: Vector
    time: float = 0.0
    own_v: Vector | None = None

    def in_camera(self, offsets: Vector) -> Vector:
        """Return world vectors (n,3) in the camera frame."""
        result: Vector = offsets @ (rotation(self.q) @ R_BC)
        return result


def forest(rng: np.random.Generator, varied: bool = False) -> dict[str, Any]:
    """Return the paper's forest; varied: with other radii and spacings, and some walls."""
    spacing = rng.uniform(4.5, 9.0) if varied else 7.0
    grid = (np.arange(7) - 3) * spacing
    at = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    at = at + rng.uniform(-0.17, 0.17, at.shape) * spacing
    radii = rng.uniform(0.12, 1.3, len(at)) if varied else np.ones(len(at))
    cylinders = [
        {"x": float(x), "y": float(y), "radius": float(r), "height": 10.0}
        for (x, y), r in zip(at, radii, strict=True)
    ]
    boxes = []
    for _ in range(rng.integers(0, 6) if varied and rng.random() < 0.4 else 0):
        low = np.array([*rng.uniform(-20, 20, 2), 0.0])
        size = np.array([*rng.uniform(0.3, 8.0, 2), rng.uniform(1.5, 8.0)])
        boxes.append({"min": low.tolist(), "max": (low + size).tolist()})
    return {"cylinders": cylinders, "boxes": boxes, "drone_radius": RADIUS}


def still_scenes(
    count: int,
    seed: int,
    lens: Lens,
    tilt_deg: float = 35.0,
    reach: float = 12.0,
    varied: bool = False,
) -> Iterator[Scene]:
    """Yield unrelated scenes: up to nine drones from 0.5 m to `reach`, tilts up to `tilt_deg`."""
    rng = np.random.default_rng([seed, 77])
    world, room = forest(rng, varied), _FreeSpace({})
    for index in range(count):
        if index % _SCENES_PER_WORLD == 0:
            world = forest(rng, varied)
            room = _FreeSpace(world)
        yield _still_scene(rng, world, room, lens, tilt_deg, reach, 1 + index % 9)


def _still_scene(
    rng: np.random.Generator,
    world: dict[str, Any],
    room: _FreeSpace,
    lens: Lens,
    tilt_deg: float,
    reach: float,
    count: int,
) -> Scene:
    """Return a camera at a free place, with up to `count` drones around its view."""
    p = room.free_place(rng)
    q = _attitude(rng.uniform(-np.pi, np.pi), *np.radians(rng.uniform(-tilt_deg, tilt_deg, 2)))
    drones = _around(rng, room, p, q, count, reach)
    n = len(drones)
    tilt = np.radians(rng.uniform(-25, 25, (n, 2)))
    attitudes = np.array([_attitude(rng.uniform(-3, 3), *t) for t in tilt]).reshape(-1, 4)
    shares = visible_shares(p, q, drones, room.occluders, lens)
    return Scene(world, p, q, drones, attitudes, np.zeros((n, 3)), np.arange(n), shares)


def varied_scenes(
    count: int,
    seed: int,
    lens: Lens,
    tilt_deg: float = 35.0,
    reach: float = 12.0,
    open_ground: float = 0.0,
) -> Iterator[Scene]:
    """Yield unrelated scenes as `still_scenes` does, in worlds of many kinds of obstacles.

    open_ground: share of worlds with few trunks or none.
    """
    rng = np.random.default_rng([seed, 83])
    for index in range(count):
        if index % _SCENES_PER_WORLD == 0:
            world = varied_world(rng, open_ground=open_ground) | {"drone_radius": RADIUS}
            room = _FreeSpace(world)
        yield _still_scene(rng, world, room, lens, tilt_deg, reach, int(rng.integers(0, 10)))


def crowded_scenes(neighbours: int, count: int, seed: int, lens: Lens) -> Iterator[Scene]:
    """Yield scenes with exactly so many drones, 2 m to 8 m away, all of them wholly in view."""
    rng = np.random.default_rng([seed, 79, neighbours])
    world: dict[str, Any] = {"cylinders": [], "boxes": [], "drone_radius": RADIUS}
    room = _FreeSpace(world)
    p, q = np.array([0.0, 0.0, 3.0]), _attitude(0.0, 0.0, 0.0)
    made = 0
    while made < count:
        drones = np.zeros((0, 3))
        while len(drones) < neighbours:
            yaw, up = rng.uniform(-1.2, 1.2), rng.uniform(-0.3, 0.5)
            ray = np.array([np.cos(yaw) * np.cos(up), np.sin(yaw) * np.cos(up), np.sin(up)])
            drones = np.vstack([drones, p + rng.uniform(2.0, 8.0) * ray])
            if visible_shares(p, q, drones, room.occluders, lens).min() < 1.0:
                drones = drones[:-1]
        made += 1
        attitudes = np.tile(_attitude(0.3, 0.1, 0.0), (neighbours, 1))
        still, ids = np.zeros((neighbours, 3)), np.arange(neighbours)
        yield Scene(world, p, q, drones, attitudes, still, ids, np.ones(neighbours))


def flight_scenes(count: int, seconds: float, seed: int, lens: Lens) -> Iterator[list[Scene]]:
    """Yield sequences at 10 Hz from a drone that cruises through a forest beside others."""
    rng = np.random.default_rng([seed, 78])
    made = 0
    while made < count:
        world = forest(rng)
        room = _FreeSpace(world)
        t = np.arange(round(seconds * 10)) / 10
        own = _Path.own(rng, t)
        if not room.free(own.p, 0.4).all():
            continue
        others = [_Path.beside(rng, t, own) for _ in range(rng.integers(2, 9))]
        others = [o for o in others if room.free(o.p, 0.25).all()]
        # The drones of a swarm keep apart.
        others = [o for o in others if np.linalg.norm(o.p - own.p, axis=1).min() > 0.8]
        if not others:
            continue
        made += 1
        yield [_scene_at(world, room, own, others, k, lens) for k in range(len(t))]


def visible_shares(
    p: Vector, q: Vector, drones: Vector, occluders: Occluders, lens: Lens
) -> Vector:
    """Return the share (m,) of each drone's core that is in the picture and not hidden; eq. (6)."""
    k = np.arange(_SPOTS)
    radius, angle = CORE * np.sqrt((k + 0.5) / _SPOTS), k * 2.399963  # sunflower
    half = np.radians(lens.fov_deg) / 2
    view = (half, half * lens.height / lens.width)
    distance = np.linalg.norm(drones - p, axis=1)
    shares = np.zeros(len(drones))
    for i, drone in enumerate(drones):
        axis = (drone - p) / distance[i]
        side = np.cross(axis, [0.3, 0.1, 0.9])
        side /= np.linalg.norm(side)
        ring = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(axis, side)
        spots = drone + radius[:, None] * ring
        free = occluders.free(p, spots) & (spots[:, 2] > 0.0)
        free &= seen(camera_rays(q, spots - p), *view)
        for j in np.flatnonzero(distance < distance[i]):
            along = (spots - p) @ (drones[j] - p) / ((spots - p) ** 2).sum(axis=1)
            miss = p + along[:, None] * (spots - p) - drones[j]
            free &= (miss**2).sum(axis=1) > CORE**2
        shares[i] = free.mean()
    return shares


def trunks_in_view(scene: Scene, lens: Lens) -> list[tuple[Vector, float, float, float]]:
    """Return for each trunk: direction to its axis, distance to the axis, radius, visible share.

    direction: (3,) camera frame, level. distance, radius: m. visible share: of the trunk's width at
    the camera's height, in the picture and not hidden. Leaning trunks, bushes, poles and people
    count as they are at the camera's height; branches do not count.
    """
    rows = []
    half = np.radians(lens.fov_deg) / 2
    view = (half, half * lens.height / lens.width)
    axes = _circles(scene.world, float(scene.p[2])) - [scene.p[0], scene.p[1], 0.0]
    angular = any(scene.world.get(kind) for kind in ("capsules", "spheres", "boxes"))
    occluders = Occluders(scene.world) if angular else None
    for i, (x, y, r) in enumerate(axes):
        d = float(np.hypot(x, y))
        if not r < d < 16.0:
            continue
        middle = np.arctan2(y, x)
        delta = np.arcsin(r / d) * np.linspace(-0.98, 0.98, 41)
        t = d * (np.cos(delta) - np.sqrt(np.maximum((r / d) ** 2 - np.sin(delta) ** 2, 0)))
        ray = np.stack([np.cos(middle + delta), np.sin(middle + delta), 0 * delta], axis=1)
        shown = seen(camera_rays(scene.q, ray), *view)
        for j, (ox, oy, other) in enumerate(axes):
            along = ray[:, 0] * ox + ray[:, 1] * oy
            off2 = ox * ox + oy * oy - along**2
            hit = (off2 < other**2) & (along > 0) & (j != i)
            shown &= ~(hit & (along - np.sqrt(np.maximum(other**2 - off2, 0)) < t))
        if occluders is not None:
            # A leaning trunk's own surface is up to 4 % of its radius nearer than the circle.
            ends = scene.p + ray * np.maximum(t - 0.03 - 0.05 * r, 0.0)[:, None]
            shown &= occluders.free(scene.p, ends)
        level = scene.in_camera(np.array([[np.cos(middle), np.sin(middle), 0.0]]))[0]
        rows.append((level, d, float(r), float(shown.mean())))
    return rows


def _circles(world: dict[str, Any], z: float) -> Vector:
    """Return x, y, radius (n,3) of the obstacles at the height z [m], without boxes, branches."""
    rows = [[c["x"], c["y"], c["radius"]] for c in world["cylinders"]]
    for c in world.get("capsules", []):
        a, b = np.array(c["a"]), np.array(c["b"])
        if c.get("kind") == "branch" or not min(a[2], b[2]) < z < max(a[2], b[2]):
            continue
        at = a + (b - a) * (z - a[2]) / (b[2] - a[2])
        rows.append([at[0], at[1], c["radius"]])
    for c in world.get("spheres", []):
        left = c["radius"] ** 2 - (z - c["centre"][2]) ** 2
        if left > 0.3 * c["radius"] ** 2:
            rows.append([*c["centre"][:2], float(np.sqrt(left))])
    return np.array(rows).reshape(-1, 3)


def _attitude(yaw: float, pitch: float, roll: float) -> Vector:
    return quaternion_from_euler(roll, pitch, yaw)


class _FreeSpace:
    """The space of a world that is free for drones."""

    def __init__(self, world: dict[str, Any]) -> None:
        self.occluders = Occluders(world)
        self.ground = Ground(world)
        self._round = {k: world.get(k, []) for k in ("capsules", "spheres")}

    def free(self, points: Vector, gap: float) -> NDArray[np.bool_]:
        """Return whether points (n,3) m are over `gap` [m] from obstacles, and off the ground."""
        c = self.occluders.cylinders
        away = np.hypot(points[:, :1] - c[:, 0], points[:, 1:2] - c[:, 1]) - c[:, 2]
        free: NDArray[np.bool_] = (away > gap).all(axis=1)
        free &= points[:, 2] - self.ground.height(points[:, 0], points[:, 1]) > 0.4
        free &= surface_distance(points, self._round) > gap
        for low, high in self.occluders.boxes:
            outside = np.maximum(np.maximum(low - points, points - high), 0.0)
            free &= (outside**2).sum(axis=1) > gap**2
        return free

    def free_place(self, rng: np.random.Generator) -> Vector:
        """Return a random place (3,) m for a camera."""
        while True:
            p = np.array([*rng.uniform(-27, 27, 2), rng.uniform(0.8, 4.0)])
            p[2] += self.ground.height(p[0], p[1])
            if self.free(p[None], 0.3)[0]:
                return p


def _around(
    rng: np.random.Generator, room: _FreeSpace, p: Vector, q: Vector, count: int, reach: float
) -> Vector:
    """Return up to `count` places (m,3) m of drones around the view from p."""
    forward = (rotation(q) @ R_BC)[:, 2]
    drones: list[Vector] = []
    for _ in range(200):
        if len(drones) >= count:
            break
        yaw = np.arctan2(forward[1], forward[0]) + np.radians(rng.uniform(-95, 95))
        up = np.radians(rng.normal(0, 8))
        flat = np.array([np.cos(yaw) * np.cos(up), np.sin(yaw) * np.cos(up), np.sin(up)])
        d = p + rng.uniform(0.5, reach) * flat
        apart = all(np.linalg.norm(d - o) > 0.5 for o in drones)
        if apart and d[2] < 6.0 and room.free(d[None], 0.2)[0]:
            drones.append(d)
    return np.array(drones).reshape(-1, 3)


@dataclass(frozen=True)
class _Path:
    """Position (k,3) m, velocity (k,3) m/s and attitude (k,4) over time."""

    p: Vector
    v: Vector
    q: Vector

    @staticmethod
    def own(rng: np.random.Generator, t: Vector) -> _Path:
        """Return a cruise at about 1.5 m/s with slow bends and a sweeping line of sight."""
        heading = rng.uniform(-np.pi, np.pi) + 0.3 * np.sin(0.4 * t + rng.uniform(0, 6))
        speed = 1.5 + 0.3 * np.sin(0.7 * t + rng.uniform(0, 6))
        v = np.stack([speed * np.cos(heading), speed * np.sin(heading), 0.2 * np.sin(t)], axis=1)
        start = np.array([*rng.uniform(-16, 16, 2), rng.uniform(1.5, 2.5)])
        return _Path._of(t, start, v, heading + 0.6 * np.sin(1.5 * t + rng.uniform(0, 6)))

    @staticmethod
    def beside(rng: np.random.Generator, t: Vector, own: _Path) -> _Path:
        """Return a path beside `own`: its velocity plus a weave of up to about 1 m/s²."""
        swing, rate = rng.uniform(0.1, 0.8, 3) * [1, 1, 0.3], rng.uniform(0.4, 1.6, 3)
        v = own.v + swing * np.cos(rate * t[:, None] + rng.uniform(0, 6, 3))
        start = own.p[0] + rng.uniform([-4, -4, -0.7], [8, 4, 0.7])
        return _Path._of(t, start, v, np.arctan2(v[:, 1], v[:, 0]) + rng.uniform(-1, 1))

    @staticmethod
    def _of(t: Vector, start: Vector, v: Vector, yaw: Vector) -> _Path:
        dt = float(t[1] - t[0])
        p = start + np.cumsum(v, axis=0) * dt
        a = np.gradient(v, dt, axis=0)
        forward = a[:, 0] * np.cos(yaw) + a[:, 1] * np.sin(yaw)
        left = a[:, 1] * np.cos(yaw) - a[:, 0] * np.sin(yaw)
        tilt = zip(yaw, np.arctan(forward / GRAVITY), -np.arctan(left / GRAVITY), strict=True)
        return _Path(p, v, np.array([_attitude(*angles) for angles in tilt]))


def _scene_at(
    world: dict[str, Any], room: _FreeSpace, own: _Path, others: list[_Path], k: int, lens: Lens
) -> Scene:
    drones = np.array([o.p[k] for o in others])
    shares = visible_shares(own.p[k], own.q[k], drones, room.occluders, lens)
    return Scene(
        world,
        own.p[k],
        own.q[k],
        drones,
        np.array([o.q[k] for o in others]),
        np.array([o.v[k] for o in others]),
        np.arange(len(others)),
        shares,
        k / 10,
        own.v[k],
    )
