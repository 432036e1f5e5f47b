"""The view of one camera on its drone: which places of the world it shows, and how well."""

from __future__ import annotations

import numpy as np

from companion.perception.camera import CalibrationError, Camera
from companion.perception.config import CameraConfig
from companion.types import Ranges
from mavlink_bridge.shared.arrays import Vector, lengths
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import VehicleState

_NEAR = 0.1  # m: nothing is nearer
_FOOTLESS = 0.05  # of a look at a trunk, where the picture does not show its foot


def load_camera(config: CameraConfig) -> Camera:
    """Return the camera as calibrated, or an ideal equidistant one.

    Raises:
        CalibrationError: a file that cannot be used, or is of another image size.
    """
    size = (config.width, config.height)
    if config.calibration is None:
        return Camera.equidistant(*size, config.fov_deg).turned(config.mount_deg)
    camera = Camera.load(config.calibration)
    if (camera.width, camera.height) != size:
        raise CalibrationError(
            f"{config.calibration}: made at {camera.width}×{camera.height}, but camera.width and "
            f"camera.height say {config.width}×{config.height}: calibrate at that size"
        )
    return camera.turned(config.mount_deg)


class View:
    """Projection between the drone's own ENU frame and its camera.

    half_view: half the field of view [rad]. mount: (4,) camera → body.
    """

    def __init__(self, camera: Camera, needs_foot: bool) -> None:
        """needs_foot: whether trunks are found by their foot, as in pixels."""
        self.camera = camera
        self.half_view = camera.width / 2 / camera.fx
        self.mount = camera.mount
        self._to_body = rotation_matrix(camera.mount)
        self._turned: tuple[VehicleState | None, Vector] = None, self._to_body
        self._size = np.array([camera.width, camera.height])
        self._needs_foot = needs_foot

    def rotation(self, own: VehicleState) -> Vector:
        """Return the (3,3) rotation camera → world."""
        # Asked for several times a tick, of one state.
        if own is not self._turned[0]:
            self._turned = own, rotation_matrix(own.q_wb) @ self._to_body
        return self._turned[1]

    def to_camera(self, own: VehicleState, vectors: Vector) -> Vector:
        """Return world vectors (n,3) in the camera frame."""
        return vectors @ self.rotation(own)

    def shows(
        self,
        own: VehicleState,
        points: Vector,
        margin: float = 0.05,
        doubts: Vector | None = None,
    ) -> list[bool]:
        """Return whether each of `points` (n,3) m, own ENU frame, falls well inside the image.

        margin: share of the image's width and height that counts as outside. doubts: (n,) m, how
        far from its place each may be and must still be inside.
        """
        if not len(points):
            return []
        offsets = self.to_camera(own, points - own.p)
        pixels = self.camera.project(offsets)
        edge = self._size * margin
        if doubts is not None:
            angles = doubts / np.maximum(lengths(offsets), _NEAR)
            edge = edge + self.camera.fx * angles[:, None]
        inside = (pixels > edge) & (pixels < self._size - edge)
        shown: list[bool] = (inside[:, 0] & inside[:, 1]).tolist()
        return shown

    def visibility(self, own: VehicleState, places: Vector, ranges: Ranges | None) -> Vector:
        """Return how much of a look at a trunk at each of `places` (n,3) m a frame is, (n,) 0…1.

        0 where the place is out of the picture, whatever its lens and mount, or where the depth
        image `ranges` (h,w) m is NaN, as behind a neighbour. Little where pixels do not show the
        foot: a thin trunk is then taken for one too far off to be told.
        """
        told = np.array(self.shows(own, places, margin=0.0), float)
        if self._needs_foot:
            feet = np.column_stack([places[:, :2], np.zeros(len(places))])
            return told * np.where(self.shows(own, feet), 1.0, _FOOTLESS)
        if ranges is None:
            return told
        h, w = ranges.shape
        offsets = self.to_camera(own, places - own.p)
        u, v = np.round(self.camera.scaled(w, h).project(offsets)).T
        inside = (u >= 0) & (u < w) & (v >= 0) & (v < h)
        rows, columns = (np.where(inside, x, 0).astype(int) for x in (v, u))
        told[inside & np.isnan(ranges[rows, columns])] = 0.0
        return told
