"""Obstacles from the columns of the network's classes, each with the distance to its foot.

Neighbouring columns of like distance form an obstacle; its two edges and the distance of its foot
give the radius, as in `trunk_fit`. One whose foot does not show is placed by its width and by the
radii of the others (`footless`).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from companion.perception.footless import WIDEST, within
from companion.perception.panorama import LevelFrame
from companion.perception.pixels import percentile
from companion.perception.trunk_fit import Mask, TrunkSettings
from companion.types import Trunk
from mavlink_bridge.shared.arrays import Vector

_BEYOND = 0.5  # of the columns with a foot: so many without may lie nearer than these say


class FootSettings(TrunkSettings):
    """The same for the network, which needs no width to tell an obstacle by."""

    step_deg: float = Field(0.75, ge=0.2, le=3, description="Pixel of the level panorama.")
    min_width_deg: float = Field(1.2, gt=0, description="Narrower objects are no obstacles.")
    min_radius: float = Field(0.05, gt=0, description="Thinner objects [m] are no obstacles.")
    radius: float = Field(
        0.0,
        ge=0,
        description="Assumed [m] where the foot does not show; 0: unknown.",
    )


@dataclass(frozen=True)
class Feet:
    """The panorama, column by column.

    azimuth: rad. t: m to the foot of the object there; inf where there is none. foot: whether the
    foot is in the picture; if not, t is an upper bound. seen: whether the frame covers the column;
    level: also at the height of the camera. blur: rad, 1 σ of the foot's elevation, beyond that of the attitude.
    """

    azimuth: Vector
    t: Vector
    foot: Mask
    seen: Mask
    level: Mask
    blur: Vector


@dataclass(frozen=True)
class _Footless:
    """An obstacle whose foot does not show.

    bounds: m, of the distance to its surface. ends: rad, azimuths of its edges. cut: whether the
    picture's side hides what is beyond each.
    """

    bounds: tuple[float, float]
    ends: tuple[float, float]
    cut: tuple[bool, bool]


def find_obstacles(
    feet: Feet, settings: FootSettings, altitude: float, level: LevelFrame
) -> list[Trunk]:
    """Return the obstacles in the columns of a panorama, nearest first.

    altitude: m, camera above the ground. level: the panorama's axes.
    """
    runs = _runs(feet, settings.max_range)
    found = [_fit(feet, run, settings, altitude, level) for run in runs]
    obstacles = [t for t in found if isinstance(t, Trunk)]
    radii = np.array([settings.radius] if settings.radius else [t.radius for t in obstacles])
    obstacles += [_placed(f, radii, settings, level) for f in found if isinstance(f, _Footless)]
    near = (t for t in obstacles if t.distance - t.radius <= settings.max_range)
    return sorted(near, key=lambda t: t.distance - t.radius)


def _fit(
    feet: Feet, run: tuple[int, int], s: FootSettings, altitude: float, level: LevelFrame
) -> Trunk | _Footless | None:
    """Return the obstacle in a run of columns, from first to last; None where it is none."""
    step = float(feet.azimuth[1] - feet.azimuth[0])
    here = slice(run[0], run[1] + 1)
    low, high = float(feet.azimuth[run[0]]) - step / 2, float(feet.azimuth[run[1]]) + step / 2
    if high - low < math.radians(s.min_width_deg):
        return None
    t, foot = feet.t[here], feet.foot[here]
    axis, half = (low + high) / 2, min((high - low) / 2, WIDEST)
    sine, delta = math.sin(half), np.sin(feet.azimuth[here] - axis)
    inner = np.abs(delta) < 0.8 * sine
    use, bound = inner & foot, inner & ~foot
    count = int(np.count_nonzero(use))
    shape = np.sqrt(1.0 - delta * delta) - np.sqrt(np.maximum(sine * sine - delta * delta, 0.0))
    shape = np.maximum(shape, 0.02)
    distance = float(np.sort(t[use] / shape[use])[count // 2]) if count > 1 else math.inf
    beyond = np.count_nonzero(distance * shape[bound] > 1.05 * t[bound])
    if count < 2 or beyond > _BEYOND * count:
        cut = _cut(feet, run[0], -1), _cut(feet, run[1], 1)
        return _Footless((0.0, float(t.min())), (low, high), cut)
    radius = distance * sine
    if not s.min_radius <= radius <= s.max_radius:
        return None
    surface = distance - radius
    tilt = (surface * surface + altitude * altitude) / altitude
    noise = math.hypot(
        s.attitude_sigma, step / math.sqrt(count), percentile(feet.blur[here][use], 50)
    )
    sigma = math.hypot(0.02 * distance, tilt * noise)
    shown = half if _whole(feet, run) else 0.0
    return Trunk(level.direction(axis), distance, radius, sigma, False, shown)


def _placed(seen: _Footless, radii: Vector, s: FootSettings, level: LevelFrame) -> Trunk:
    """Return an obstacle whose foot does not show.

    radii (n,): m, of the obstacles measured in the same picture.
    """
    half = (seen.ends[1] - seen.ends[0]) / 2
    cut = seen.cut[0] != seen.cut[1]
    limits = s.min_radius, s.max_radius
    surface, sigma, beta = within(seen.bounds, half, cut, limits, radii)
    axis = (seen.ends[0] + seen.ends[1]) / 2
    if cut:
        axis = seen.ends[1] - beta if seen.cut[0] else seen.ends[0] + beta
    distance = surface / (1.0 - math.sin(beta))
    shown = 0.0 if any(seen.cut) else half
    return Trunk(level.direction(axis), distance, distance - surface, sigma, True, shown)


def _runs(feet: Feet, max_range: float) -> list[tuple[int, int]]:
    """Return the runs first…last of neighbouring columns with like distances."""
    # The margin keeps the limbs of a trunk at the limit.
    near = feet.seen & (feet.t < 1.3 * max_range)
    near |= feet.seen & ~feet.foot & np.isfinite(feet.t)
    # A single column lost to noise does not part a trunk.
    near[1:-1] |= near[:-2] & near[2:]
    t = np.where(near, np.minimum(feet.t, 2.0 * max_range), np.inf)
    both = feet.foot[1:] & feet.foot[:-1]
    with np.errstate(invalid="ignore"):
        rise = t[1:] - t[:-1]
        jump = np.abs(rise) > 0.35 + 0.12 * np.minimum(t[1:], t[:-1])
    # Without a foot, t is only an upper bound: a foot beyond it parts two trunks.
    farther = jump & np.where(rise > 0, feet.foot[1:], feet.foot[:-1])
    part = np.where(both, jump, farther) & near[1:] & near[:-1]
    bounds = np.flatnonzero((near[1:] != near[:-1]) | part) + 1
    return [(a, b - 1) for a, b in itertools.pairwise([0, *bounds.tolist(), len(t)]) if near[a]]


def _cut(feet: Feet, index: int, side: int) -> bool:
    """Return whether the picture's side hides what is beyond a run's end."""
    beyond = index + side
    return not 0 <= beyond < len(feet.t) or not bool(feet.level[beyond])


def _whole(feet: Feet, run: tuple[int, int]) -> bool:
    """Return whether both edges of a run are the obstacle's own: what is beyond is farther."""
    for index, side in ((run[0], -1), (run[1], 1)):
        beyond = index + side
        if not 0 <= beyond + side < len(feet.t):
            return False
        if not (feet.seen[beyond] and feet.seen[beyond + side]):
            return False
        if feet.foot[index] and feet.foot[beyond] and feet.t[beyond] <= feet.t[index]:
            return False
    return True
