"""Ground flow: the way flown over the ground, by the corners of the ground in two pictures.

A corner of the ground lies where its line of sight, turned by the attitude, meets the ground. From
picture to picture all such corners move back alike, by the way flown; velocity and position of the
autopilot have no part in it. A trunk is nearer than its lines of sight say, so that its corners
move otherwise, each in its own way: corners of known trunks do not count, and the way is
that on which most of the others agree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.perception.ground_plane import LEVEL, GroundPlane
from mavlink_bridge.shared.arrays import Vector

STEEP = 0.35  # sine of the angle below the horizon; flatter lines meet the ground too far off
_AGREE = 0.006  # rad: corners of the ground agree to that, 2 σ of a pixel's noise
_LEAST, _SHARE = 8, 0.5  # corners that agree, and their share of all below the horizon
_BESIDE = 0.15  # m beside a known trunk, and before it, that may be the trunk
_LOW = 0.5  # m; from lower, little of the ground is seen, and that too fast


@dataclass(frozen=True)
class GroundFlow:
    """A way over the ground.

    before, after: s, when the two pictures were taken. way: (2,) m, east and north in the own
    frame, as long as the height [m] over the ground is right.
    """

    before: float
    after: float
    way: Vector
    height: float

    @property
    def row(self) -> list[float]:
        """The numbers before, after, way and height."""
        return [self.before, self.after, *self.way.tolist(), self.height]

    @staticmethod
    def from_row(row: Vector | None) -> GroundFlow | None:
        """Return the flow of a row (5,); None: there was none."""
        if row is None or len(row) != 5:
            return None
        before, after, height = float(row[0]), float(row[1]), float(row[4])
        return GroundFlow(before, after, np.array(row[2:4], float), height)


def hidden_by(
    trunks: Vector, here: Vector, rays: Vector, height: float, ground: GroundPlane = LEVEL
) -> NDArray[np.bool_]:
    """Return which lines of sight (n,) meet a known trunk before the ground.

    trunks (k,3): x, y, radius, m. here (2,) m. rays (n,3): unit, below the horizon, own ENU axes.
    height: m, over the ground.
    """
    if not len(trunks):
        return np.zeros(len(rays), bool)
    flat = rays[:, :2]
    level = np.maximum(np.sqrt((flat * flat).sum(axis=1)), 1e-6)
    u = flat / level[:, None]
    reach = height * level / np.maximum(ground.drop(rays), 1e-3)
    to = trunks[:, :2] - here
    along = u @ to.T
    across = np.abs(u[:, :1] * to[:, 1] - u[:, 1:] * to[:, 0])
    radius = trunks[:, 2]
    meets = (across < radius + _BESIDE) & (along > 0.0)
    hidden: NDArray[np.bool_] = (meets & (along - radius - _BESIDE < reach[:, None])).any(axis=1)
    return hidden


def way_over_ground(
    before: Vector,
    after: Vector,
    height_before: float,
    height: float,
    ground: GroundPlane = LEVEL,
) -> Vector | None:
    """Return the way (2,) m flown between two pictures; None where too few corners agree.

    before, after (n,3): unit rays to the same corners, own ENU axes. height_before, height: m over
    the ground, at each picture.
    """
    if len(before) < _LEAST or min(height_before, height) < _LOW:
        return None
    drop_before, drop = ground.drop(before), ground.drop(after)
    below = (drop_before > STEEP) & (drop > STEEP)
    if np.count_nonzero(below) < _LEAST:
        return None
    a, b = before[below], after[below]
    drop_before, drop = drop_before[below], drop[below]
    ways = height_before * a[:, :2] / drop_before[:, None] - height * b[:, :2] / drop[:, None]
    # The farther a corner, the more a pixel's noise moves it: s² + h² over h.
    reach = _AGREE * height / drop**2
    x, y = ways.T
    apart = (x[:, None] - x) ** 2 + (y[:, None] - y) ** 2
    near, known = apart < reach**2, reach**-2
    agree = near[int(np.argmax(near @ known))]
    weight = known * agree
    few = np.count_nonzero(agree) < max(_LEAST, _SHARE * len(ways))
    if few or weight.sum() < _SHARE * known.sum():
        return None
    way: Vector = weight @ ways / weight.sum()
    return way
