"""One drone's camera picture, rendered from the truth, with its companion's detections."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from mavlink_bridge.shared.arrays import Vector
from sitl_sim.figures.belief import Belief
from sitl_sim.scenarios.scenario import Scenario
from sitl_sim.scenarios.sensing import lens_of
from sitl_sim.sensors.renderers import make_renderer
from sitl_sim.viewer.sources import Moment

_GREEN, _BROWN = (80, 255, 80), (60, 150, 255)  # BGR


class Pictures:
    """Renders pictures and marks detections in them."""

    def __init__(self, scenario: Scenario, world: dict[str, Any]) -> None:
        s = scenario.sensing
        self._focal = s.width / np.radians(s.fov_deg)  # px per rad, equidistant
        self._centre = (s.width / 2, s.height / 2)
        self._radius = world["drone_radius"]
        self._renderer = make_renderer(
            world, scenario.world.look, scenario.drones.look, scenario.seed, lens_of(s)
        )

    def take(self, moment: Moment, drone: int, belief: Belief | None) -> Any:
        """Return the picture (H,W,3) uint8 RGB of a drone's camera."""
        image = self._renderer.render(moment.p[drone], moment.q[drone], moment.p, moment.q)
        if belief is not None:
            for *direction, distance, _ in belief.record["trunks"]:
                self._mark(image, np.array(direction), 0.3, f"{distance:.1f}", _BROWN)
            for *direction, distance, _ in belief.record["detections"]:
                size = self._radius / max(distance, self._radius)
                self._mark(image, np.array(direction), size, f"{distance:.1f}", _GREEN)
        return image[..., ::-1]

    def _mark(
        self, image: Any, direction: Vector, size: float, text: str, colour: tuple[int, int, int]
    ) -> None:
        """Draw a ring of angular radius `size` [rad] around a direction in the camera frame."""
        x, y, z = direction / max(float(np.linalg.norm(direction)), 1e-9)
        theta, rho = np.arctan2(np.hypot(x, y), z), max(float(np.hypot(x, y)), 1e-9)
        u = round(self._centre[0] + self._focal * theta * x / rho)
        v = round(self._centre[1] + self._focal * theta * y / rho)
        radius = max(round(size * self._focal), 4)
        cv2.circle(image, (u, v), radius, colour, 1, cv2.LINE_AA)
        cv2.putText(
            image, text, (u + radius, v), cv2.FONT_HERSHEY_PLAIN, 0.9, colour, 1, cv2.LINE_AA
        )
