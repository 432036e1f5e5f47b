"""Camera health: dead, frozen, black, saturated, unclear, late and misfit pictures.

A picture is judged by one pixel in 64. A real sensor's noise never gives the same picture twice,
and no scene is all black or all white. In fog, at night or before one colour, the means of
neighbouring squares are all alike, whatever the noise. A picture with a fault is not searched, so
that a thing that is not seen in it does not count as gone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import Enum

import cv2
import numpy as np
from pydantic import Field

from companion.perception.pixels import percentile
from companion.perception.reduced import Reduced
from companion.types import Image
from mavlink_bridge.shared.settings import StrictModel
from mavlink_bridge.wire.video import Frame

_STEP = 8  # px between the pixels that are looked at, each way
_PERCENT = 0.01
_CONTRAST_EVERY = 2  # pictures: fog does not come within a tenth of a second
_CLEAREST = 98.0  # percentile of the steps between neighbouring squares: a few edges are enough
_RANGES = 0.05  # share of a depth image that must be known; 0 and NaN are not
_DEAD = 3  # times as late as late: no frame comes any more
_AHEAD = 0.1  # s that a stamp may be later than the vehicle's clock: the lag is measured


class CameraFault(Enum):
    """What is wrong with the newest frame."""

    NONE = "none"
    DEAD = "dead"  # no frame, or none with all arrays that are to be looked at
    FROZEN = "frozen"
    BLACK = "black"
    SATURATED = "saturated"
    NO_DEPTH = "no_depth"  # a depth image with hardly any known range
    LATE = "late"
    AHEAD = "ahead"  # stamped in the future: nothing says when it was taken
    MISFIT = "misfit"  # not of the size that the calibration is for
    MISALIGNED = "misaligned"  # it turns otherwise than the gyro says
    UNCLEAR = "unclear"  # nothing can be told apart in it: fog, night, one colour
    SENSELESS = "senseless"  # what is found in it is no number, or the detector fails

    @property
    def misleads(self) -> bool:
        """Return whether earlier pictures may have shown things that were not there."""
        return self in (CameraFault.MISALIGNED, CameraFault.UNCLEAR, CameraFault.SENSELESS)


class CameraHealthConfig(StrictModel):
    """When a picture counts as faulty."""

    late: float = Field(
        0.18, gt=0, description="Newest frame older than this [s]: 10 Hz, and 80 ms to get here."
    )
    black: float = Field(4.0, ge=0, le=255, description="Brightest percent below this: black.")
    saturated: float = Field(
        251.0, ge=0, le=255, description="Darkest percent above this: saturated."
    )
    contrast: float = Field(
        8.0,
        ge=0,
        le=255,
        description="Contrast of the means of 8×8 px below this: unclear. In fog, at night and "
        "before one colour it is 1 to 2, in what can be seen 47 and more.",
    )
    clarity: float = Field(
        0.5,
        ge=0,
        le=1,
        description="Pictures below this are unclear: how surely obstacle, ground and the rest are "
        "told apart, from 0 (not at all) to 1. With sensing.obstacles network or camera.",
    )


class CameraHealth:
    """Follows the frames of one camera; needs: names of the arrays that each frame must bring."""

    def __init__(self, config: CameraHealthConfig, needs: Iterable[str] = ()) -> None:
        self._config = config
        self._needs = frozenset(needs)
        self._before = b""  # the last picture's content, as sampled
        self._newest = -np.inf
        self._blind_since: float | None = None
        self._picture = self.fault = CameraFault.DEAD
        self._content = CameraFault.NONE
        self._pictures, self._clear = 0, True

    def check(
        self,
        time: float,
        frame: Frame | None,
        fits: bool = True,
        aligned: bool = True,
        horizon: float | None = None,
        picture: Reduced | None = None,
    ) -> CameraFault:
        """Judge the newest frame at the tick of `time` [s, vehicle's clock]; once a tick.

        fits: whether it is such as the camera is calibrated for. aligned: whether the pictures so
        far turned as the gyro says. horizon: s, the latest that the vehicle's clock can show;
        None: `time`. picture: that of the frame, where its smaller sizes are used elsewhere, too.
        """
        horizon = time if horizon is None else horizon
        if frame is not None and frame.time > horizon + _AHEAD:
            self._picture = CameraFault.AHEAD
        elif frame is not None and frame.time > self._newest:
            self._newest = frame.time
            self._picture = self._judge(frame, picture) if fits else CameraFault.MISFIT
            if self._picture is CameraFault.NONE and not aligned:
                self._picture = CameraFault.MISALIGNED
        if self.usable:
            age, late = time - self._newest, self._config.late
            gone = CameraFault.DEAD if age > _DEAD * late else CameraFault.LATE
            self._picture = gone if age > late else CameraFault.NONE
        return self._conclude(time)

    def searched(self, time: float, sound: bool, clarity: float = 1.0) -> CameraFault:
        """Judge again, once the newest frame has been searched.

        sound: what the detectors found is made of possible numbers. clarity: 0…1, how surely the
        picture tells obstacle, ground and the rest apart.
        """
        unclear = CameraFault.UNCLEAR if clarity < self._config.clarity else CameraFault.NONE
        self._content = unclear if sound else CameraFault.SENSELESS
        return self._conclude(time)

    def _conclude(self, time: float) -> CameraFault:
        """Return the fault of picture and detectors; note since when there is one."""
        content = self._content if self.usable else CameraFault.NONE
        self.fault = self._picture if content is CameraFault.NONE else content
        if self.fault is CameraFault.NONE:
            self._blind_since = None
        elif self._blind_since is None:
            self._blind_since = time
        return self.fault

    def blind(self, time: float) -> float:
        """Return the seconds that the fault has lasted, its first tick included; 0 without one."""
        return 0.0 if self._blind_since is None else time - self._blind_since + 1e-3

    @property
    def usable(self) -> bool:
        """Whether the newest frame can be searched; a late one can, with its own time."""
        return self._picture in (CameraFault.NONE, CameraFault.LATE)

    def _judge(self, frame: Frame, picture: Reduced | None) -> CameraFault:
        if not frame.arrays or self._needs - frame.arrays.keys():
            return CameraFault.DEAD
        depth = frame.arrays.get("depth")
        if depth is not None and np.count_nonzero(depth > 0.0) < _RANGES * depth.size:
            return CameraFault.NO_DEPTH
        image = frame.arrays.get("image")
        if image is None:  # a report instead of a picture
            return CameraFault.NONE
        few = _sampled(image)
        content = few.tobytes()
        same = content == self._before
        self._before = content
        # Whole numbers, as the pixels are: no pixel is made a float for the comparison.
        if np.count_nonzero(few >= math.ceil(self._config.black)) < _PERCENT * few.size:
            return CameraFault.BLACK
        if np.count_nonzero(few <= math.floor(self._config.saturated)) < _PERCENT * few.size:
            return CameraFault.SATURATED
        if same:
            return CameraFault.FROZEN
        if self._pictures % _CONTRAST_EVERY == 0:
            self._clear = contrast(picture or Reduced(image)) >= self._config.contrast
        self._pictures += 1
        return CameraFault.NONE if self._clear else CameraFault.UNCLEAR


def contrast(picture: Reduced) -> float:
    """Return how far [0…255] neighbouring squares of a picture differ in any colour.

    It is that of the few clearest edges, of the means of squares: noise hardly shows in them.
    """
    height, width = picture.image.shape[0] // _STEP, picture.image.shape[1] // _STEP
    if min(height, width) < 2:
        return 255.0
    small = picture.colour(width, height)
    across, down = cv2.absdiff(small[:, 1:], small[:, :-1]), cv2.absdiff(small[1:], small[:-1])
    steps = np.concatenate([across.reshape(-1, 1, 3), down.reshape(-1, 1, 3)])
    blue, green, red = cv2.split(steps)
    return percentile(cv2.max(cv2.max(blue, green), red), _CLEAREST)


def _sampled(image: Image) -> Image:
    """Return one pixel in 64 of a picture."""
    height, width = image.shape[:2]
    size = max(width // _STEP, 1), max(height // _STEP, 1)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_NEAREST), np.uint8)
