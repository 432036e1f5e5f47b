"""Obstacle map: trunks seen and remembered, for a 160° camera does not show what is beside it.

Trunks do not move: each look refines a small map in the drone's own frame. The drone's own drift
moves all of them alike, and makes them uncertain: see `landmark_places.py`. A trunk that should be
in plain view is the less likely to be there the oftener it is missed, and is forgotten in the end,
see `existence.py`. A trunk behind the drone is kept until it is far away.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from companion.estimation.existence import CONFIRMED, SUREST, check_chances, log_odds
from companion.estimation.landmark_association import (
    Landmark,
    angle,
    associated,
    half_width,
    in_direction,
    overlapping,
)
from companion.estimation.landmark_places import Drift, Foot, LandmarkPlaces, Look, Place
from companion.estimation.map_upsets import MapUpsets
from companion.model import yaw_of
from companion.perception.ground_plane import LEVEL, GroundPlane
from companion.perception.parallax import FixedPoints
from companion.types import Trunk
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.shared.settings import StrictModel
from mavlink_bridge.wire.messages import VehicleState


class ObstacleConfig(StrictModel):
    """Numbers of the obstacle map."""

    overlap: float = Field(
        0.7,
        ge=0,
        description="Looks nearer than this share of the sum of their radii are of one trunk.",
    )
    detected: float = Field(
        0.7,
        gt=0,
        lt=1,
        description="Probability that a trunk in plain view is seen. With `ghosts`: three looks "
        "make a trunk, after six it is remembered for good, eight misses end it then.",
    )
    ghosts: float = Field(
        0.17, gt=0, lt=1, description="Probability of such a look where no trunk is."
    )
    doubtful_unseen: float = Field(
        1.5,
        gt=0,
        description="Longest memory [s] of a trunk that just counts, out of view; of surer ones "
        "longer.",
    )
    keep_range: float = Field(20.0, gt=0, description="Trunks farther than this [m] are forgotten.")
    view_range: float = Field(
        6.0, gt=0, description="A trunk nearer than this [m] must be seen where it is in view."
    )
    sigma_floor: float = Field(0.03, gt=0, description="Least std [m] of a trunk's place.")

    @model_validator(mode="after")
    def _check_chances(self) -> Self:
        check_chances(self.detected, self.ghosts)
        return self


_BEARING = 0.02  # rad, 1 σ of the direction to a trunk's axis
_TIMING = 0.01  # s, 1 σ: when a picture was taken; turns a look by as much as the drone turns
_SIGMAS = 4.0  # standard deviations that explain how far looks at a trunk differ
_BEHIND, _LOW = 0.5, 0.3  # m: how far behind a trunk, and over the ground, lines of sight tell
_RADIUS, _EDGE = 0.04, 0.015  # m and rad, 1 σ of a known radius and of half a width
_WIDEST = 1.4  # rad; half a trunk's width
_UNKNOWN = log_odds(0.2)  # that a trunk stands where nothing was seen before


@dataclass(frozen=True)
class _Here:
    """The drone as it took a frame.

    p: (x, y) m. height: m, over ground. yaw: rad. turning: rad, 1 σ of a direction by the timing of
    the picture, while the drone turns. time: s.
    """

    p: Place
    height: float
    yaw: float
    turning: float
    time: float


_STILL = Drift()
_PLAIN = 0.5  # share of a place that the frame shows, from which it is in plain view
_BLANK = 2  # looks in a row, from which the eyes have failed


class ObstacleMap:
    """Remembers trunks in the drone's own ENU frame."""

    def __init__(self, config: ObstacleConfig) -> None:
        self._config = config
        self._hit = math.log(config.detected / config.ghosts)
        self._landmarks: list[Landmark] = []
        self._places = LandmarkPlaces()
        self._blank_looks = 0
        self._upsets = MapUpsets()

    def upsets(self, time: float) -> int:
        """Return how many known trunks have moved or vanished in the 20 s before `time` [s]."""
        return self._upsets.lately(time)

    @property
    def blank(self) -> bool:
        """Whether the last looks showed no trunk at all, with a trunk known for good in plain view.

        Then it is likelier that the eyes fail than that the trunk is gone: it is kept.
        """
        return self._blank_looks >= _BLANK

    def update(
        self,
        trunks: Sequence[Trunk],
        own: VehicleState,
        q_bc: Vector,
        half_view: float,
        visibility: Callable[[Vector], Vector] = lambda places: np.ones(len(places)),
        drift: Drift = _STILL,
        ground: GroundPlane = LEVEL,
        depth: bool = False,
    ) -> None:
        """Take in the trunks of one frame, seen in state `own`.

        q_bc: (4,) camera → body. half_view: half the field of view [rad]. visibility: returns how
        far the frame shows each of places (n,3), as (n,) 0…1. A trunk counts as missed only as far
        as the frame shows its place. drift: of the own pose since the last frame. depth: the frame
        has distances, which show that a place is empty.

        A near thin trunk looks like a thick one far off where its foot is out of the picture, or
        where the picture's edge cuts it: a landmark in that direction is that trunk. Where both
        edges show, its known radius tells how far it is.
        """
        r_wb = rotation_matrix(own.q_wb)
        r_wc = r_wb @ rotation_matrix(q_bc)
        x, y, z = own.p.tolist()
        turning = _TIMING * abs(float(r_wb[2] @ own.omega))
        here = _Here((x, y), ground.under(own.p), yaw_of(own.q_wb), turning, own.time)
        self._places.drift(here.p, drift)
        self._refresh()
        self._upsets.before([k for k in self._landmarks if k.kept], here.p)
        seen: set[int] = set()
        looks: list[tuple[Trunk, Look]] = []
        for trunk in trunks:
            east, north, _ = (r_wc @ trunk.direction).tolist()
            along = (east, north)
            n = in_direction(self._landmarks, trunk, along, here.p) if trunk.assumed else None
            if n is not None:
                self._see_width(n, trunk, along, here)
                self._mark_seen(n, own.time)
                seen.add(n)
                continue
            scale = trunk.distance / max(math.hypot(*along), 1e-6)
            looks.append((trunk, _look((x + east * scale, y + north * scale), trunk, here)))
        found = associated(looks, self._landmarks, self._places, here.p, seen)
        for (trunk, look), n in zip(looks, found, strict=True):
            seen.add(self._fuse(trunk, look, n, here))
        self._upsets.shifted(own.time)
        seen = self._merge_duplicates(seen)
        forward = (float(r_wc[0, 2]), float(r_wc[1, 2]))
        missed = list(self._missed(seen, here.p, forward, half_view))
        places = np.array([[*self._landmarks[n].axis, z] for n in missed]).reshape(-1, 3)
        shown = dict(zip(missed, visibility(places).tolist() if missed else [], strict=True))
        known = [n for n, look in shown.items() if look > _PLAIN and self._landmarks[n].kept]
        blank = bool(known) and not seen and not depth
        self._blank_looks = self._blank_looks + 1 if blank else 0
        for n, look in shown.items():
            if not blank or n not in known:
                self._landmarks[n].odds += math.log(1.0 - self._config.detected * look)
        self._forget(here)

    def turn(self, p: Vector, angle: float) -> None:
        """Turn all trunks left about p (3,) m by a small `angle` [rad]."""
        self._places.turn(p, angle)
        self._refresh()

    def see_through(self, p: Vector, fixed: FixedPoints, ground: GroundPlane = LEVEL) -> None:
        """Count points seen from p (3,) m behind a landmark as looks that missed it.

        Two lines of sight through its middle, of points that stand clearly behind it, are a look.
        """
        if not self._landmarks or len(fixed.sigmas) < 2:
            return
        trunks = self.occluders()
        to, up = fixed.places[:, :2] - p[:2], fixed.places[:, 2] - p[2]  # of n points
        length = np.maximum(np.linalg.norm(to, axis=1), 1e-6)
        x, y = (trunks[:, :2] - p[:2]).T[..., None]  # of k trunks, (k,1)
        radius = trunks[:, 2:]
        along = (to[:, 0] * x + to[:, 1] * y) / length
        aside = np.abs(to[:, 0] * y - to[:, 1] * x) / length
        behind = length - along > radius + _BEHIND + _SIGMAS * fixed.sigmas
        height = p[2] + up * along / length - ground.below(trunks)[:, None]
        through = (along > radius) & (aside < 0.6 * radius) & behind & (height > _LOW)
        for k, count in zip(self._landmarks, through.sum(axis=1).tolist(), strict=True):
            if count >= 2:
                k.odds += math.log(1.0 - self._config.detected)

    def cylinders(self, p: Vector) -> Vector:
        """Return confirmed trunks (K,3) x, y, radius [m], nearest surface to p (3,) m first."""
        return self.doubted_cylinders(p)[:, :3]

    def doubted_cylinders(self, p: Vector) -> Vector:
        """Return confirmed trunks (K,4) as `cylinders`, with the 1 σ of the place [m]."""
        confirmed = [k for k in self._landmarks if k.confirmed]
        here = (float(p[0]), float(p[1]))
        confirmed.sort(key=lambda k: math.dist(k.axis, here) - k.radius)
        rows = [[*k.axis, k.radius, math.sqrt(k.variance)] for k in confirmed]
        return np.array(rows).reshape(-1, 4)

    def occluders(self) -> Vector:
        """Return all trunks (J,3) x, y, radius [m], unconfirmed ones too."""
        return np.array([[*k.axis, k.radius] for k in self._landmarks]).reshape(-1, 3)

    def _fuse(self, trunk: Trunk, look: Look, n: int | None, here: _Here) -> int:
        """Refine landmark n, or the one that the trunk overlaps, or add one; return its index."""
        if n is None:
            axis = self._places.corrected(look)
            n = overlapping(self._landmarks, axis, trunk.radius, self._config.overlap)
        variance = trunk.sigma**2 + (here.turning * trunk.distance) ** 2
        if n is None:
            self._places.add(look)
            n = len(self._landmarks)
            self._landmarks.append(Landmark(axis, trunk.radius, variance, here.time, _UNKNOWN))
            self._mark_seen(n, here.time)
            self._refresh()
            return n
        k = self._landmarks[n]
        hidden = k.hidden(trunk)
        share = k.variance / (k.variance + variance + hidden**2)
        k.radius += share * (trunk.radius - k.radius)
        look = replace(
            look, along=math.hypot(look.along, hidden), across=math.hypot(look.across, hidden)
        )
        self._places.correct(n, look, self._config.sigma_floor**2)
        self._refresh()
        self._mark_seen(n, here.time)
        return n

    def _see_width(self, n: int, trunk: Trunk, along: Place, here: _Here) -> None:
        """Refine the place of landmark n by the two edges of a trunk without a foot."""
        if not trunk.half_width:
            return
        k, level = self._landmarks[n], max(math.hypot(*along), 1e-6)
        half = min(trunk.half_width, _WIDEST)
        distance = k.radius / math.sin(half)
        noise = math.hypot(_RADIUS / k.radius, _EDGE / math.tan(half))
        across = math.hypot(_BEARING, here.turning) * distance
        scale = distance / level
        place = here.p[0] + along[0] * scale, here.p[1] + along[1] * scale
        look = Look(here.p, place, noise * distance, across)
        known = math.dist(k.axis, here.p)
        if abs(distance - known) < _SIGMAS * math.hypot(look.along, math.sqrt(k.variance)):
            self._places.correct(n, look, self._config.sigma_floor**2)
            self._refresh()

    def _refresh(self) -> None:
        """Give the landmarks their present places and variances."""
        now = zip(self._landmarks, self._places.places(), self._places.variances(), strict=True)
        for k, axis, variance in now:
            k.axis, k.variance = axis, variance

    def _keep(self, left: list[int]) -> None:
        """Drop all landmarks but those of these indices."""
        if len(left) < len(self._landmarks):
            self._landmarks = [self._landmarks[n] for n in left]
            self._places.keep(left)

    def _mark_seen(self, n: int, time: float) -> None:
        """Count a look at `time` [s] that saw landmark n."""
        k = self._landmarks[n]
        k.odds, k.seen = min(k.odds + self._hit, SUREST), time
        k.confirmed |= k.odds >= CONFIRMED
        k.kept |= k.odds >= SUREST

    def _merge_duplicates(self, seen: set[int]) -> set[int]:
        """Drop the less certain of two landmarks that looks have moved to one place.

        Return the indices of `seen` after that.
        """
        gone: set[int] = set()
        for n in sorted(seen):
            k = self._landmarks[n]
            m = overlapping(self._landmarks, k.axis, k.radius, self._config.overlap, but=n)
            if m is None or {n, m} & gone:
                continue
            stays, goes = sorted((n, m), key=lambda i: (self._landmarks[i].variance, i))
            self._mark_seen(stays, k.seen)
            seen = seen | {stays}
            gone.add(goes)
        left = [n for n in range(len(self._landmarks)) if n not in gone]
        self._keep(left)
        return {new for new, old in enumerate(left) if old in seen}

    def _missed(self, seen: set[int], p: Place, forward: Place, half_view: float) -> Iterator[int]:
        """Yield the landmarks that should be in plain view and were not seen."""
        for n, k in enumerate(self._landmarks):
            offset = (k.axis[0] - p[0], k.axis[1] - p[1])
            near = k.radius + 0.3 < math.hypot(*offset) < self._config.view_range
            in_view = near and angle(forward, offset) < half_view - 0.2
            if n not in seen and in_view and not self._occluded(n, p):
                yield n

    def _forget(self, here: _Here) -> None:
        """Drop landmarks that are unlikely to be there, far away, or doubtful and out of view."""
        c = self._config
        self._upsets.vanished(here.time, [k for k in self._landmarks if k.odds < -CONFIRMED])
        # Of a trunk that just counts as long as the setting says; less of ghosts, in proportion.
        memory = c.doubtful_unseen / (2.0 * CONFIRMED)
        self._keep(
            [
                n
                for n, k in enumerate(self._landmarks)
                if k.odds >= -CONFIRMED
                and math.dist(k.axis, here.p) < c.keep_range
                and (k.kept or here.time - k.seen <= memory * (k.odds + CONFIRMED))
            ]
        )

    def _occluded(self, n: int, p: Place) -> bool:
        """Return whether a nearer trunk covers part of landmark n as seen from p."""
        target = self._landmarks[n]
        offset = (target.axis[0] - p[0], target.axis[1] - p[1])
        distance = math.hypot(*offset)
        for m, k in enumerate(self._landmarks):
            other = (k.axis[0] - p[0], k.axis[1] - p[1])
            d = math.hypot(*other)
            if m == n or d >= distance:
                continue
            covers = math.asin(min(k.radius / d, 1.0))
            if angle(offset, other) < covers + math.asin(min(target.radius / distance, 1.0)):
                return True
        return False


def _look(place: Place, trunk: Trunk, here: _Here) -> Look:
    """Return the look at a trunk whose axis is seen at `place` (x, y) m."""
    across = math.hypot(math.hypot(_BEARING, here.turning) * trunk.distance, _cut(trunk))
    # Without a foot in the picture its width tells the distance: no tilt shifts that.
    foot = None if trunk.assumed else Foot(here.yaw, here.height, trunk.radius)
    return Look(here.p, place, trunk.sigma, across, foot)


def _cut(trunk: Trunk) -> float:
    """Return the 1 σ [m], across the line of sight, by which a cut-off edge leaves the axis open.

    The axis is the edge that shows and half the width, which follows from the assumed distance: an
    error e of that turns it by e tan(β) / distance.
    """
    if not trunk.assumed or trunk.half_width:
        return 0.0
    return trunk.sigma * math.tan(min(half_width(trunk), _WIDEST))
