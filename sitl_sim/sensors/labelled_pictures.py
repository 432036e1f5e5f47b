"""Pictures with per-pixel truth in memory, to train perception: a stream without an end.

from sitl_sim.sensors.labelled_pictures import stream
for labelled in stream(seed=1): ...
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import quaternion_from_euler
from sitl_sim.sensors.drones import Look
from sitl_sim.sensors.fisheye import R_BC, Lens, rotation
from sitl_sim.sensors.looks import bodies, look
from sitl_sim.sensors.looks.renderer import LookRenderer
from sitl_sim.sensors.scenes import RADIUS, Scene, varied_scenes
from sitl_sim.worlds.ground import Ground

PER_WORLD = 25  # pictures
PER_CROWDED_WORLD = 50  # building a world takes as long as 40 pictures of it
SIZES = (0.05, 0.3)  # m, radius to the propeller tips of mixed drones
_BODIES = 12  # in one world


@dataclass(frozen=True)
class Labelled:
    """One picture and its truth.

    image: (h,w,3) uint8 BGR. depth: (h,w) float16, m along the ray to what stands still; sky: inf.
    seen: (h,w) uint8, values of `looks.shapes.Seen`. owner: (h,w) int8, number of the drone, −1:
    none. altitude: m over the ground below the camera. Of each drone (m,…): pixel (m,2) u, v of
    its centre; size (m,) px, its radius as the lens images it there; range (m,) m; radius (m,) m;
    visible (m,) share of its pixels not hidden; area (m,) px that show.
    """

    image: NDArray[np.uint8]
    depth: NDArray[np.float16]
    seen: NDArray[np.uint8]
    owner: NDArray[np.int8]
    altitude: float
    pixel: Vector
    size: Vector
    range: Vector
    radius: Vector
    visible: Vector
    area: Vector
    scene: Scene


def render_labelled(
    renderer: LookRenderer, scene: Scene, frame_seed: int, radii: Vector, *, strangers: int = 0
) -> Labelled:
    """Render a scene with its truth; radii (k,): m, of the renderer's bodies in their order."""
    rng = np.random.default_rng([frame_seed, 84])
    turning = rng.normal(0, 0.6, 3) if rng.random() < 0.6 else np.zeros(3)
    picture = renderer.picture(
        scene.p,
        scene.q,
        scene.drones,
        scene.attitudes,
        frame_seed,
        drones_id=scene.ids.tolist(),
        omega=turning,
        strangers=strangers,
    )
    offsets = scene.in_camera(scene.drones - scene.p)
    ranges = np.linalg.norm(offsets, axis=1)
    own = radii[scene.ids % len(radii)]
    ground = float(Ground(scene.world).height(scene.p[0], scene.p[1]))
    return Labelled(
        picture.image,
        picture.depth.astype(np.float16),
        picture.seen,
        picture.owner,
        float(scene.p[2]) - ground,
        *_imaged(offsets, own, renderer.lens),
        ranges,
        own,
        picture.shown[:, 1] / np.maximum(picture.shown[:, 0], 1e-6),
        picture.shown[:, 1],
        scene,
    )


def _imaged(offsets: Vector, radii: Vector, lens: Lens) -> tuple[Vector, Vector]:
    """Return pixels (m,2) and sizes (m,) [px] of drones at offsets (m,3) in the camera frame."""
    fx, fy, cx, cy, *k = lens.numbers
    rho = np.hypot(offsets[:, 0], offsets[:, 1])
    theta = np.arctan2(rho, offsets[:, 2])
    t2 = theta * theta
    bent = theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))))
    scale = (bent / np.maximum(rho, 1e-9))[:, None]
    pixel: Vector = np.array([cx, cy]) + scale * offsets[:, :2] * [fx, fy]
    ranges = np.maximum(np.linalg.norm(offsets, axis=1), 1e-6)
    size = radii / ranges * lens.f * np.sqrt(theta / np.maximum(np.sin(theta), 1e-3))
    return pixel, size


def _crowded(rng: np.random.Generator, scene: Scene, lens: Lens, count: int, reach: float) -> Scene:
    """Return the scene with up to `count` other drones, spread over the view, none before another.

    Half of them are near the horizon, where neighbours fly.
    """
    to_world = (rotation(scene.q) @ R_BC).T
    ground = Ground(scene.world)
    offsets: list[Vector] = []
    pixels, sizes = np.zeros((0, 2)), np.zeros(0)
    for n in range(3 * count):
        away = float(np.exp(rng.uniform(np.log(0.5), np.log(reach))))
        if n % 2:
            away = float(rng.uniform(0.5, reach))
            yaw, up = rng.uniform(-np.pi, np.pi), rng.normal(0, 0.15)
            ray = np.array([np.cos(yaw) * np.cos(up), np.sin(yaw) * np.cos(up), np.sin(up)])
            ray = ray @ to_world.T
        else:
            ray = lens.rays[:, rng.integers(lens.height), rng.integers(lens.width)].astype(float)
        pixel, size = _imaged(away * ray[None], np.full(1, RADIUS), lens)
        inside = (pixel[0] > 0).all() and (pixel[0] < [lens.width - 1, lens.height - 1]).all()
        apart = (np.linalg.norm(pixels - pixel, axis=1) > 1.1 * (sizes + size)).all()
        place = scene.p + away * ray @ to_world
        over = place[2] - ground.height(place[0], place[1]) > 1.2 * RADIUS
        if inside and apart and over and len(offsets) < count:
            offsets.append(place)
            pixels, sizes = np.vstack([pixels, pixel]), np.append(sizes, size)
    m = len(offsets)
    tilts = np.radians(rng.uniform(-25, 25, (m, 2)))
    attitudes = [
        quaternion_from_euler(roll, pitch, rng.uniform(-np.pi, np.pi)) for roll, pitch in tilts
    ]
    return replace(
        scene,
        drones=np.array(offsets).reshape(-1, 3),
        attitudes=np.array(attitudes).reshape(-1, 4),
        velocities=np.zeros((m, 3)),
        ids=rng.integers(0, _BODIES, m),
        visible=np.ones(m),
    )


def drawn_bodies(
    kind: str, rng: np.random.Generator, radius: float = RADIUS, count: int = _BODIES
) -> list[bodies.Body | Look]:
    """Return bodies of drones: `ball`, `bare` (any kind), `mixed` (and any size), or of one kind.

    Raises:
        ValueError: there is no such kind; the message names the valid ones.
    """
    known = ("ball", "bare", "mixed", *bodies.KINDS)
    if kind not in known:
        raise ValueError(f"no drones {kind!r}; valid: {', '.join(known)}")
    made: list[bodies.Body | Look] = []
    for _ in range(count):
        if kind == "ball":
            made.append(Look())
            continue
        one = str(rng.choice(bodies.KINDS)) if kind in ("bare", "mixed") else kind
        own = float(np.exp(rng.uniform(*np.log(SIZES)))) if kind == "mixed" else radius
        made.append(bodies.draw(one, own, rng))
    return made


def stream(
    seed: int,
    name: str = "random",
    drones: str = "mixed",
    lens: Lens | None = None,
    reach: float = 13.0,
    tilt_deg: float = 35.0,
    crowd: int = 0,
    per_world: int | None = None,
    open_ground: float = 0.0,
) -> Iterator[Labelled]:
    """Yield labelled pictures without an end; each `per_world` are of one world and one look.

    name: of the look. drones: as `drawn_bodies`. reach: m, of the farthest drone. crowd: drones
    that two pictures of three show, spread over the view; 0: no such pictures. open_ground: share
    of worlds with few trunks or none, where the horizon shows.
    """
    each = per_world or (PER_CROWDED_WORLD if crowd else PER_WORLD)
    lens = lens or Lens(640, 400)
    rng = np.random.default_rng([seed, 85])
    while True:
        own = int(rng.integers(1 << 31))
        made = drawn_bodies(drones, rng)
        radii = np.array([b.radius if isinstance(b, bodies.Body) else RADIUS for b in made])
        renderer: LookRenderer | None = None
        for k, scene in enumerate(varied_scenes(each, own, lens, tilt_deg, reach, open_ground)):
            if renderer is None:
                renderer = LookRenderer(scene.world, look.draw(name, own), lens, own, made)
            moved = replace(scene, ids=scene.ids + k)
            if crowd and k % 3:
                moved = _crowded(rng, scene, lens, crowd, reach)
            strangers = int(rng.integers(1, 5)) if rng.random() < 0.4 else 0
            yield render_labelled(renderer, moved, own + k, radii, strangers=strangers)
