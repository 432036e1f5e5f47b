"""A frame → what is seen in it: the detectors behind one interface, or perfect reports.

What a detector would report comes either from the pixels or, for studies, from the sender of
the frame; everything behind this page is the same.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from companion.perception.camera import CalibrationError, Camera
from companion.perception.config import CameraConfig, SensingConfig
from companion.perception.detectors import make_detector
from companion.types import Detection, Image, Ranges, Trunk
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import VehicleState
from mavlink_bridge.wire.video import Frame

# By which array a frame shows what is sensed this way.
_ARRAYS = {"camera": "image", "depth": "depth", "truth": "neighbours", "map": "trunks"}
_FOOTLESS = 0.05  # of a look at a trunk
_LENGTHS = (1e-6, 1e4)  # m; distances, radii and standard deviations lie between


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


def load_camera(config: CameraConfig) -> Camera:
    """The camera as calibrated, or an ideal one.

    Raises:
        CalibrationError: a file that cannot be used, or is of another image size.
    """
    size = (config.width, config.height)
    if config.calibration is None:
        return Camera.equidistant(*size, config.fov_deg)
    camera = Camera.load(config.calibration)
    if (camera.width, camera.height) != size:
        raise CalibrationError(
            f"{config.calibration}: made at {camera.width}×{camera.height}, but camera.width and "
            f"camera.height say {config.width}×{config.height}: calibrate at that size"
        )
    return camera


class Sight:
    """The camera and the detectors chosen by the config.

    needs: the arrays that each frame must bring. objection: why its frames are not to be flown by,
    one line; empty where they are fine.

    Raises:
        CalibrationError, ModelError: a file that cannot be used.
    """

    def __init__(self, camera: CameraConfig, sensing: SensingConfig) -> None:
        self.camera = load_camera(camera)
        self.half_view = camera.width / 2 / self.camera.fx
        self.needs = {_ARRAYS[sensing.neighbours], _ARRAYS[sensing.obstacles]}
        self.objection = ""
        self._sensing = sensing
        self._frames = 0
        self._drones = make_detector(self.camera, sensing)
        if sensing.obstacles == "camera":
            from companion.perception.trunks import TrunkDetector

            self._trunks = TrunkDetector(self.camera, sensing.trunks)
        elif sensing.obstacles == "depth":
            from companion.perception.depth import DepthReader

            self._depth = DepthReader(self.camera, sensing.depth)

    def see(self, frame: Frame, own: VehicleState) -> Sighting:
        """Detections in `frame`, taken in state `own`; a frame without an image shows nothing."""
        image = frame.arrays.get("image") if self.fits(frame) else None
        drones: list[Detection] = []
        if self._sensing.neighbours == "truth":
            rows = frame.arrays.get("neighbours", np.zeros((0, 6)))
            drones = [Detection(r[:3], float(r[3]), float(r[4]), float(r[5])) for r in rows]
        elif image is not None:
            drones = self._drones.detect(image)
        self._frames += 1
        shown = frame.arrays.keys() - ({"image"} if image is None else set())
        searched = (
            self._frames % self._sensing.trunks_every == 0
            and _ARRAYS[self._sensing.obstacles] in shown
        )
        given = frame.arrays.get("ranges")
        # As coarse as the log keeps them, so that a replay sees the same.
        ranges: Ranges | None = None if given is None else given.astype(np.float16)
        if not searched:
            trunks: list[Trunk] = []
        elif self._sensing.obstacles == "depth":
            trunks, ranges = self._read_depth(frame, own, drones)
        else:
            trunks = self._find_trunks(frame, image, own)
        drones = [d for d in drones
                  if _sane(d.direction, d.range, d.sigma_bearing, d.sigma_range)]  # fmt: skip
        trunks = [t for t in trunks if _sane(t.direction, t.distance, t.radius, t.sigma)]
        return Sighting(frame.time, own, drones, trunks, searched, ranges)

    def _find_trunks(self, frame: Frame, image: Image | None, own: VehicleState) -> list[Trunk]:
        if self._sensing.obstacles == "map":
            rows = frame.arrays.get("trunks", np.zeros((0, 6)))
            return [  # a replay tells a seventh
                Trunk(r[:3], float(r[3]), float(r[4]), float(r[5]), bool(r[6:].any())) for r in rows
            ]
        assert image is not None  # or nothing is looked for
        down = self._to_camera(own, np.array([[0.0, 0.0, -1.0]]))[0]
        return self._trunks.detect(image, down, float(own.p[2]))

    def fits(self, frame: Frame | None) -> bool:
        """Whether the picture, if there is one, is such as the calibration is for."""
        arrays = {} if frame is None else frame.arrays
        image, depth = arrays.get("image"), arrays.get("depth")
        wanted = (self.camera.height, self.camera.width, 3)
        if image is not None and (image.shape != wanted or image.dtype != np.uint8):
            self.objection = (
                f"camera: pictures are {'×'.join(map(str, image.shape[1::-1]))} px, camera.width "
                f"and camera.height say {self.camera.width}×{self.camera.height}, in colour"
            )
        elif depth is not None and (depth.ndim != 2 or depth.dtype.kind != "f"):
            self.objection = f"camera: depth is {depth.dtype}, {depth.ndim}-D, not metres (h,w)"
        else:
            self.objection = ""
        return not self.objection

    def _read_depth(
        self, frame: Frame, own: VehicleState, drones: list[Detection]
    ) -> tuple[list[Trunk], Ranges | None]:
        depth: NDArray[np.float32] = frame.arrays["depth"]
        return self._depth.read(depth, self._rotation(own), float(own.p[2]), drones)

    def in_view(self, own: VehicleState, points: Vector, margin: float = 0.05) -> list[bool]:
        """Whether each of `points` (n,3), own ENU frame, falls well inside the image."""
        if not len(points):
            return []
        pixels = self.camera.project(self._to_camera(own, points - own.p))
        w, h = self.camera.width, self.camera.height
        inside = (pixels > np.array([w, h]) * margin) & (pixels < np.array([w, h]) * (1 - margin))
        return [bool(b[0] and b[1]) for b in inside]

    def tells(self, sighting: Sighting, places: Vector) -> Vector:
        """(n,) how much of a look at trunks at `places` (n,3), own ENU frame, the frame is; 0…1.

        None where the place is out of the picture, whatever its lens and mount, or where a depth
        image is NaN, as behind a neighbour. Little of one where pixels show no foot: a thin trunk
        is then taken for one too far off to be told.
        """
        own = sighting.own
        assert own is not None
        told = np.array(self.in_view(own, places, margin=0.0), float)
        if self._sensing.obstacles == "camera":
            feet = np.column_stack([places[:, :2], np.zeros(len(places))])
            return told * np.where(self.in_view(own, feet), 1.0, _FOOTLESS)
        if sighting.ranges is None:
            return told
        h, w = sighting.ranges.shape
        offsets = self._to_camera(own, places - own.p)
        u, v = np.round(self.camera.scaled(w, h).project(offsets)).T
        inside = (u >= 0) & (u < w) & (v >= 0) & (v < h)
        rows, columns = (np.where(inside, x, 0).astype(int) for x in (v, u))
        told[inside & np.isnan(sighting.ranges[rows, columns])] = 0.0
        return told

    def _to_camera(self, own: VehicleState, vectors: Vector) -> Vector:
        """World vectors (n,3) in the camera frame."""
        return vectors @ self._rotation(own)

    def _rotation(self, own: VehicleState) -> Vector:
        """(3,3) camera → world."""
        return rotation_matrix(own.q_wb) @ rotation_matrix(self.camera.mount)


def _sane(direction: Vector, *lengths: float) -> bool:
    """Whether a report is of numbers that can be true; one that is not would spoil its track."""
    unit = abs(float(direction @ direction) - 1.0) < 0.01
    return unit and all(_LENGTHS[0] < x < _LENGTHS[1] for x in lengths)
