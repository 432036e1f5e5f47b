"""Pictures of one world in one look, with depth and classes of what they show.

Thread-safe and deterministic, as `sensors.renderer.Renderer`, and called in the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sitl_sim.sensors.drones import Look
from sitl_sim.sensors.fisheye import R_BC, Float32, Float64, Lens, rotation
from sitl_sim.sensors.looks import painter, passes
from sitl_sim.sensors.looks.backdrop import ground_map, sky
from sitl_sim.sensors.looks.bodies import Body, bird, leaf, stack
from sitl_sim.sensors.looks.develop import (
    compressed,
    develop,
    exposure_gain,
    glare_of,
    lens_map,
    motion_blur,
    tone,
)
from sitl_sim.sensors.looks.hits import prepare
from sitl_sim.sensors.looks.look import WorldLook, draw
from sitl_sim.sensors.looks.overlay import overlay
from sitl_sim.sensors.looks.shapes import BOX, SPHERE, Seen, Shapes
from sitl_sim.sensors.looks.terrain import DIRECTIONS, STEPS, profile_of
from sitl_sim.sensors.looks.tiling import GROUP, TILE_PX, cones, order, tile_lists
from sitl_sim.sensors.sensor import NOISE_BANK
from sitl_sim.sensors.tables import BARK_TEXELS
from sitl_sim.sensors.textures import TILE

UInt8 = NDArray[np.uint8]
_NO_GLARE = np.zeros((0, 0), np.float32)
_UNCOMPRESSED = 95
_CLEAR = 3.5  # times the fog's range: nothing shows beyond


@dataclass(frozen=True)
class Picture:
    """A picture and its truth, each (h,w,…).

    image: (…,3) uint8 BGR. depth: m along the ray to the static scene, float32; sky: inf. seen:
    uint8 as `Seen`. owner: int8 number of the drone there, −1: none. shown: (m,2) pixels that each
    drone covers, without and with what hides it.
    """

    image: UInt8
    depth: Float32
    seen: UInt8
    owner: NDArray[np.int8]
    shown: Float64


@dataclass(frozen=True)
class _Grid:
    """The pixels of a lens: cones around its tiles and groups of tiles, rays of each tile.

    number: what the painter takes.
    """

    lens: Lens
    groups: Float64
    tiles: Float64
    rays: Float32
    number: Float32

    @classmethod
    def of(cls, lens: Lens, number: Float32) -> _Grid:
        """Return it; number: the painter's, but for the width of a pixel."""
        number = number.copy()
        number[passes.PIXEL] = 1 / lens.f
        groups, tiles = cones(lens.rays, TILE_PX * GROUP), cones(lens.rays, TILE_PX)
        return cls(lens, groups, tiles, painter.tiled(lens.rays), number)


class LookRenderer:
    """Renders a world in a look."""

    def __init__(
        self,
        world: dict[str, Any],
        look: WorldLook | str,
        lens: Lens,
        seed: int = 0,
        bodies: Sequence[Body | Look] | None = None,
    ) -> None:
        """Build what stays the same from picture to picture.

        Args:
            world: as `world.json`.
            look: drawn, or the name of one to draw by the seed.
            lens: of all pictures.
            seed: of everything that the look leaves open.
            bodies: drone i is bodies[i % len(bodies)]; None: dark with a magenta ball.
        """
        rng = np.random.default_rng([seed, 0x100D])
        self.lens = lens
        self.look = look if isinstance(look, WorldLook) else draw(look, seed)
        self._shapes = Shapes.of(world)
        self._finish = self._finished(rng)
        materials = [self.look.ground, self.look.second, self.look.leaves, self.look.wall]
        materials += self.look.barks
        self._texels = np.stack([m.texels for m in materials])
        self._colours = np.stack([m.colours for m in materials])
        self._sky = sky(rng, self.look.sky, self.look.light, self.look.fog)
        self._frame_map(rng)
        self._number = self._numbers(rng)
        radius = world.get("drone_radius", 0.2)
        radius = max(radius.values()) if isinstance(radius, dict) else float(radius)
        made = [b.parts() if isinstance(b, Body) else b.parts(radius) for b in bodies or [Look()]]
        self._parts = stack([*made, *(bird(rng) for _ in range(4)), *(leaf(rng) for _ in range(4))])
        self._bodies = len(made)
        self._terrain = _terrain(world)
        self._eighth = lens.scaled(lens.width // 8, lens.height // 8)
        self._grid = _Grid.of(lens, self._number)
        self._grids: dict[tuple[int, int, float | None], _Grid] = {}  # of depth images
        corners = lens.rays[2, [0, 0, -1, -1], [0, -1, 0, -1]]
        self._reach = float(np.arccos(np.clip(corners.min(), -1, 1)))
        camera = self.look.camera
        self._field = lens_map(rng, lens, camera)
        self._curve = tone(camera.gamma)
        noise = np.clip(rng.standard_normal(NOISE_BANK, np.float32) * 32, -127, 127)
        self._noise = np.round(noise).astype(np.int8)

    def render(
        self,
        p_wc: Float64,
        q_wb: Float64,
        drones_p: Float64,
        drones_q: Float64,
        frame_seed: int = 0,
        out: UInt8 | None = None,
        *,
        drones_id: Sequence[int] | None = None,
        omega: Float64 | None = None,
    ) -> UInt8:
        """Render (h,w,3) uint8 BGR, as `Renderer.render`; omega: (3,) rad/s of the body, B."""
        picture = self.picture(
            p_wc, q_wb, drones_p, drones_q, frame_seed, drones_id=drones_id, omega=omega
        )
        if out is None:
            return picture.image
        out[:] = picture.image
        return out

    def picture(
        self,
        p_wc: Float64,
        q_wb: Float64,
        drones_p: Float64,
        drones_q: Float64,
        frame_seed: int = 0,
        *,
        drones_id: Sequence[int] | None = None,
        omega: Float64 | None = None,
        strangers: int = 0,
    ) -> Picture:
        """Render a picture with its truth; strangers: birds and falling leaves to add."""
        p = np.array(p_wc, float)
        r_wc = rotation(np.asarray(q_wb, float)) @ R_BC
        raw, depth, seen = self._scene(p, r_wc, self._grid)
        rng = np.random.default_rng([frame_seed & 0xFFFFFFFF])
        offset = int(rng.integers(NOISE_BANK))
        places = np.array(drones_p, float).reshape(-1, 3)
        turns = np.array([rotation(q) for q in np.reshape(drones_q, (-1, 4))]).reshape(-1, 3, 3)
        ids = np.arange(len(places)) if drones_id is None else np.asarray(drones_id, int)
        which = ids % self._bodies
        own = len(places)
        if strangers:
            more = self._strangers(rng, strangers, p, r_wc)
            places, turns = np.vstack([places, more[0]]), np.concatenate([turns, more[1]])
            which = np.concatenate([which, more[2]])
        owner = np.full(depth.shape, -1, np.int8)
        shown = self._overlay(p, r_wc, self.lens, places, turns, which, depth, raw, owner)
        seen[owner >= 0] = Seen.DRONE
        seen[owner >= own] = Seen.BIRD
        owner[owner >= own] = -1
        image = self._developed(raw, r_wc, offset, omega)
        return Picture(image, depth, seen, owner, shown[:own])

    def depth(
        self,
        p_wc: Float64,
        q_wb: Float64,
        drones_p: Float64,
        drones_q: Float64,
        width: int = 160,
        height: int = 100,
        fov_deg: float | None = None,
    ) -> Float32:
        """Return the distance (height,width) along each pixel's ray [m], with drones; sky: inf."""
        grid = self._grids.get((width, height, fov_deg))
        if grid is None:
            lens = Lens(width, height, fov_deg) if fov_deg else self.lens.scaled(width, height)
            grid = self._grids[width, height, fov_deg] = _Grid.of(lens, self._number)
        p, r_wc, lens = np.array(p_wc, float), rotation(np.asarray(q_wb, float)) @ R_BC, grid.lens
        raw, depth, _ = self._scene(p, r_wc, grid)
        places = np.array(drones_p, float).reshape(-1, 3)
        turns = np.array([rotation(q) for q in np.reshape(drones_q, (-1, 4))]).reshape(-1, 3, 3)
        owner = np.full(depth.shape, -1, np.int8)
        which = np.arange(len(places)) % self._bodies
        self._overlay(p, r_wc, lens, places, turns, which, depth, raw, owner)
        for k, place in enumerate(places):
            depth[owner == k] = np.linalg.norm(place - p)
        return depth

    def _scene(self, p: Float64, r_wc: Float64, grid: _Grid) -> tuple[UInt8, Float32, UInt8]:
        """Return the static scene's light (h,w,3), depth and classes."""
        if self._terrain is None:
            p[2] = max(p[2], 0.02)
            profile = np.empty((0, 0, 0), np.float32)
        else:
            profile = np.empty((3, DIRECTIONS, STEPS), np.float32)
            profile_of(p, *self._terrain, profile)
        lens = grid.lens
        ranked, near = order(self._shapes.rows, p, max(_CLEAR * self.look.fog, 12.0))
        prims = prepare(self._shapes.rows, self._finish, ranked, near, p)
        lists, count = tile_lists(self._shapes.rows, ranked, p, r_wc, grid.groups, grid.tiles)
        shape = (lens.height, lens.width)
        raw, depth = np.empty((*shape, 3), np.uint8), np.empty(shape, np.float32)
        seen = np.empty(shape, np.uint8)
        painter.paint(
            grid.rays,
            r_wc.astype(np.float32),
            p.astype(np.float32),
            prims,
            lists,
            count,
            grid.number,
            self._texels,
            self._colours,
            self._map,
            self._sky,
            profile,
            raw,
            depth,
            seen,
        )
        return raw, depth, seen

    def _overlay(
        self,
        p: Float64,
        r_wc: Float64,
        lens: Lens,
        places: Float64,
        turns: Float64,
        which: NDArray[np.int_],
        depth: Float32,
        raw: UInt8,
        owner: NDArray[np.int8],
    ) -> Float64:
        light, haze = self.look.light, self.look.sky.haze.astype(np.float32)
        if not len(places):
            return np.zeros((0, 2))
        gains = np.tile(0.9 * light.ambient + 0.6 * light.direct, (len(places), 1))
        shown: Float64 = overlay(
            lens.rays,
            p,
            r_wc,
            places,
            turns,
            which,
            self._parts,
            gains.astype(np.float32),
            light.sun,
            haze,
            self.look.fog,
            lens.f,
            lens.numbers,
            self._reach,
            depth,
            raw,
            owner,
        )
        return shown

    def _developed(self, raw: UInt8, r_wc: Float64, offset: int, omega: Float64 | None) -> UInt8:
        camera, light = self.look.camera, self.look.light
        if omega is not None:
            raw = motion_blur(raw, self.lens, R_BC.T @ np.asarray(omega, float), camera.shutter)
        if camera.blur > 0.3:
            import cv2

            raw = cv2.GaussianBlur(raw, (0, 0), camera.blur)  # type: ignore[assignment]
        gain = exposure_gain(raw, camera)
        sunny = float(light.direct.max()) > 0.0
        glare = _NO_GLARE
        if camera.glare > 0.05 and sunny:
            glare = glare_of(self.lens, self._eighth, r_wc.T @ light.sun, camera.glare)
        out = np.empty_like(raw)
        develop(
            raw,
            self._field,
            glare,
            (camera.gains * gain).astype(np.float32),
            camera.saturation,
            self._curve,
            self._noise,
            offset,
            camera.noise / 32,
            out,
        )
        return compressed(out, camera.quality) if camera.quality < _UNCOMPRESSED else out

    def _strangers(
        self, rng: np.random.Generator, count: int, p: Float64, r_wc: Float64
    ) -> tuple[Float64, Float64, NDArray[np.int_]]:
        """Return places, attitudes and parts of birds and leaves before the camera."""
        birds = rng.random(count) < 0.6
        away = np.where(birds, rng.uniform(2.0, 18.0, count), rng.uniform(0.4, 4.0, count))
        aim = rng.uniform([-1.1, -0.6], [1.1, 0.5], (count, 2))
        rays = np.stack([np.sin(aim[:, 0]), np.sin(aim[:, 1]), np.cos(aim[:, 0])], axis=1)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        places = p + away[:, None] * rays @ r_wc.T
        places[:, 2] = np.maximum(places[:, 2], 0.1)
        turns = np.array([rotation(rng.normal(size=4) * [2, 0.5, 0.5, 2]) for _ in range(count)])
        parts = self._bodies + np.where(birds, 0, 4) + rng.integers(0, 4, count)
        return places, turns, parts

    def _finished(self, rng: np.random.Generator) -> Float64:
        """Return (n,8) material, tiles around, texture offsets, tint, class of each shape."""
        rows, seen = self._shapes.rows, self._shapes.seen
        n, barks = len(rows), len(self.look.barks)
        finish = np.zeros((n, 8))
        bark = rng.choice(barks, n, p=_shares(barks, rng))
        finish[:, 0] = painter.FIRST_BARK + bark
        finish[rows[:, 0] == SPHERE, 0] = painter.LEAVES
        finish[rows[:, 0] == BOX, 0] = painter.WALL
        texels = np.where(rows[:, 0] == SPHERE, 150.0, float(BARK_TEXELS))
        finish[:, 1] = np.maximum(np.round(2 * np.pi * rows[:, 7] * texels / TILE), 1.0)
        finish[:, 2:4] = rng.uniform(0, 4, (n, 2))
        bright = rng.uniform(0.78, 1.18, (n, 1))
        finish[:, 4:7] = bright * np.exp(rng.normal(0, 0.04, (n, 3)))
        things = seen == Seen.THING  # clothes and paint: any colour
        finish[things, 4:7] = np.exp(rng.normal(0, 0.5, (int(things.sum()), 3)))
        finish[:, 7] = seen
        return finish

    def _frame_map(self, rng: np.random.Generator) -> None:
        rows = self._shapes.rows
        low, high = -32.0, 32.0
        if len(rows):
            flat = rows[:, [1, 2, 4, 5]]
            low, high = float(flat.min() - 8.0), float(flat.max() + 8.0)
        self._size = min(max(high - low, 40.0), 160.0)
        self._origin = np.array([low, low])
        self._map = ground_map(rng, rows, self.look, self._origin, self._size)

    def _numbers(self, rng: np.random.Generator) -> Float32:
        look, number = self.look, np.zeros(passes.NUMBERS, np.float32)
        number[passes.SUN : passes.SUN + 3] = look.light.sun
        number[passes.DIRECT : passes.DIRECT + 3] = look.light.direct
        number[passes.AMBIENT : passes.AMBIENT + 3] = look.light.ambient
        number[passes.HAZE : passes.HAZE + 3] = look.sky.haze
        number[passes.FOG], number[passes.DAPPLE] = look.fog, look.light.dapple
        number[passes.COVER] = 256 * min(look.canopy, 0.9)
        rows = self._shapes.rows
        upright = rows[rows[:, 0] < SPHERE]
        tops = upright[upright[:, 6] > 3.0, 6]
        number[passes.CANOPY] = 0.85 * tops.min() if len(tops) else rng.uniform(7, 14)
        number[passes.PIXEL] = 1 / self.lens.f
        number[passes.MACRO_X : passes.MACRO_X + 2] = self._origin
        number[passes.MACRO_SCALE] = len(self._map) / self._size
        return number


def _shares(count: int, rng: np.random.Generator) -> Float64:
    """Return how common each bark is: mostly one."""
    shares = rng.dirichlet(np.full(count, 0.5))
    result: Float64 = shares / shares.sum()
    return result


def _terrain(world: dict[str, Any]) -> tuple[Float64, Float64, Float64] | None:
    terrain = world.get("terrain")
    if terrain is None:
        return None
    x, y = (np.array(terrain[k], float) for k in "xy")
    return x, y, np.array(terrain["z"], float).reshape(len(y), len(x))
