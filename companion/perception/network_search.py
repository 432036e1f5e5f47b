"""Drones and obstacles in a picture: the packaged network (`eyes`), and a closer look at drones."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from companion.perception.background import MOST, Background, Moved
from companion.perception.camera import Camera
from companion.perception.closer_look import CloserLook
from companion.perception.config import SensingConfig
from companion.perception.eyes import PACKAGED, SCENE, Eyes, Look, at_its_size
from companion.perception.feet import FootFinder
from companion.perception.heat_map import HEIGHT, WIDTH, HeatMap, Peaks, peaks
from companion.perception.levels import Levels
from companion.perception.panorama import LEVEL_GROUND
from companion.types import Detection, Image, Trunk
from mavlink_bridge.shared.arrays import Vector

_NONE: Vector = np.zeros((0, 3))


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
        # It is trained on what the packaged network finds, and fits no other.
        closer = own is None and sensing.detector == "network"
        self._closer = CloserLook() if closer else None
        self._config = sensing.network
        self._levels = Levels(sensing.network.level)
        self._background = Background(camera.scaled(WIDTH, HEIGHT))
        self._decides = math.log(self._config.threshold / (1.0 - self._config.threshold))
        self._look: Look | None = None
        self._image: Image | None = None

    @property
    def clarity(self) -> float:
        """Return the clarity."""
        return self._feet.clarity

    @property
    def glances(self) -> bool:
        """Return whether known drones can be looked at in pictures that are not searched."""
        return self._closer is not None

    def look(self, image: Image) -> None:
        """Run the network on image (H,W,3) uint8 BGR.

        Raises:
            SenselessOutput: an output that is not finite.
        """
        self._image = at_its_size(image)
        self._look = self._eyes.look(self._image)
        if self._closer is not None:
            self._background.follow(self._image)

    def glance(
        self,
        image: Image,
        offsets_c: Vector,
        scales: Vector,
        up_c: Vector,
        moved: Moved | None,
        searched_c: Vector,
    ) -> list[Detection]:
        """Return which of the known drones image (H,W,3) uint8 BGR shows, nearest first.

        It is not searched, only looked at closely where they must be, by what the search said of
        them in the newest picture that was. searched_c: (n,3) m, where they were then, camera frame
        of then. The others: as in `drones`.

        Raises:
            SenselessOutput: an output of the network that cannot be true.
        """
        self._image = at_its_size(image)
        self._background.follow(self._image)
        if self._closer is None or self._look is None or not len(offsets_c):
            return []
        places, shown = self._heat_map.expected(offsets_c, scales)
        before = self._heat_map.places(searched_c)[shown]
        found = self._closer.judge(self._image, self._look, places, before)
        return self._weighed(found, up_c, moved)

    def detect(self, image: Image) -> list[Detection]:
        """Return the drones in image (H,W,3) uint8 BGR, nearest first."""
        self.look(image)
        return self.drones()

    def drones(
        self,
        offsets_c: Vector = _NONE,
        scales: Vector = _NONE[:, 0],
        up_c: Vector | None = None,
        moved: Moved | None = None,
    ) -> list[Detection]:
        """Return the drones in the newest picture, nearest first.

        offsets_c: (n,3) m, where known drones must be, camera frame; there it is looked closely,
        too. scales: (n,) of their sizes. up_c: (3,) unit, camera frame; None: it is not known, and
        heights say nothing. moved: of the camera since the picture before; None: it is not known,
        and the background says nothing.

        Raises:
            SenselessOutput: an output of the networks that cannot be true.
        """
        if self._look is None or self._image is None:
            return []
        if self._closer is None:
            return self._heat_map.read(self._look.drones)
        c = self._config
        places = peaks(self._look.drones, c.least_heat).first(c.looks)
        if len(offsets_c):
            places = places.and_beside(self._heat_map.expected(offsets_c, scales)[0])
        found = self._closer.judge(self._image, self._look, places)
        if up_c is not None:
            self._levels.follow(offsets_c @ up_c)
        return self._weighed(found, up_c, moved)

    def _weighed(self, found: Peaks, up_c: Vector | None, moved: Moved | None) -> list[Detection]:
        """Return the likely ones of what was looked at, by heights and background, too."""
        if up_c is not None and len(found):
            found = found.weighed(self._levels.evidence(*self._heat_map.heights(found, up_c)))
        if moved is not None and len(found):
            found = found.weighed(self._against_background(found, moved))
        likely = int((found.scores >= self._config.threshold).sum())
        return self._heat_map.detections(found.first(likely))

    def _against_background(self, found: Peaks, moved: Moved) -> Vector:
        """Return the log odds (n,) that finds gain by it; only of those that it can decide on."""
        odds = found.odds() - self._decides
        open_ = np.flatnonzero(np.abs(odds) < MOST)
        gained = np.zeros(len(found))
        asked = found.rows(open_)
        _, ranges, pixels = self._heat_map.lines(asked)
        gained[open_] = self._background.evidence(asked.places, asked.sizes, ranges, pixels, moved)
        return gained

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
