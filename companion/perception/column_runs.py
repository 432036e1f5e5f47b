"""Columns of the network's classes, and which neighbouring ones belong to one obstacle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from companion.perception.trunk_fit import Mask, alike
from mavlink_bridge.shared.arrays import Vector

Run = tuple[int, int]  # first and last column
_ALIKE = 0.15  # of their distance: so much may parts of one obstacle differ
_GAP = 6  # columns that a broken obstacle may miss, where its foot goes on
_LEAN = 0.02  # a leaning trunk's side rises by so much, in tan of elevation, a column
_TALL = math.radians(4.0)  # what rises higher than this stands behind a low object
_LOW = math.radians(-2.0)  # what ends below this is a low object
_ASIDE = (2, 3)  # columns from a trunk's edge at which the low object before it is looked for
_SAME_FOOT = 0.08  # of the distance: where the foot of both is one


@dataclass(frozen=True)
class Feet:
    """The panorama, column by column.

    azimuth: rad. t: m to the foot of what stands there; inf where nothing does. foot: whether the
    foot is in the picture; if not, t is an upper bound. seen: whether the frame covers the column;
    level: also at the height of the camera. there: whether an obstacle is at that height. blur:
    rad, 1 σ of the foot's elevation, beyond that of the attitude. lowest: m to the lowest foot,
    also where a low object has it. top: rad, elevation up to which there is no gap above that
    foot. rise: m/m, of the ground.
    """

    azimuth: Vector
    t: Vector
    foot: Mask
    seen: Mask
    level: Mask
    there: Mask
    blur: Vector
    lowest: Vector
    top: Vector
    rise: Vector

    def ends(self, run: Run) -> tuple[float, float]:
        """Return the azimuths [rad] of the outer edges of a run."""
        half = float(self.azimuth[1] - self.azimuth[0]) / 2
        return float(self.azimuth[run[0]]) - half, float(self.azimuth[run[1]]) + half


def runs(feet: Feet, max_range: float) -> list[Run]:
    """Return the runs of neighbouring columns with like distances, up to max_range [m]."""
    return _merged(feet, alike(feet.t, feet.foot, feet.seen, max_range))


def _merged(feet: Feet, parts: list[Run]) -> list[Run]:
    """Return the runs, made one where the foot of two goes on between them."""
    made: list[Run] = []
    for first, end in parts:
        if made and first - made[-1][1] <= _GAP:
            t, last = _middle(feet.t, (first, end)), _middle(feet.t, made[-1])
            like = _ALIKE * min(t, last)
            between = np.abs(feet.lowest[made[-1][1] + 1 : first] - t)
            if abs(t - last) < like and bool((between < like).all()):
                first = made.pop()[0]
        made.append((first, end))
    return made


def _middle(values: Vector, run: Run) -> float:
    """Return the median of the columns of a run."""
    return float(np.sort(values[run[0] : run[1] + 1])[(run[1] - run[0]) // 2])


def at_height(feet: Feet, run: Run, slope: Vector) -> Run:
    """Return the first and last column of an obstacle at the height of the camera.

    slope (columns,): tan of the angle of each foot below the horizon. A trunk that leans stands
    aside of its foot there: columns beyond the foot meet its lower side, the higher the farther
    they are from it, and on the other side columns end below the horizon.
    """
    first, last = (_beyond(feet, end, side, slope) for end, side in zip(run, (-1, 1), strict=True))
    there = run[0] + np.flatnonzero(feet.there[run[0] : run[1] + 1])
    if 2 * len(there) > run[1] - run[0]:
        first = int(there[0]) if first == run[0] else first
        last = int(there[-1]) if last == run[1] else last
    return first, last


def _beyond(feet: Feet, end: int, side: int, slope: Vector) -> int:
    """Return the last column of the lower side of a trunk that leans to one side of a run."""
    k, before, even = end, end, True
    while (
        0 <= k + side < len(slope)
        and feet.there[k + side]
        and feet.seen[k + side]
        and slope[before] - slope[k + side] > _LEAN * abs(k + side - before)
    ):
        even = even and bool(slope[k] - slope[k + side] > _LEAN)
        before, k = k, k + side
    # One column is a trunk's limb, a second one as high as the first is what stands behind it.
    return k if abs(k - end) > (1 if even else 2) else end


def sides(whole: list[Run], parts: list[Run]) -> set[int]:
    """Return the numbers of the runs that are the sides of others, which lean.

    whole: the first and last column of each at the height of the camera. parts: of each foot.
    """
    return {
        n
        for n, (first, last) in enumerate(parts)
        for (low, high), (a, b) in zip(whole, parts, strict=True)
        if low <= first and last <= high and (last < a or first > b)
    }


def behind(feet: Feet, run: Run, altitude: float) -> list[tuple[Run, tuple[float, float]]]:
    """Return what rises behind a low object in a run: its columns, and bounds of its distance [m].

    altitude: m, of the camera. On both sides of it the same foot goes on, and what stands on it
    ends below the horizon: so its own foot is hidden, between this foot and the line of sight over
    the low object.
    """
    if not (feet.top[max(run[0] - _ASIDE[0], 0) : run[1] + _ASIDE[0] + 1] < _LOW).any():
        return []
    tall = np.concatenate([[False], feet.top[run[0] : run[1] + 1] > _TALL, [False]])
    ends = (run[0] + np.flatnonzero(tall[1:] != tall[:-1])).tolist()
    found = []
    for first, last in zip(ends[::2], [end - 1 for end in ends[1::2]], strict=True):
        beside = [first - n for n in _ASIDE] + [last + n for n in _ASIDE]
        if last == first or min(beside) < 0 or max(beside) >= len(feet.t):
            continue
        if not (feet.seen[beside] & (feet.top[beside] < _LOW)).all():
            continue
        t = _middle(feet.lowest, (first, last))
        if (np.abs(feet.lowest[beside] - t) < _SAME_FOOT * t).all():
            over = math.tan(-float(feet.top[beside].max())) + float(feet.rise[first])
            found.append(((first, last), (t, max(altitude / max(over, 1e-3), t))))
    return found


def cut(feet: Feet, run: Run) -> tuple[bool, bool]:
    """Return whether the picture's side hides what is beyond a run's first and last column."""
    first, last = run[0] - 1, run[1] + 1
    return (
        first < 0 or not bool(feet.level[first]),
        last >= len(feet.level) or not bool(feet.level[last]),
    )


def whole(feet: Feet, run: Run) -> bool:
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
