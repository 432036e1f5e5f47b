"""Camera pictures, rendered from the truth, with what the companion found in them."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from mavlink_bridge.shared.arrays import Vector
from sitl_sim.figures.belief import Belief
from sitl_sim.scenarios.scenario import Scenario
from sitl_sim.scenarios.sensing import lens_of
from sitl_sim.sensors.renderers import make_renderer

_GREEN, _BROWN = (80, 255, 80), (60, 150, 255)  # BGR


class Pictures:
    """Renders pictures and marks detections in them."""

    def __init__(self, scenario: Scenario, world: dict[str, Any]) -> None:
        s = scenario.sensing
        self._lens = lens_of(s)
        self._radius = world["drone_radius"]
        self._scale = 1.0
        self._renderer = make_renderer(
            world, scenario.world.look, scenario.drones.look, scenario.seed, self._lens
        )

    def take(
        self, p: Vector, q: Vector, drone: int, belief: Belief | None, scale: float = 1.0
    ) -> Any:
        """Return the picture (H,W,3) uint8 BGR of a drone's camera, of `scale` its size.

        p, q: (N,3) m and (N,4), places and attitudes of all drones in the world.
        """
        image = self._renderer.render(p[drone], q[drone], p, q)
        self._scale = scale
        if scale != 1.0:
            image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
        if belief is not None:
            for *direction, distance, _ in belief.record["trunks"]:
                self._mark(image, np.array(direction), 0.3, f"{distance:.1f}", _BROWN)
            for *direction, distance, _ in belief.record["detections"]:
                size = self._radius / max(distance, self._radius)
                self._mark(image, np.array(direction), size, f"{distance:.1f}", _GREEN)
        return image

    def _mark(
        self, image: Any, direction: Vector, size: float, text: str, colour: tuple[int, int, int]
    ) -> None:
        """Draw a ring of angular radius `size` [rad] around a direction in the camera frame."""
        k = self._scale
        u, v = (k * self._lens.project(direction)[0]).round().astype(int).tolist()
        radius = max(round(k * size * self._lens.f), 4)
        cv2.circle(image, (u, v), radius, colour, 1, cv2.LINE_AA)
        cv2.putText(
            image, text, (u + radius, v), cv2.FONT_HERSHEY_PLAIN, 0.9, colour, 1, cv2.LINE_AA
        )
