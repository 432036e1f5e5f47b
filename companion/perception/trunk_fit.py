"""Trunks from the columns of a level panorama, each with the distance to what stands in it.

Neighbouring columns of like distance form a trunk; its two edges give the radius:

    t(Δ) = d (cos Δ − √(sin² β − sin² Δ)),   sin β = r / d

with d the distance to the axis, β half the angular width, Δ the azimuth from the axis, t the
distance to the surface.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from companion.perception.panorama import LevelFrame
from companion.types import Trunk
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import Contradiction, StrictModel

Mask = NDArray[np.bool_]
CUT_WIDTH = 1.35  # typical true over visible width of a trunk cut by the picture's edge
TRIED = np.geomspace(16.0, 1.02, 48)  # distances to the axis, in radii
EDGE = 9.0  # grey levels, contrast of an upright edge that parts two trunks


class TrunkSettings(StrictModel):
    """The look of trunks and ground, and how far trunks are sought."""

    radius: float = Field(1.0, gt=0, description="Assumed [m] where one edge of a trunk shows.")
    max_range: float = Field(12.0, gt=0, description="Farther surfaces [m] are not used.")
    step_deg: float = Field(0.6, ge=0.2, le=3, description="Pixel of the level panorama.")
    min_width_deg: float = Field(2.5, gt=0, description="Narrower objects are no trunks.")
    ground_share: float = Field(
        0.55, gt=0, lt=1, description="Least share of the ground's saturation in a ground pixel."
    )
    attitude_sigma: float = Field(0.006, ge=0, description="1 σ [rad] of the own attitude.")
    min_radius: float = Field(0.08, gt=0, description="Thinner objects [m] are no trunks.")
    max_radius: float = Field(2.5, gt=0, description="Thicker objects [m] are no trunks.")

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.radius and not self.min_radius <= self.radius <= self.max_radius:
            raise Contradiction(
                ("radius", "min_radius", "max_radius"),
                f"radius, {self.radius:g}, must lie between min_radius, {self.min_radius:g}, and "
                f"max_radius, {self.max_radius:g}",
            )
        return self


@dataclass(frozen=True)
class Columns:
    """The panorama, column by column.

    azimuth: rad. t: m to the foot of the object there; inf where there is none. foot: whether the
    foot is in the picture; if not, t is an upper bound. seen: whether the frame covers the column.
    edge: grey levels, upright contrast towards the next column.
    """

    azimuth: Vector
    t: Vector
    foot: Mask
    seen: Mask
    edge: Vector


def find_trunks(
    columns: Columns, settings: TrunkSettings, altitude: float, level: LevelFrame
) -> list[Trunk]:
    """Return the trunks in the columns of a panorama, nearest first.

    altitude: m, camera above the ground. level: the panorama's axes.
    """
    runs = _runs(columns, settings.max_range)
    found = [_fit(columns, first, last, settings, altitude, level) for first, last in runs]
    return sorted((t for t in found if t is not None), key=lambda t: t.distance - t.radius)


def _fit(
    columns: Columns,
    first: int,
    last: int,
    s: TrunkSettings,
    altitude: float,
    level: LevelFrame,
) -> Trunk | None:
    """Return the trunk in a run of columns first…last; None where it is none."""
    step = float(columns.azimuth[1] - columns.azimuth[0])
    low = float(columns.azimuth[first]) - step / 2
    high = float(columns.azimuth[last]) + step / 2
    if high - low < math.radians(s.min_width_deg):
        return None
    t, az = columns.t[first : last + 1], columns.azimuth[first : last + 1]
    foot = columns.foot[first : last + 1]
    free_low, free_high = _free(columns, first, -1), _free(columns, last, 1)
    free = (free_low, free_high)
    sure = all(free) and _alone(columns, first, -1) and _alone(columns, last, 1)
    if all(free) and foot.any():
        axis, sine = (low + high) / 2, math.sin(min((high - low) / 2, 1.45))
    else:
        axis, sine = _assumed(t, az, foot, (low, high), free, s.radius)
    delta = np.sin(az - axis)
    inner = np.abs(delta) < 0.8 * sine
    use = inner & foot
    count = int(np.count_nonzero(use))
    assumed = count < max(2, 0.25 * np.count_nonzero(inner))
    if not assumed:
        shape = np.cos(az[use] - axis) - np.sqrt(sine * sine - delta[use] ** 2)
        distance = float(np.sort(t[use] / np.maximum(shape, 0.02))[count // 2])
        radius = distance * sine
        surface = distance - radius
        tilt = (surface * surface + altitude * altitude) / altitude
        noise = math.hypot(s.attitude_sigma, step / math.sqrt(count))
        sigma = math.hypot(0.02 * distance, tilt * noise)
    else:
        # The foot is out of the picture: the width and the assumed radius give the distance.
        distance = s.radius / max(sine, 1e-3)
        radius, sigma = s.radius, (0.1 if sure else 0.2) * distance + 0.1
        # Only near trunks are wide enough to be measured by width alone.
        if distance - radius > 0.6 * s.max_range:
            return None
    if not s.min_radius <= radius <= s.max_radius or distance - radius > s.max_range:
        return None
    half_width = float(high - low) / 2 if sure else 0.0
    return Trunk(level.direction(float(axis)), distance, radius, sigma, assumed, half_width)


def _runs(columns: Columns, max_range: float) -> list[tuple[int, int]]:
    """Return the runs of columns with like distances; an upright edge parts two trunks, too."""
    edge = columns.edge[:-1]
    before, after = np.concatenate([edge[-1:], edge[:-1]]), np.concatenate([edge[1:], edge[:1]])
    crest = (edge > EDGE) & (edge >= before) & (edge >= after)
    return alike(columns.t, columns.foot, columns.seen, max_range, crest)


def alike(
    t: Vector, foot: Mask, seen: Mask, max_range: float, crest: Mask | bool = False
) -> list[tuple[int, int]]:
    """Return the runs first…last of neighbouring columns with like distances, up to max_range [m].

    t [m], foot, seen (columns,): as `Columns` has them. crest (columns − 1,): where what stands
    there ends, whatever the distances.
    """
    # The margin keeps the limbs of a trunk at the limit.
    near = seen & (t < 1.3 * max_range)
    near |= seen & ~foot & np.isfinite(t)
    # A single column lost to noise does not part a trunk.
    near[1:-1] |= near[:-2] & near[2:]
    t = np.where(near, np.minimum(t, 2.0 * max_range), np.inf)
    both = foot[1:] & foot[:-1]
    with np.errstate(invalid="ignore"):
        rise = t[1:] - t[:-1]
        jump = np.abs(rise) > 0.35 + 0.12 * np.minimum(t[1:], t[:-1])
    # Without a foot, t is only an upper bound: a foot beyond it parts two trunks.
    farther = jump & np.where(rise > 0, foot[1:], foot[:-1])
    part = np.where(both, jump, crest | farther) & near[1:] & near[:-1]
    bounds = np.flatnonzero((near[1:] != near[:-1]) | part) + 1
    return [(a, b - 1) for a, b in itertools.pairwise([0, *bounds.tolist(), len(t)]) if near[a]]


def _free(columns: Columns, index: int, side: int) -> bool:
    """Return whether the edge at a run's end is the trunk's own: its background is farther."""
    beyond = index + side
    if not 0 <= beyond + side < len(columns.t):
        return False
    if not (columns.seen[beyond] and columns.seen[beyond + side]):
        return False
    if not (columns.foot[index] and columns.foot[beyond]):
        return True
    return bool(columns.t[beyond] > columns.t[index])


def _alone(columns: Columns, index: int, side: int) -> bool:
    """Return whether no other object without a foot begins at a run's end that has none either.

    Of two such neighbours either may be the nearer one, or both are one trunk.
    """
    beyond = index + side
    standing = columns.foot[index] or columns.foot[beyond]
    return bool(standing) or not math.isfinite(columns.t[beyond])


def _assumed(
    t: Vector,
    az: Vector,
    foot: Mask,
    ends: tuple[float, float],
    free: tuple[bool, bool],
    radius: float,
) -> tuple[float, float]:
    """Return the axis' azimuth and sin β of a trunk of assumed radius, only partly in view.

    Of the distances tried, largest first, the best profile fits t(az): equal where the foot is
    seen, not beyond t where it is not, and wide enough for the columns covered.
    """
    distance = radius * TRIED
    sine = radius / distance
    beta = np.arcsin(sine)
    low, high = ends
    axis = np.full_like(beta, (low + high) / 2)
    if free[0] and not free[1]:
        axis = low + beta
    elif free[1] and not free[0]:
        axis = high - beta
    # Columns outside the profile cost as much as a wrong distance. A cut trunk is wider.
    width = (high - low) * (1.0 if foot.any() else CUT_WIDTH)
    short = np.maximum(width - 2.0 * beta, 0.0)
    if all(free):
        short = np.abs((high - low) / 2 - beta)
    delta = az[None] - axis[:, None]
    root = np.sqrt(np.maximum(sine[:, None] ** 2 - np.sin(delta) ** 2, 0.0))
    model = distance[:, None] * (np.cos(delta) - root)
    error = np.minimum(np.where(foot, np.abs(model - t), np.maximum(model - 1.03 * t, 0.0)), 0.5)
    cost = error.mean(axis=1) + distance * short
    best = int(np.argmax(cost <= cost.min() + 0.01))
    return float(axis[best]), float(sine[best])
