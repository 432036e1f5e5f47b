"""Obstacles from the columns of the network's classes, each with the distance to its foot.

Neighbouring columns of like distance form an obstacle; its two edges and the distance of its foot
give the radius, as in `trunk_fit`. One that leans has its edges where it passes the height of the
camera. One whose foot does not show, because it lies below the picture or behind a low object, is
placed by its width and by the radii of the others (`footless`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from companion.perception import column_runs
from companion.perception.column_runs import Feet, Run
from companion.perception.footless import WIDEST, within
from companion.perception.panorama import LevelFrame
from companion.perception.pixels import percentile
from companion.perception.trunk_fit import Mask, TrunkSettings
from companion.types import Trunk
from mavlink_bridge.shared.arrays import Vector

_NEARER = 0.5  # of the columns with a foot: so many without may show that it is nearer than these
_MOST = 0.7  # of a run's columns: what rises behind a low object so wide is all that counts


class FootSettings(TrunkSettings):
    """The same for the network, which needs no width to tell an obstacle by."""

    step_deg: float = Field(0.75, ge=0.2, le=3, description="Pixel of the level panorama.")
    min_width_deg: float = Field(1.2, gt=0, description="Narrower objects are no obstacles.")
    min_radius: float = Field(0.05, gt=0, description="Thinner objects [m] are no obstacles.")
    radius: float = Field(
        0.0,
        ge=0,
        description="Assumed [m] where the foot does not show; 0: as the others in the picture.",
    )


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
    parts = column_runs.runs(feet, settings.max_range)
    slope = altitude / feet.t
    whole = [column_runs.at_height(feet, run, slope) for run in parts]
    sides = column_runs.sides(whole, parts)
    found: list[Trunk | _Footless | None] = []
    for n, (run, edges) in enumerate(zip(parts, whole, strict=True)):
        if n in sides:
            continue
        tall = column_runs.behind(feet, run, altitude)
        found += [_Footless(bounds, feet.ends(own), (False, False)) for own, bounds in tall]
        if not any(b - a >= _MOST * (run[1] - run[0]) for (a, b), _ in tall):
            found.append(_fit(feet, run, edges, settings, altitude, level))
    obstacles = [t for t in found if isinstance(t, Trunk)]
    radii = np.array([settings.radius] if settings.radius else [t.radius for t in obstacles])
    obstacles += [_placed(f, radii, settings, level) for f in found if isinstance(f, _Footless)]
    near = (t for t in obstacles if t.distance - t.radius <= settings.max_range)
    return sorted(near, key=lambda t: t.distance - t.radius)


def _fit(
    feet: Feet, run: Run, edges: Run, s: FootSettings, altitude: float, level: LevelFrame
) -> Trunk | _Footless | None:
    """Return the obstacle in a run of columns, from first to last; None where it is none.

    edges: its first and last column at the height of the camera.
    """
    low, high = feet.ends(edges)
    if high - low < math.radians(s.min_width_deg):
        return None
    here = slice(run[0], run[1] + 1)
    t, foot = feet.t[here], feet.foot[here]
    surface, use = _surface(feet.azimuth[here], t, foot, feet.ends(run))
    if not math.isfinite(surface):
        return _Footless((0.0, float(t.min())), (low, high), column_runs.cut(feet, edges))
    half = min((high - low) / 2, WIDEST)
    distance = surface / (1.0 - math.sin(half))
    radius = distance - surface
    if not s.min_radius <= radius <= s.max_radius:
        return None
    tilt = (surface * surface + altitude * altitude) / altitude
    step = float(feet.azimuth[1] - feet.azimuth[0]) / math.sqrt(len(use))
    noise = math.hypot(s.attitude_sigma, step, percentile(feet.blur[here][use], 50))
    sigma = math.hypot(0.02 * distance, tilt * noise)
    shown = half if column_runs.whole(feet, run) else 0.0
    return Trunk(level.direction((low + high) / 2), distance, radius, sigma, False, shown)


def _surface(
    azimuth: Vector, t: Vector, foot: Mask, ends: tuple[float, float]
) -> tuple[float, NDArray[np.intp]]:
    """Return the distance [m] of the nearest point of a foot, and the columns (n,) that tell it.

    azimuth [rad], t [m], foot (columns,): as `Feet` has them. ends: rad, outer edges of the foot.
    It is inf where no foot shows, or where columns without one are nearer than it.
    """
    sine = math.sin(min((ends[1] - ends[0]) / 2, WIDEST))
    delta = np.sin(azimuth - (ends[0] + ends[1]) / 2)
    square = delta * delta
    shape = np.sqrt(1.0 - square) - np.sqrt(np.maximum(sine * sine - square, 0.0))
    shape = np.maximum(shape, 0.02)
    inner = square < (0.8 * sine) ** 2
    use, other = np.flatnonzero(inner & foot), np.flatnonzero(inner & ~foot)
    if len(use) < 2:
        return math.inf, use
    distance = float(np.sort(t[use] / shape[use])[len(use) // 2])
    nearer = np.count_nonzero(distance * shape[other] > 1.05 * t[other])
    if nearer > _NEARER * len(use):
        return math.inf, use
    return distance * (1.0 - sine), use


def _placed(seen: _Footless, radii: Vector, s: FootSettings, level: LevelFrame) -> Trunk:
    """Return an obstacle whose foot does not show.

    radii (n,): m, of the obstacles measured in the same picture.
    """
    low, high = seen.ends
    half, one = (high - low) / 2, seen.cut[0] != seen.cut[1]
    limits = s.min_radius, s.max_radius
    surface, sigma, beta = within(seen.bounds, half, one, limits, radii)
    axis = (low + high) / 2
    if one:
        axis = high - beta if seen.cut[0] else low + beta
    distance = surface / (1.0 - math.sin(beta))
    shown = 0.0 if any(seen.cut) else half
    return Trunk(level.direction(axis), distance, distance - surface, sigma, True, shown)
