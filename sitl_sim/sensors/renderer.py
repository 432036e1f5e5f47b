"""A drone's camera: a 160° fisheye picture, and depth.

`Renderer` holds the static world and its textures; `render` is a pure function of pose, neighbours
and frame seed, safe to call from many threads at once (the kernels release the GIL).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sitl_sim.sensors import textures
from sitl_sim.sensors.drones import Look, draw_drones, stack_parts
from sitl_sim.sensors.fisheye import R_BC, Float32, Float64, Lens, rotation
from sitl_sim.sensors.scene import paint
from sitl_sim.sensors.sensor import NOISE_BANK, depth_image, develop
from sitl_sim.sensors.tables import (
    BINS,
    EBINS,
    FIELDS,
    LAYERS,
    box_lists,
    ground_table,
    trunk_table,
)
from sitl_sim.sensors.textures import UInt8
from sitl_sim.worlds.ground import Ground

HAZE = np.array([222.0, 216.0, 206.0], np.float32)  # BGR of the far distance
SUN = np.array([0.52, -0.43, 0.738])
SUN = SUN / np.linalg.norm(SUN)
MACRO_SIZE = 512  # texels along a side of the map of light and moss


@dataclass(frozen=True)
class Sensor:
    """Degradations by the image sensor and its lens.

    noise: grey levels, 1 σ at mid brightness. blur: σ of a Gaussian [px] (focus, rain).
    exposure: gain. vignette: loss of light at the image's corner, 0…1.
    """

    noise: float = 2.5
    blur: float = 0.0
    exposure: float = 1.0
    vignette: float = 0.25


@dataclass(frozen=True)
class _View:
    """Per-frame tables of the static scene for one camera pose."""

    p: Float64
    r_wc: Float64
    hill: Float32
    table: Float32
    count: NDArray[np.int32]
    start: Any
    which: Any


def _bin_directions() -> Float64:
    """Return the unit vector (BINS,2) in the middle of each diamond-angle bin."""
    a = (np.arange(BINS) + 0.5) * 4 / BINS - 2
    front = np.abs(a) <= 1
    x = np.where(front, 1 - np.abs(a), 1 - np.abs(a))
    y = np.where(front, a, np.copysign(2 - np.abs(a), a))
    return np.stack([x, y], axis=1) / np.hypot(x, y)[:, None]


class Renderer:
    """Pictures of one world. Thread-safe and deterministic: same arguments, same bytes."""

    def __init__(
        self,
        world: Mapping[str, Any],
        width: int = 640,
        height: int = 400,
        fov_deg: float = 160.0,
        *,
        seed: int = 0,
        sensor: Sensor | None = None,
        drone_radius: float | None = None,
        looks: Sequence[Look] | None = None,
        lens: Lens | None = None,
    ) -> None:
        """Build textures and tables.

        Args:
            world: as `world.json`: cylinders {x, y, radius, height?}, boxes {min, max}, terrain
                and drone_radius. Ground is painted as the plane below the camera: a terrain of one
                slope is shown as it is, hills are not.
            width: px.
            height: px.
            fov_deg: degrees over the width.
            seed: of textures, tints and noise.
            sensor: noise, blur, exposure, vignette.
            drone_radius: m, centre to propeller tip; None: the world's, else 0.2.
            lens: instead of width, height and fov_deg.
            looks: appearance of drone i is looks[i % len(looks)]; None: dark with a magenta ball.
        """
        rng = np.random.default_rng([seed, 0x5EED])
        self._terrain = Ground(dict(world))
        self.lens = lens or Lens(width, height, fov_deg)
        self.sensor = sensor or Sensor()
        radius = drone_radius if drone_radius is not None else world.get("drone_radius", 0.2)
        self._looks = list(looks or [Look()])
        self._parts = stack_parts(self._looks, float(radius))
        self._cylinders = np.array(
            [
                [c["x"], c["y"], c["radius"], min(float(c.get("height") or 100.0), 100.0)]
                for c in world.get("cylinders", [])
            ],
            float,
        ).reshape(-1, 4)
        self._boxes = np.array(
            [[*b["min"], *b["max"]] for b in world.get("boxes", [])], np.float32
        ).reshape(-1, 6)
        n = len(self._cylinders)
        base = np.array([0.70, 0.82, 0.92]) * rng.uniform(0.82, 1.12, (n, 1))
        self._tint = np.concatenate(
            [base + rng.normal(0, 0.03, (n, 3)), rng.random((n, 1))], axis=1
        )
        self._bins = _bin_directions()
        self._ground = textures.packed(textures.ground(rng))
        self._palette = textures.packed(textures.palette(rng)).ravel()
        self._bark = textures.bark(rng).ravel()
        self._wall = textures.wall(rng).ravel()
        self._sky = textures.packed(textures.sky(rng, HAZE))
        low, high = -32.0, 32.0
        if n:
            low = float((self._cylinders[:, :2] - 8.0).min())
            high = float((self._cylinders[:, :2] + 8.0).max())
        size = min(max(high - low, 40.0), 160.0)
        self._macro = textures.packed(
            textures.ground_light(rng, self._cylinders, SUN, np.array([low, low]), size, MACRO_SIZE)
        )
        self._macro_frame = np.array([low, low, MACRO_SIZE / size], np.float32)
        noise = np.clip(rng.standard_normal(NOISE_BANK, np.float32) * 32, -127, 127)
        self._noise = np.round(noise).astype(np.int8)
        self._lens_of: dict[tuple[int, int, float], Lens] = {}

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
    ) -> UInt8:
        """Render (height, width, 3) uint8 BGR from p_wc (3,) [m, W] with body attitude q_wb (4,).

        drones_p: (m,3) [m, W]. drones_q: (m,4) body → world. The drone within 5 cm of the camera
        carries it and is not drawn, so the whole swarm may be passed. frame_seed: of the noise.
        drones_id: (m,) index of each drone's look, default 0, 1, …. out: written to if given.
        """
        lens = self.lens
        view = self._view(p_wc, q_wb, lens)
        raw = np.empty((lens.height, lens.width, 3), np.uint8)
        elevations = np.empty((2, EBINS), np.float32)
        pixel = 1.0 / lens.f
        ground_table(float(view.hill[2]), pixel, elevations)
        paint(
            lens.rays,
            view.r_wc.astype(np.float32),
            view.p.astype(np.float32),
            view.table,
            view.count,
            elevations,
            view.hill,
            self._boxes,
            view.start,
            view.which,
            self._ground,
            self._palette,
            self._macro,
            self._macro_frame,
            self._bark,
            self._wall,
            self._sky,
            HAZE,
            np.float32(pixel),
            raw,
        )
        self._draw(view, lens, drones_p, drones_q, drones_id, raw, np.empty((0, 0), np.float32))
        if self.sensor.blur > 0.0:
            raw = cv2.GaussianBlur(raw, (0, 0), self.sensor.blur)  # type: ignore[assignment]
        if out is None:
            out = np.empty_like(raw)
        s = self.sensor
        offset = int(np.random.default_rng([frame_seed & 0xFFFFFFFF]).integers(NOISE_BANK))
        develop(raw, self._noise, offset, s.noise / 32, s.exposure, s.vignette, out)
        return out

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
        """Return the distance (height, width) along each pixel's ray [m]; inf: sky."""
        key = (width, height, fov_deg or self.lens.fov_deg)
        if key not in self._lens_of:
            self._lens_of[key] = Lens(*key) if fov_deg else self.lens.scaled(width, height)
        lens = self._lens_of[key]
        view = self._view(p_wc, q_wb, lens)
        out = np.empty((height, width), np.float32)
        depth_image(
            lens.rays,
            view.r_wc.astype(np.float32),
            view.p.astype(np.float32),
            view.hill,
            view.table,
            view.count,
            self._boxes,
            view.start,
            view.which,
            out,
        )
        self._draw(view, lens, drones_p, drones_q, None, np.empty((0, 0, 3), np.uint8), out)
        return out

    def _view(self, p_wc: Float64, q_wb: Float64, lens: Lens) -> _View:
        p = np.array(p_wc, float)
        level, east, north = (float(v) for v in self._terrain.plane(p[0], p[1]))
        # The picture of a camera below the ground would be meaningless.
        p[2] = max(p[2], level + 0.02)
        hill = np.array([east, north, p[2] - level], np.float32)
        table = np.empty((LAYERS, BINS, FIELDS), np.float32)
        count = np.empty(BINS, np.int32)
        trunk_table(
            p, self._cylinders, self._tint, self._bins, SUN, HAZE, 1.0 / lens.f, table, count
        )
        start = np.zeros(BINS + 1, np.int32)
        which = np.empty(BINS * len(self._boxes), np.int16)
        if len(self._boxes):
            box_lists(p, self._boxes.astype(float), start, which)
        return _View(p, rotation(np.asarray(q_wb, float)) @ R_BC, hill, table, count, start, which)

    def _draw(
        self,
        view: _View,
        lens: Lens,
        drones_p: Float64,
        drones_q: Float64,
        drones_id: Sequence[int] | None,
        image: UInt8,
        depth: Float32,
    ) -> None:
        positions = np.array(drones_p, float).reshape(-1, 3)
        if not len(positions):
            return
        attitudes = np.array([rotation(q) for q in np.reshape(drones_q, (-1, 4))])
        ids = np.arange(len(positions)) if drones_id is None else np.asarray(drones_id)
        draw_drones(
            lens.rays,
            view.p,
            view.r_wc,
            positions,
            attitudes,
            ids % len(self._looks),
            self._parts,
            SUN,
            HAZE,
            lens.f,
            lens.numbers,
            view.hill,
            view.table,
            view.count,
            self._boxes,
            view.start,
            view.which,
            image,
            depth,
        )
