"""Drones and obstacles in a picture by one pass of the packaged network (`eyes`)."""

from __future__ import annotations

from pathlib import Path

from companion.perception.camera import Camera
from companion.perception.config import SensingConfig
from companion.perception.eyes import PACKAGED, SCENE, Eyes, Look
from companion.perception.feet import FootFinder
from companion.perception.heat_map import HeatMap
from companion.perception.panorama import LEVEL_GROUND
from companion.types import Detection, Image, Trunk
from mavlink_bridge.shared.arrays import Vector


class NetworkSearch:
    """The network and what its output is read by.

    clarity: 0…1, of the newest picture that was searched for obstacles, as `FootFinder` has it.

    Raises:
        ModelError: a model file that cannot be used.
    """

    def __init__(self, camera: Camera, sensing: SensingConfig) -> None:
        own = sensing.model if sensing.detector not in ("cnn", "yolo") else None
        self._eyes = Eyes(Path(own) if own else PACKAGED)
        self._heat_map = HeatMap(camera, sensing.network)
        self._feet = FootFinder(camera, sensing.feet, SCENE)
        self._look: Look | None = None

    @property
    def clarity(self) -> float:
        """Return the clarity."""
        return self._feet.clarity

    def look(self, image: Image) -> None:
        """Run the network on image (H,W,3) uint8 BGR.

        Raises:
            SenselessOutput: an output that is not finite.
        """
        self._look = self._eyes.look(image)

    def detect(self, image: Image) -> list[Detection]:
        """Return the drones in image (H,W,3) uint8 BGR, nearest first."""
        self.look(image)
        return self.drones()

    def drones(self) -> list[Detection]:
        """Return the drones in the newest picture, nearest first."""
        return [] if self._look is None else self._heat_map.read(self._look.drones)

    def find(self, image: Image, gravity_c: Vector, altitude: float) -> list[Trunk]:
        """Return the obstacles in image (H,W,3) uint8 BGR, nearest first; as `trunks`."""
        self.look(image)
        return self.trunks(gravity_c, altitude)

    def trunks(
        self, gravity_c: Vector, altitude: float, rise_c: Vector = LEVEL_GROUND
    ) -> list[Trunk]:
        """Return the obstacles in the newest picture, nearest first; see `FootFinder.find`."""
        if self._look is None:
            return []
        return self._feet.find(self._look.scene, gravity_c, altitude, rise_c)
