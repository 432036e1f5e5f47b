"""Perception: a frame → detected neighbours, trunks and ranges, in the camera's frame.

Detections come either from the pixels or, for studies, from the sender of the frame; everything
behind this page is the same.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from companion.perception.ball import ColorDetector
from companion.perception.camera_alignment import Alignment, CameraAlignment, StateAt
from companion.perception.camera_health import CameraFault, CameraHealth, CameraHealthConfig
from companion.perception.config import CameraConfig, SensingConfig
from companion.perception.detectors import make_detector, reported
from companion.perception.ground_flow import GroundFlow
from companion.perception.ground_plane import LEVEL, GroundPlane
from companion.perception.parallax import FixedPoints, Parallax
from companion.perception.reduced import Reduced
from companion.perception.view import View, load_camera
from companion.types import Detection, Image, Ranges, Track, Trunk
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.wire.messages import VehicleState
from mavlink_bridge.wire.video import Frame

if TYPE_CHECKING:
    from companion.perception.network_search import NetworkSearch

# The array of a frame that holds what is sensed in this way.
_ARRAYS = {
    "camera": "image",
    "network": "image",
    "depth": "depth",
    "truth": "neighbours",
    "map": "trunks",
}
# Faults of pictures that can still be compared with the gyro: corners need no clear colours.
_COMPARED = (CameraFault.NONE, CameraFault.LATE, CameraFault.MISALIGNED, CameraFault.UNCLEAR)
Tracks = Callable[[], list[Track]]
_NO_TRUNKS: Vector = np.zeros((0, 3))
_FORESEEN = 0.05  # s after the tick that an own state may be, to take a picture's place by it
_HELD = 8  # pictures that wait for telemetry, at most
_LENGTHS = (1e-6, 1e4)  # m; distances, radii and standard deviations lie between


@dataclass(frozen=True)
class Detections:
    """What the newest frame showed, and how the camera is.

    time: s, when the frame was taken. stamp: s, its stamp; None where no frame was looked at. own:
    the vehicle's state then; None where there was no new frame. searched: whether trunks were
    looked for. ranges: (h,w) m to other surfaces, where there is a depth image. fixed: points known
    by parallax. flow: of the ground, where it shows. fault: of the camera; blind: s that it has
    lasted. started: whether any frame has been looked at. inhibit_reason: why the frames cannot be
    flown by; empty where they can. alignment: how the pictures turn, against the gyro. problem: of
    the detectors; empty where there is none. clarity: 0…1, how surely obstacle, ground and the rest
    are told apart; 1 where no picture is asked. partly: whether drones were looked for only where
    they were expected.
    """

    time: float = 0.0
    own: VehicleState | None = None
    drones: list[Detection] = field(default_factory=list)
    trunks: list[Trunk] = field(default_factory=list)
    searched: bool = False
    ranges: Ranges | None = None
    fixed: FixedPoints = field(default_factory=FixedPoints.none)
    fault: CameraFault = CameraFault.NONE
    blind: float = 0.0
    started: bool = False
    inhibit_reason: str = ""
    alignment: Alignment = field(default_factory=Alignment)
    problem: str = ""
    clarity: float = 1.0
    flow: GroundFlow | None = None
    stamp: float | None = None
    partly: bool = False


class PerceptionFrontend:
    """The detectors that the configuration names, and the camera's health.

    Raises:
        CalibrationError, ModelError: a file that cannot be used.
    """

    def __init__(
        self,
        view: View,
        sensing: SensingConfig,
        health: CameraHealthConfig,
        lag: float = 0.0,
        measuring: bool = False,
    ) -> None:
        """Load the detectors.

        lag: s, configured, of pictures behind their stamps. measuring: mount and lens are what this
        flight is to find: they are no fault, and nothing is looked for in the pictures.
        """
        self._view = view
        self._lag = lag
        self._measuring = measuring
        self._sensing = sensing
        self._health_config = health
        self._arrays = {_ARRAYS[sensing.neighbours], _ARRAYS[sensing.obstacles]}
        self._frames = 0
        self._network: NetworkSearch | None = None
        if sensing.uses_network:
            from companion.perception.network_neighbours import NetworkNeighbours
            from companion.perception.network_search import NetworkSearch

            self._network = NetworkSearch(view.camera, sensing)
            self._neighbours = NetworkNeighbours(view, self._network)
        if self._network is None or sensing.detector != "network":
            self._drones = make_detector(view.camera, sensing)
        if sensing.obstacles == "camera":
            from companion.perception.trunks import TrunkDetector

            self._trunks = TrunkDetector(view.camera, sensing.trunks)
        elif sensing.obstacles == "depth":
            from companion.perception.depth import DepthReader
            from companion.perception.depth_finds import DepthCheck

            self._depth = DepthReader(view.camera, sensing.depth)
            self._depth_check = DepthCheck(view.camera, sensing.depth.range)
        self.reset()

    def reset(self) -> None:
        """Forget all frames: the vehicle's clock has begun anew."""
        self._health = CameraHealth(self._health_config, self._arrays)
        self._alignment = CameraAlignment(self._view)
        self._parallax = Parallax(self._view)
        if self._network is not None:
            self._neighbours.reset()
        self._newest = self._arrived = -np.inf
        self._waiting: deque[Frame] = deque(maxlen=_HELD)

    def see(
        self,
        time: float,
        frame: Frame | None,
        at: StateAt,
        ground: GroundPlane = LEVEL,
        horizon: float | None = None,
        trunks: Vector = _NO_TRUNKS,
        wander: float = 0.0,
        tracks: Tracks = list,
        tracked: float = 0.0,
    ) -> Detections:
        """Return the detections of the newest frame at the tick of `time` [s]; each frame once.

        at: returns the vehicle's state at a time [s] of the last second, where it is known.
        horizon: s, the latest that the vehicle's clock can show; None: `time`. trunks (k,3): known
        ones, x, y, radius [m], nearest first. wander: m/√s, 1 σ of the error of the reported way,
        a random walk. tracks: returns the neighbours seen lately, as they were known at `tracked`
        [s]; asked only where a detector looks for known ones.
        """
        frame = self._told(time, frame, time if horizon is None else horizon)
        stamp = None if frame is None else frame.time
        if frame is not None and self._lag:
            frame = replace(frame, time=frame.time - self._lag)
        misfit = self._misfit(frame)
        alignment = self._alignment.estimate
        wrong = "" if self._measuring else alignment.contradiction
        stamped = frame
        lag = alignment.lag if frame is None or frame.lag is None else frame.lag
        captured = -np.inf if frame is None else frame.time - lag
        if frame is not None and lag:
            # A picture from later than now: telemetry is late, and tells that time not yet.
            frame = replace(frame, time=min(captured, max(time, frame.time)))
        image = None if frame is None or misfit else frame.arrays.get("image")
        picture = None if image is None else Reduced(image)
        fault = self._health.check(time, frame, not misfit, not wrong, horizon, picture)
        if stamped is not None and picture is not None and fault in _COMPARED:
            self._alignment.update(time, stamped.time, picture, at, ground, wander)
        new = frame is not None and frame.time > self._newest and self._health.usable
        found = Detections()
        if new and frame is not None and (own := at(captured)) is not None:
            own = replace(own, time=frame.time)
            self._newest = frame.time
            try:
                found = self._detect(frame, picture, own, ground, trunks, tracks, tracked)
            except Exception as error:  # it shows no more than a camera without pictures
                found = Detections(problem=f"{type(error).__name__}: {error}")
            fault = self._health.searched(time, not found.problem, found.clarity)
            if fault is CameraFault.UNCLEAR:
                found = Detections(clarity=found.clarity)
        return Detections(
            found.time,
            found.own,
            found.drones,
            found.trunks,
            found.searched,
            found.ranges,
            found.fixed,
            fault,
            self._health.blind(time),
            self._newest > -np.inf,
            misfit or wrong,
            alignment,
            found.problem,
            found.clarity,
            found.flow,
            stamp,
            found.partly,
        )

    def _told(self, time: float, frame: Frame | None, horizon: float) -> Frame | None:
        """Return the newest frame, or one that waited, of a time of which telemetry tells by now.

        Telemetry that is late against the camera tells a picture's attitude only later. A state
        foreseen for it is wrong by some hundredths of a radian while the drone manoeuvres: ground
        and feet then seem to move.
        """
        lag = self._lag + self._alignment.estimate.lag
        told = frame is not None and (frame.lag is not None or frame.time > horizon)
        if lag > -_FORESEEN or told:  # a log's frame has waited; one of the future is judged now
            self._waiting.clear()
            return frame
        if frame is not None and frame.time > self._arrived:
            self._arrived = frame.time
            self._waiting.append(frame)
        due = None
        while self._waiting and self._waiting[0].time - lag <= time + _FORESEEN:
            due = self._waiting.popleft()
        return due

    def _detect(
        self,
        frame: Frame,
        picture: Reduced | None,
        own: VehicleState,
        ground: GroundPlane,
        standing: Vector,
        tracks: Tracks,
        tracked: float,
    ) -> Detections:
        """Return the detections in `frame` and its picture, taken in state `own`.

        picture: None where the frame has none, or a misfit one, which shows nothing. standing: the
        known trunks. tracks, tracked: as in `see`.
        """
        if self._measuring:
            return Detections(frame.time, own)
        image = None if picture is None else picture.image
        drones: list[Detection] = []
        self._frames += 1
        due = self._frames % self._sensing.trunks_every == 0
        partly = False
        network = self._network if image is not None else None
        if self._sensing.neighbours == "truth":
            drones = reported(frame)
            partly = "partly" in frame.arrays  # of a replay
        elif network is not None and image is not None and self._sensing.detector == "network":
            search = self._frames % self._sensing.network.every == 0
            drones, partly = self._neighbours.find(image, own, tracks(), tracked, search)
        elif picture is not None:
            drones = (
                self._drones.search(picture)
                if isinstance(self._drones, ColorDetector)
                else self._drones.detect(picture.image)
            )
        drones = self._checked(drones, frame.arrays.get("depth"))
        shown = frame.arrays.keys() - ({"image"} if image is None else set())
        due = due and not (partly and self._sensing.obstacles == "network")
        searched = due and _ARRAYS[self._sensing.obstacles] in shown
        given = frame.arrays.get("ranges")
        # As coarse as the log keeps them, so that a replay sees the same.
        ranges: Ranges | None = None if given is None else given.astype(np.float16)
        if not searched:
            trunks: list[Trunk] = []
        elif self._sensing.obstacles == "depth":
            depth: NDArray[np.float32] = frame.arrays["depth"]
            trunks, ranges = self._depth.read(
                depth, self._view.rotation(own), ground.under(own.p), drones, ground
            )
        else:
            trunks = self._find_trunks(frame, picture, own, ground)
        good_drones = [
            d for d in drones if _possible(d.direction, d.range, d.sigma_bearing, d.sigma_range)
        ]
        good_trunks = [t for t in trunks if _possible(t.direction, t.distance, t.radius, t.sigma)]
        bad = len(drones) + len(trunks) - len(good_drones) - len(good_trunks)
        problem = f"{bad} detections with impossible numbers" if bad else ""
        fixed, flow = self._fixed(frame, picture, own, good_drones, ground, standing)
        return Detections(
            frame.time,
            own,
            good_drones,
            good_trunks,
            searched,
            ranges,
            fixed,
            problem=problem,
            clarity=self._clarity(image),
            flow=flow,
            partly=partly,
        )

    def _checked(
        self, drones: list[Detection], depth: NDArray[np.float32] | None
    ) -> list[Detection]:
        """Return the drones that `depth` (h,w) m does not deny, where it is asked.

        It is not where a ball of known size tells them and their ranges better.
        """
        s = self._sensing
        asked = s.neighbours == "camera" and s.obstacles == "depth" and s.detector != "color"
        if depth is None or not asked or not s.depth.checks_drones:
            return drones
        return self._depth_check.checked(drones, depth)

    def _clarity(self, image: Image | None) -> float:
        """Return how surely obstacles and ground are told apart; 1 where no picture is asked."""
        if image is None:
            return 1.0
        if self._sensing.obstacles == "camera":
            return self._trunks.clarity
        return 1.0 if self._network is None else self._network.clarity

    def _fixed(
        self,
        frame: Frame,
        picture: Reduced | None,
        own: VehicleState,
        drones: list[Detection],
        ground: GroundPlane,
        trunks: Vector,
    ) -> tuple[FixedPoints, GroundFlow | None]:
        """Return the points that own motion shows, and the flow of the ground."""
        if self._sensing.obstacles != "camera" or not self._sensing.parallax:  # of a replay
            given = frame.arrays
            fixed = FixedPoints.from_rows(given.get("fixed"))
            return fixed, GroundFlow.from_row(given.get("flow"))
        if picture is None:
            return FixedPoints.none(), None
        fixed = self._parallax.update(picture, own, drones, ground, trunks)
        # Through a lens that is not as configured, the ground passes at another speed.
        return fixed, self._parallax.flow if self._alignment.estimate.measures else None

    def _find_trunks(
        self, frame: Frame, picture: Reduced | None, own: VehicleState, ground: GroundPlane
    ) -> list[Trunk]:
        if self._sensing.obstacles == "map":
            rows = frame.arrays.get("trunks", np.zeros((0, 6)))
            # A replay gives two more columns.
            wide = np.hstack((rows, np.zeros((len(rows), 8 - rows.shape[1]))))
            return [
                Trunk(r[:3], float(r[3]), float(r[4]), float(r[5]), bool(r[6]), float(r[7]))
                for r in wide
            ]
        assert picture is not None  # or nothing is searched for
        down, rise = self._view.to_camera(own, np.array([[0.0, 0.0, -1.0], [*ground.rise, 0.0]]))
        height = ground.under(own.p)
        if self._sensing.obstacles == "network" and self._network is not None:
            if self._sensing.detector != "network" or self._sensing.neighbours != "camera":
                self._network.look(picture.image)
            return self._network.trunks(down, height, rise)
        return self._trunks.search(picture, down, height, rise)

    def _misfit(self, frame: Frame | None) -> str:
        """Return why the picture, if there is one, is not one that the calibration is for."""
        arrays = {} if frame is None else frame.arrays
        image, depth = arrays.get("image"), arrays.get("depth")
        camera = self._view.camera
        wanted = (camera.height, camera.width, 3)
        if image is not None and (image.shape != wanted or image.dtype != np.uint8):
            return (
                f"camera: pictures are {'×'.join(map(str, image.shape[1::-1]))} px, camera.width "
                f"and camera.height say {camera.width}×{camera.height}, in colour"
            )
        if depth is not None and (depth.ndim != 2 or depth.dtype.kind != "f"):
            return f"camera: depth is {depth.dtype}, {depth.ndim}-D, not metres (h,w)"
        return ""


def _possible(direction: Vector, *lengths: float) -> bool:
    """Return whether a detection holds possible numbers; an impossible one would spoil its track.

    direction: (3,), of unit length. lengths: m.
    """
    unit = abs(float(direction @ direction) - 1.0) < 0.01
    return unit and all(_LENGTHS[0] < x < _LENGTHS[1] for x in lengths)


def make_view(camera: CameraConfig, sensing: SensingConfig) -> View:
    """Return the view of the configured camera.

    Raises:
        CalibrationError: a calibration file that cannot be used.
    """
    return View(load_camera(camera), needs_foot=sensing.obstacles in ("camera", "network"))
