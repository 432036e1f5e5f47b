"""The renderer of a flight, by the names of its looks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from sitl_sim.sensors.drones import Look
from sitl_sim.sensors.fisheye import Float32, Float64, Lens
from sitl_sim.sensors.looks import bodies
from sitl_sim.sensors.looks.catalogue import PLAIN
from sitl_sim.sensors.renderer import Renderer
from sitl_sim.sensors.textures import UInt8

DRONE_RADIUS = 0.2  # m, where a world says no other


class Pictures(Protocol):
    """What renders a world's pictures: `Renderer` in the plain look, `LookRenderer` in others."""

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
        """Render (h,w,3) uint8 BGR, as `Renderer.render`."""

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
        """Return the distance (height,width) along each pixel's ray [m]; inf: sky."""


def make_renderer(world: dict[str, Any], look: str, drones: str, seed: int, lens: Lens) -> Pictures:
    """Return the renderer of a world in a look, with drones `ball`, `bare` or `mixed`.

    world: as `world.json`; of its `drone_radius` by name, drone i has the i-th.
    """
    if look == PLAIN:
        return Renderer(world, seed=seed, lens=lens)
    from sitl_sim.sensors.looks.renderer import LookRenderer

    return LookRenderer(world, look, lens, seed, flown_bodies(world, drones, seed))


def flown_bodies(world: dict[str, Any], drones: str, seed: int) -> list[bodies.Body | Look]:
    """Return the bodies of a flight's drones: bare: all of one kind; mixed: a kind for each."""
    if drones == "ball":
        return [Look()]
    radius = world.get("drone_radius", DRONE_RADIUS)
    radii = list(radius.values()) if isinstance(radius, dict) else [float(radius)]
    rng = np.random.default_rng([seed, 0xB0D1])
    if drones == "bare":
        kind, look = str(rng.choice(bodies.KINDS)), int(rng.integers(1 << 31))
        return [bodies.draw(kind, r, np.random.default_rng(look)) for r in radii]
    kinds = [str(k) for k in rng.permutation(np.resize(bodies.KINDS, max(len(radii), 10)))]
    sizes = np.resize(radii, len(kinds))
    return [bodies.draw(k, float(r), rng) for k, r in zip(kinds, sizes, strict=True)]
