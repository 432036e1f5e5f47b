"""A fisheye calibration from pictures of a chessboard."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from companion.perception.camera import CalibrationError, Camera
from companion.types import Image
from mavlink_bridge.shared.arrays import Vector

LEAST_PICTURES = 6  # with a board
_CV2: Any = cv2 if hasattr(cv2, "CALIB_RECOMPUTE_EXTRINSIC") else cv2.fisheye  # OpenCV 5, 4
_FLAGS = _CV2.CALIB_RECOMPUTE_EXTRINSIC | _CV2.CALIB_FIX_SKEW
_CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-8)
_OUTLIER = 4.0  # times the median error, from which a picture is left out


@dataclass(frozen=True)
class Calibration:
    """A camera, and how well the pictures determine it.

    rms: px, reprojection error. errors: the same of each picture used. unused: why, for each of
    the other pictures. reach: share of the picture's half diagonal that the corners span.
    """

    camera: Camera
    rms: float
    errors: dict[str, float]
    unused: dict[str, str]
    reach: float


def calibrate(files: Sequence[Path], board: tuple[int, int], square: float) -> Calibration:
    """Return the calibration from pictures of a board.

    board: inner corners across and down. square: m, edge of its squares.

    Raises:
        CalibrationError: pictures that cannot be read, differ in size, or show too few boards.
    """
    corners: dict[str, Vector] = {}
    unused: dict[str, str] = {}
    size: tuple[int, int] | None = None
    for file in files:
        image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise CalibrationError(f"{file}: not a picture that OpenCV reads")
        here = (image.shape[1], image.shape[0])
        if size not in (None, here):
            raise CalibrationError(
                f"{file}: is {here[0]}×{here[1]} px, the pictures before are {size[0]}×{size[1]} px"
            )
        size = here
        found = _corners(image, board)  # type: ignore[arg-type]
        if found is None:
            unused[str(file)] = f"no board of {board[0]}×{board[1]} inner corners"
        else:
            corners[str(file)] = found
    if size is None or len(corners) < LEAST_PICTURES:
        raise CalibrationError(
            f"{len(corners)} of {len(files)} pictures show a board of {board[0]}×{board[1]} inner "
            f"corners; at least {LEAST_PICTURES} must, better 20, near the picture's edges, too"
        )
    points = np.zeros((1, board[0] * board[1], 3))
    points[0, :, :2] = np.mgrid[0 : board[0], 0 : board[1]].T.reshape(-1, 2) * square
    return _solve(points, corners, size, unused)


def _corners(image: Image, board: tuple[int, int]) -> Vector | None:
    """Return the inner corners (1,n,2) px, to a fraction of a pixel; None without a board."""
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    found, corners = cv2.findChessboardCornersSB(image, board, flags=flags)
    return np.asarray(corners, float).reshape(1, -1, 2) if found else None


def _solve(
    points: Vector, corners: dict[str, Vector], size: tuple[int, int], unused: dict[str, str]
) -> Calibration:
    """Return the calibration by two fits, the second without the outliers of the first."""
    camera, errors = _fit(points, corners, size)
    typical = float(np.median(list(errors.values())))
    bad = {name for name, error in errors.items() if error > max(_OUTLIER * typical, 0.5)}
    if bad and len(corners) - len(bad) >= LEAST_PICTURES:
        unused = unused | {name: f"fits badly, {errors[name]:.2f} px" for name in bad}
        corners = {name: c for name, c in corners.items() if name not in bad}
        camera, errors = _fit(points, corners, size)
    if inhibit_reason := camera.inhibit_reason:
        raise CalibrationError(inhibit_reason)
    every = np.concatenate([c[0] for c in corners.values()])
    middle = np.array([camera.cx, camera.cy])
    reach = float(np.linalg.norm(every - middle, axis=1).max() / np.hypot(*middle))
    rms = float(np.sqrt(np.mean(np.square(list(errors.values())))))
    return Calibration(camera, rms, errors, unused, reach)


def _fit(
    points: Vector, corners: dict[str, Vector], size: tuple[int, int]
) -> tuple[Camera, dict[str, float]]:
    """Return the camera by `cv2.fisheye.calibrate`, and the RMS error [px] of each picture."""
    matrix: Any = np.eye(3)
    k: Any = np.zeros((4, 1))
    seen = list(corners.values())
    try:
        _, matrix, k, turns, places = cv2.fisheye.calibrate(
            [points] * len(seen), seen, size, matrix, k, flags=_FLAGS, criteria=_CRITERIA
        )
    except cv2.error as error:
        raise CalibrationError(
            "the pictures do not determine a fisheye lens: take some with the board tilted, and "
            f"near the edges ({error.err})"
        ) from error
    errors = {}
    for (name, found), turn, place in zip(corners.items(), turns, places, strict=True):
        projected, _ = cv2.fisheye.projectPoints(points, turn, place, matrix, k)
        miss = np.asarray(projected).reshape(-1, 2) - found[0]
        errors[name] = float(np.sqrt((miss**2).sum(axis=1).mean()))
    camera = Camera(
        size[0], size[1], matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], k.ravel()
    )
    return camera, errors
