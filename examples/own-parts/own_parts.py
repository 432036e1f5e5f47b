"""A controller, a detector, a gaze and a world of one's own."""

import math

import cv2
import numpy as np

from companion.control.baselines import ControllerSetup
from companion.control.baselines.surroundings import Surroundings
from companion.guidance.gaze import Gaze, GazeConfig
from companion.perception.detectors import DetectorSetup
from companion.types import Detection
from sitl_sim.worlds.world import WorldConfig


class KeepRight:
    """A controller of a few lines: flies to its goal, and turns right of all that is near."""

    def __init__(self, setup: ControllerSetup) -> None:
        self.reach = float(setup.options.get("reach", 3.0))  # m
        self.strength = float(setup.options.get("strength", 1.5))  # m/s

    def velocity(self, around: Surroundings) -> np.ndarray:
        """Return the velocity (2,) m/s to fly next; it is bounded and tracked for us."""
        v = around.migration.copy()
        for offset in [*around.neighbours, *around.surfaces]:  # (2,) m, from the drone
            distance = max(float(np.linalg.norm(offset)), 0.1)
            if distance < self.reach and offset @ around.migration > 0.0:
                away = -offset / distance
                left = np.array([-away[1], away[0]])  # seen along our way, this is our right
                v += self.strength * (1.0 - distance / self.reach) * (away + left)
        return v


class Blobs:
    """A detector of bright magenta blobs of a known radius."""

    def __init__(self, setup: DetectorSetup) -> None:
        self.camera = setup.camera
        self.radius = float(setup.options.get("radius", 0.15))  # m

    def detect(self, image: np.ndarray) -> list[Detection]:
        """Return the drones in image (H,W,3) uint8 BGR, in the camera's frame."""
        b, g, r = (image[..., i].astype(int) for i in range(3))
        mask = ((b - g > 60) & (r - g > 60)).astype(np.uint8)
        found = []
        _, _, boxes, centres = cv2.connectedComponentsWithStats(mask)
        for area, centre in zip(boxes[1:, cv2.CC_STAT_AREA], centres[1:], strict=True):
            if area >= 6:
                ray = self.camera.unproject(centre[None])[0]
                angle = math.sqrt(area / math.pi) / self.camera.fx
                found.append(Detection(ray, self.radius / angle, sigma_range=0.2))
        return found


class Straight(Gaze):
    """A gaze that looks where the drone flies, without a sweep."""

    def __init__(self, config: GazeConfig) -> None:
        super().__init__(config.model_copy(update={"mean": 0.0, "sigma": 0.0}))


def avenue(world: WorldConfig, rng: np.random.Generator) -> dict:
    """Return two rows of trunks along x; `world.options.trees` in each."""
    trees = int(world.options.get("trees", 4))
    places = [(4.0 * i + rng.uniform(-0.5, 0.5), side) for i in range(trees) for side in (-3, 3)]
    return {"cylinders": [{"x": x, "y": float(y), "radius": 0.4} for x, y in places]}
