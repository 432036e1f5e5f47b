"""Whether a picture tells trunks from ground by colour at all: eyes that know when they do not see.

Trunks are found because bark is less warm than the ground (`trunks`). Five things must hold where
that is so; each gives 0…1, ½ at its limit, and a picture's score is their product.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.perception.pixels import percentile
from mavlink_bridge.shared.arrays import Vector

Counts = NDArray[np.int32]
_FEW = 4  # columns; fewer do not show what bark looks like
_FOLLOW = (
    0.15  # share of each picture in the clarity: 4 bad ones in a row make a clear view unclear
)
# Warmth (of 255) that typical ground has. Asphalt and snow have 20 to 40, litter 110 to 145.
_GROUND = (85.0, 115.0)
_SHARE = 0.4  # twice the least share of the view below the horizon that must be ground
# Twice the least warmth by which ground exceeds the bark that stands before the sky. In the shade
# of a warm trunk that fills half the view it is 30, and 99 of 100 pixels lie right; it is 13 and
# less where they do not and nothing else below says so.
_GAP = 30.0
_MISFITS = 0.08  # twice the largest share of pixels on the wrong side of the feet
# The widest object that may stand before the sky and have no bark below the horizon: a trunk so
# wide is so near that its foot lies lower. Where there is one, its bark was taken for ground. Bark
# that is less warm than the ground by `_TOLD` is not: it is far, and the horizon is believed too
# low, by a wrong tilt.
_FOOTLESS = math.radians(2.5)
_TOLD = 60.0


class Separation:
    """Follows how well obstacles and ground separate; clarity: 0…1, over the last pictures."""

    def __init__(self) -> None:
        self.clarity = 1.0

    def follow(self, score: float | None) -> None:
        """Take in the score of a picture; None: it does not tell."""
        if score is not None:
            self.clarity += _FOLLOW * (score - self.clarity)


@dataclass(frozen=True)
class Feet:
    """The foot in each column of a picture, and the pixels below the horizon; (columns,) each.

    row: of the foot. known: pixels that are known. ground: those that look like ground. known_below
    and ground_below: those of them below the foot. near: whether the uppermost pixels are known.
    """

    row: NDArray[np.intp]
    known: Counts
    ground: Counts
    known_below: Counts
    ground_below: Counts
    near: NDArray[np.bool_]


def score(
    typical: float | None, feet: Feet, bark: Vector, above: NDArray[np.bool_], step: float
) -> float | None:
    """Return how well obstacles and ground separate in a picture, 0…1; None where nothing tells.

    typical: warmth of the ground in it. bark: (columns,) warmth of what stands before the sky in
    columns `above`. step: rad, width of a column.
    """
    count = int(feet.known.sum())
    if typical is None or not count:
        return None
    ground, right = int(feet.ground.sum()), int(feet.ground_below.sum())
    misfits = (ground - right + int(feet.known_below.sum()) - right) / count
    share = ground / count
    gap = _GAP
    if np.count_nonzero(above) >= _FEW:
        gap = typical - percentile(bark[above], 75)
    footless = above & (feet.row <= 2) & feet.near & (typical - bark < _TOLD)
    low, high = _GROUND
    parts = (
        (typical - low) / (high - low),
        share / _SHARE,
        gap / _GAP,
        1.0 - misfits / _MISFITS,
        1.0 - 0.5 * _longest(footless) * step / _FOOTLESS,
    )
    return float(math.prod(min(max(part, 0.0), 1.0) for part in parts))


def _longest(mask: NDArray[np.bool_]) -> int:
    """Return the length of the longest run of true values."""
    if not mask.any():
        return 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max())
