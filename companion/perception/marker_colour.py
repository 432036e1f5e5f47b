"""The colour of the markers, as the light of the day and the camera's white balance show it.

By how much they shift its hue, and how saturated it is, is learnt from the first balls in plain
view, while the drones stand beside each other; before that, in any light, only what is saturated
counts beyond the configured hue.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from pydantic import Field

from mavlink_bridge.shared.settings import StrictModel

# Balls in plain view that teach the colour; from then on it follows slowly, as the light does.
# After so many pictures without one it is learnt anew: the drone may have been carried elsewhere.
_TEACHERS, _FOLLOWS, _FORGETS = 10, 0.02, 300
# Saturation, 0…1, of balls that teach: bark, leaves and sky have less, markers mostly more; and the
# share of what was learnt that a ball has at least, in the shade and far off, too.
_SATURATED, _SHADED = 0.6, 0.55


class ColorSettings(StrictModel):
    """The look of the marker."""

    hue_deg: float = Field(
        300.0,
        description="Hue of the marker. 300 is magenta, which neither tree, grass, earth nor sky "
        "is; `camera` obstacles leave out only magenta neighbours.",
    )
    hue_width_deg: float = Field(30.0, gt=0, le=180, description="Accepted distance from that hue.")
    hue_shift_deg: float = Field(
        45.0,
        ge=0,
        le=120,
        description="How far light and white balance may shift the hue. By how much they do is "
        "learnt from the first balls in plain view, while the drones stand beside each other.",
    )
    marker_radius: float = Field(0.10, gt=0, description="Radius of the ball [m].")
    min_chroma: float = Field(
        28.0, gt=0, description="Grey levels between the marker's strong and weak channels."
    )
    min_area: float = Field(3.0, gt=0, description="Area of the ball in the picture [px].")
    max_range: float = Field(20.0, gt=0, description="Balls farther than this [m] are dropped.")
    edge: float = Field(
        0.44,
        gt=0,
        lt=1,
        description="Share of the bright side's chroma at which the outline is drawn; below one "
        "half, as the limb away from the sun is darker.",
    )


class MarkerColour:
    """Knows the markers' colour in these pictures.

    A colour's shift is how far its hue is from the configured one [°]; its saturation is 0…1.
    """

    def __init__(self, settings: ColorSettings) -> None:
        self._settings = settings
        self._forget()

    def _forget(self) -> None:
        self._shift = self._saturation = 0.0
        self._taught: list[tuple[float, float]] = []
        self._without = 0  # pictures since a ball was found

    def seen_as(self, mean: Sequence[float]) -> tuple[float, float] | None:
        """Return shift and saturation of a mean BGR colour; None where no marker looks like it."""
        b, g, r = mean
        if not b + g + r > 0.0:
            return None
        s = self._settings
        hue = math.degrees(math.atan2(math.sqrt(3.0) * (g - b), 2.0 * r - g - b))
        shift = (hue - s.hue_deg + 180.0) % 360.0 - 180.0
        saturation = 1.0 - min(mean) / max(mean)
        unknown = len(self._taught) < _TEACHERS and saturation > _SATURATED
        right = abs(shift - self._shift) <= s.hue_width_deg + s.hue_shift_deg * unknown
        return (shift, saturation) if right and saturation >= _SHADED * self._saturation else None

    def after_picture(self, found: bool, plain: Sequence[tuple[float, float]]) -> None:
        """Take in a picture: whether it showed balls, and the colours of those in plain view."""
        for colour in plain:
            self._learn(*colour)
        self._without = 0 if found else self._without + 1
        if self._without >= _FORGETS:
            self._forget()

    def _learn(self, shift: float, saturation: float) -> None:
        if saturation <= _SATURATED:
            return
        if len(self._taught) < _TEACHERS:
            self._taught.append((shift, saturation))
            if len(self._taught) < _TEACHERS:
                return
            shift, self._saturation = np.median(self._taught, axis=0).tolist()
        else:
            shift = self._shift + _FOLLOWS * (shift - self._shift)
            self._saturation += _FOLLOWS * (saturation - self._saturation)
        most = self._settings.hue_shift_deg
        self._shift = min(max(shift, -most), most)
