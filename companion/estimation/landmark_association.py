"""Which known trunk a look shows, and which is one that is not known yet."""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass

import numpy as np

from companion.estimation.assignment import assign
from companion.estimation.landmark_places import LandmarkPlaces, Look, Place
from companion.types import Trunk

_SIGMAS = 4.0  # standard deviations within which a look is compared with a landmark at all
_UNEVEN = 0.15  # m, 1 σ of a trunk's place by its shape: it leans, and its foot is not round
_AROUND = 10.0  # m about the drone within which known trunks tell how densely they stand
_NEVER = 1e6  # cost of a pair that cannot be
# A trunk of which only the width shows is another one where it shows this much wider than the known
# trunk. A thin trunk is a few columns wide; a look may miss two of them at either edge, or add two.
_WIDER, _COLUMNS = 1.5, 0.04  # times, and rad on either side


@dataclass
class Landmark:
    """A known trunk.

    axis: (x, y) m. radius: m. variance: m², of the axis. seen: s, time of the last look. odds: log
    of the odds that it is there. confirmed: it counts. kept: it is remembered for good.
    """

    axis: Place
    radius: float
    variance: float
    seen: float
    odds: float
    confirmed: bool = False
    kept: bool = False

    def hidden(self, trunk: Trunk) -> float:
        """Return how far [m] the middle of a look may be from that of this trunk.

        A confirmed trunk that shows slimmer than it is known to be is cut by the picture's edge, or
        something stands before it; one that shows wider has something beside it.
        """
        return abs(self.radius - trunk.radius) if self.confirmed else 0.0


def associated(
    looks: Sequence[tuple[Trunk, Look]],
    landmarks: Sequence[Landmark],
    places: LandmarkPlaces,
    p: Place,
    taken: Container[int] = (),
) -> list[int | None]:
    """Return the landmark that each look of one frame is of; None: a trunk that is not known yet.

    Each trunk shows once in a frame, so looks and landmarks are paired all at once, at the greatest
    likelihood. A look is of an unknown trunk where one is likelier to stand there than the known
    one to show so: the denser trunks stand about the drone at p (x, y) m, the less a doubtful look
    is taken for a known one. (Global nearest neighbour, with the density of new targets, as in
    Blackman and Popoli, Design and Analysis of Modern Tracking Systems, 1999, section 6.4.)

    taken: landmarks that other looks of the frame show. A trunk of assumed radius is none of the
    confirmed ones: `in_direction` finds those.
    """
    if not looks:
        return []
    around = sum(math.dist(k.axis, p) < _AROUND for k in landmarks)
    unknown = -2.0 * math.log((around + 1.0) / (math.pi * _AROUND**2))
    cost = np.full((len(looks), len(landmarks) + len(looks)), unknown)
    cost[:, : len(landmarks)] = _NEVER
    axes = np.array([k.axis for k in landmarks]).reshape(-1, 2)
    for i, (trunk, look) in enumerate(looks):
        apart2 = ((axes - places.corrected(look)) ** 2).sum(axis=1).tolist()
        doubt = look.along**2 + look.across**2
        for n, k in enumerate(landmarks):
            if n in taken or (trunk.assumed and k.confirmed):
                continue
            uneven = _UNEVEN**2 + k.hidden(trunk) ** 2
            if apart2[n] < _SIGMAS**2 * (doubt + uneven + k.variance):
                cost[i, n] = places.surprise(n, look, uneven)
    return [n if n < len(landmarks) else None for _, n in assign(cost)]


def in_direction(landmarks: Sequence[Landmark], trunk: Trunk, along: Place, p: Place) -> int | None:
    """Return the nearest confirmed landmark in the direction of a trunk of assumed radius.

    along: (x, y) of the direction. p: (x, y) m, of the drone. None where there is none, and where
    the trunk shows wider than the landmark can from here: another trunk stands before it.
    """
    best, nearest = None, math.inf
    half = half_width(trunk)
    for n, k in enumerate(landmarks):
        offset = (k.axis[0] - p[0], k.axis[1] - p[1])
        distance = math.hypot(*offset)
        if not k.confirmed or not k.radius < distance < nearest:
            continue
        known_half = math.asin(k.radius / distance)
        widest = max(_WIDER * known_half, known_half + _COLUMNS)
        # Where an edge is cut off, the axis is a guess: it is enough that the two overlap.
        within = max(half, known_half) if trunk.half_width else half + known_half
        if angle(along, offset) < within and half < widest:
            best, nearest = n, distance
    return best


def overlapping(
    landmarks: Sequence[Landmark], axis: Place, radius: float, share: float, but: int | None = None
) -> int | None:
    """Return the nearest landmark that a trunk at `axis` would grow into; None: there is none.

    share: of the sum of the radii within which two grow into one another. but: a landmark that does
    not count.
    """
    best, nearest = None, math.inf
    for n, k in enumerate(landmarks):
        apart = math.dist(k.axis, axis)
        if n != but and apart < min(nearest, share * (k.radius + radius)):
            best, nearest = n, apart
    return best


def half_width(trunk: Trunk) -> float:
    """Return half the angle [rad] that a trunk covers, by its radius and distance."""
    return math.asin(min(trunk.radius / trunk.distance, 1.0))


def angle(a: Place, b: Place) -> float:
    """Return the angle [rad], 0…π, between two vectors (2,)."""
    return abs(math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]))
