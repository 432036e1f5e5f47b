"""A frame → what is seen in it: the detectors behind one interface, or perfect reports.

What a detector would report comes either from the pixels or, for studies, from the sender of
the frame; everything behind this page is the same.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from companion.camera import Camera
from companion.config import CameraConfig, SensingConfig
from companion.detect import ColorDetector
from companion.types import Detection, Image, Ranges, Trunk, Vector
from mavlink_bridge.frames import rotation_matrix
from mavlink_bridge.messages import VehicleState
from mavlink_bridge.video import Frame


@dataclass(frozen=True)
class Sighting:
    """What one frame showed, when, and from where (own state at capture; None: no frame).

    searched: whether trunks were looked for.
    """

    time: float = 0.0
    own: VehicleState | None = None
    drones: list[Detection] = field(default_factory=list)
    trunks: list[Trunk] = field(default_factory=list)
    searched: bool = False
    ranges: Ranges | None = None  # (h,w) m to other surfaces, where there is a depth image


class Sight:
    """The camera and the detectors chosen by the config."""

    def __init__(self, camera: CameraConfig, sensing: SensingConfig) -> None:
        self.camera = (
            Camera.load(camera.calibration)
            if camera.calibration
            else Camera.equidistant(camera.width, camera.height, camera.fov_deg)
        )
        self.half_view = camera.width / 2 / self.camera.fx
        self._sensing = sensing
        self._frames = 0
        self._drones = ColorDetector(self.camera)
        if sensing.obstacles == "camera":
            from companion.trunks import TrunkDetector

            self._trunks = TrunkDetector(self.camera)
        elif sensing.obstacles == "depth":
            from companion.depth import DepthReader

            self._depth = DepthReader(self.camera, sensing.depth)

    def see(self, frame: Frame, own: VehicleState) -> Sighting:
        """Detections in `frame`, taken in state `own`; a frame without an image shows nothing."""
        image: Image | None = frame.arrays.get("image")
        drones: list[Detection] = []
        if self._sensing.neighbours == "truth":
            rows = frame.arrays.get("neighbours", np.zeros((0, 6)))
            drones = [Detection(r[:3], float(r[3]), float(r[4]), float(r[5])) for r in rows]
        elif image is not None:
            drones = self._drones.detect(image)
        self._frames += 1
        searched = self._frames % self._sensing.trunks_every == 0
        given = frame.arrays.get("ranges")
        # As coarse as the log keeps them, so that a replay sees the same.
        ranges: Ranges | None = None if given is None else given.astype(np.float16)
        if not searched:
            trunks: list[Trunk] = []
        elif self._sensing.obstacles == "depth":
            trunks, ranges = self._read_depth(frame, own, drones)
        else:
            trunks = self._find_trunks(frame, own)
        return Sighting(frame.time, own, drones, trunks, searched, ranges)

    def _find_trunks(self, frame: Frame, own: VehicleState) -> list[Trunk]:
        image: Image | None = frame.arrays.get("image")
        if self._sensing.obstacles == "map":
            rows = frame.arrays.get("trunks", np.zeros((0, 6)))
            return [Trunk(r[:3], float(r[3]), float(r[4]), float(r[5])) for r in rows]
        if image is None:
            return []
        down = self._to_camera(own, np.array([[0.0, 0.0, -1.0]]))[0]
        return self._trunks.detect(image, down, float(own.p[2]))

    def _read_depth(
        self, frame: Frame, own: VehicleState, drones: list[Detection]
    ) -> tuple[list[Trunk], Ranges | None]:
        depth: NDArray[np.float32] | None = frame.arrays.get("depth")
        if depth is None:
            return [], None
        return self._depth.read(depth, self._rotation(own), float(own.p[2]), drones)

    def in_view(self, own: VehicleState, points: Vector, margin: float = 0.05) -> list[bool]:
        """Whether each of `points` (n,3), own ENU frame, falls well inside the image."""
        if not len(points):
            return []
        pixels = self.camera.project(self._to_camera(own, points - own.p))
        w, h = self.camera.width, self.camera.height
        inside = (pixels > np.array([w, h]) * margin) & (pixels < np.array([w, h]) * (1 - margin))
        return [bool(b[0] and b[1]) for b in inside]

    def _to_camera(self, own: VehicleState, vectors: Vector) -> Vector:
        """World vectors (n,3) in the camera frame."""
        return vectors @ self._rotation(own)

    def _rotation(self, own: VehicleState) -> Vector:
        """(3,3) camera → world."""
        return rotation_matrix(own.q_wb) @ rotation_matrix(self.camera.mount)
