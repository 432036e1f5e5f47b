"""The vehicle's clock: its offset and rate against the local clock, from stamps that arrive late.

Each telemetry message carries the vehicle's time at which it was made, and arrives later. In the
plane of (arrival, stamp) all points lie below the line of the true clock, by their latency. The
line above all points that is nearest to them at one instant is the edge of their upper convex hull
over that instant (Moon, Skelly and Towsley, "Estimation and removal of clock skew from network
delay measurements", INFOCOM 1999). It assumes nothing of the latency but that some messages are
quick, and it gives the rate as well as the offset.

That line is too low by the least latency. Where the vehicle answers requests of its time, each
answer bounds its clock from above, too: it showed the stamp no earlier than the request was sent.
The estimate then lies midway between floors and ceilings, and how far they are apart is its doubt.
"""

from __future__ import annotations

import itertools
import math
import statistics
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.types import STAMP_AHEAD
from mavlink_bridge.shared.arrays import Vector

_WINDOWS = (8.0, 4.0, 2.0, 1.0)  # s of messages that count; shorter ones where the rate has changed
_BUCKET = 0.1  # s; the least delayed message of each is kept
_OVER = 0.75  # of a window: where its line is tangent; nearer to now a change shows sooner
_SHORTEST = 0.8  # s of messages before their rate is believed
_RATES = (0.4, 2.5)  # relative to the local clock; no other rate is believed
_LEAST_LATENCY = 0.02  # s that even the quickest message may take: doubt where no answer bounds it
_RESOLUTION = 0.001  # s of the stamps
_LATE = 0.01  # s; where the quickest of the last second is later, the rate has changed
_MISFIT = 0.003  # s by which floors may lie above ceilings before the rate has changed
_FEWEST = 4  # ceilings that bound the clock
_FIRST_AHEAD = (0.25, 1.5)  # s, and s/s since the first message, while the rate is not known
_BEHIND = 0.2  # s that the stamp of an answer is too early: the clock has jumped back
_BACK = 1.0  # s; a stamp that goes back by more is of another boot
_PERSISTS = (3, 0.1)  # messages on end, and s, from which on odd stamps are a jump of the clock
_REFUTES = 1.0  # s around a round trip in which it refutes stamps
_KEPT = 1.5  # s after a jump for which the rate before it is believed; it is measured in 0.8 s
_RATE_CHANGE = 0.1  # of the rate, that is allowed for meanwhile
_GRID = np.linspace(-1.0, 1.0, 33)  # of rates to choose from, ever finer
_FINEST = 1e-5

Point = tuple[float, float]  # local time, vehicle's time [s]


@dataclass(frozen=True)
class ClockEstimate:
    """The line vehicle's time = offset + rate · local time [s].

    doubt: s, largest error of the vehicle's time now. rate_doubt: of the rate; infinite until the
    rate is measured. bounded: whether a round trip bounds the offset. jumps: how often the clock
    has jumped or begun anew.
    """

    offset: float
    rate: float = 1.0
    doubt: float = _LEAST_LATENCY
    rate_doubt: float = math.inf
    bounded: bool = False
    jumps: int = 0

    @property
    def measured(self) -> bool:
        """Whether the rate is measured, or still taken as it was before."""
        return math.isfinite(self.rate_doubt)

    def vehicle(self, local: float) -> float:
        """Return the vehicle's time [s] at a local time [s]."""
        return self.offset + self.rate * local

    def local(self, vehicle: float) -> float:
        """Return the local time [s] of a vehicle's time [s]."""
        return (vehicle - self.offset) / self.rate


class VehicleClock:
    """Follows the clock of one vehicle."""

    def __init__(self) -> None:
        self._known: ClockEstimate | None = None
        self._floors: deque[Point] = deque()  # (arrival, stamp): the clock shows no less
        self._ceilings: deque[Point] = deque()  # (sent, stamp of the answer): it shows no more
        self._odd = 0
        self._odd_since = 0.0
        self._rate_known = False
        self._began = -math.inf  # local time [s] of the first stamp since the last jump
        self._fitted_at, self._changed = -math.inf, False

    @property
    def estimate(self) -> ClockEstimate | None:
        """The present estimate; None before the first stamp."""
        if self._known is not None and self._floors:
            waited = self._floors[-1][0] - self._fitted_at
            if self._changed and (waited >= _BUCKET or not self._known.measured):
                self._fit()
        return self._known

    def hear(self, arrival: float, stamp: float) -> bool:
        """Take in a stamp [s, vehicle's clock] that arrived at a local time [s].

        Return whether it shows that the clock has jumped or begun anew.
        """
        if not (math.isfinite(arrival) and math.isfinite(stamp)):
            return False
        if self._known is None:
            self._restart(arrival, stamp, ClockEstimate(0.0))
            return False
        if self._is_odd(arrival, stamp):
            return self._count_odd(arrival, stamp)
        self._odd = 0
        self._keep_floor(arrival, stamp)
        return False

    def hear_answer(self, sent: float, stamp: float, arrival: float) -> bool:
        """Take in a round trip: a request sent, the vehicle's stamp on it, the answer's arrival.

        Return as `hear`.
        """
        jumped = self.hear(arrival, stamp)
        if self._known is None or not sent <= arrival or self._is_odd(arrival, stamp):
            return jumped
        if self._known.measured and self._known.vehicle(sent) - stamp > _BEHIND:
            self._restart(arrival, stamp, self._known)
            return True
        if self._trusts_rate(arrival):
            for floor in [f for f in self._floors if self._refutes((sent, stamp), f)]:
                self._floors.remove(floor)
        self._ceilings.append((sent, stamp))
        self._fit()
        return jumped

    def _trusts_rate(self, now: float) -> bool:
        """Return whether stamps may be refuted by the rate: where it is measured, or was lately.

        A wrong rate refutes stamps that are right, which are then forgotten: it would never be
        measured anew.
        """
        assert self._known is not None
        kept = self._rate_known and now - self._began < _KEPT
        return self._known.measured or kept

    def _refutes(self, ceiling: Point, floor: Point) -> bool:
        """Return whether an answer proves that a stamp was ahead of the clock."""
        assert self._known is not None
        away = floor[0] - ceiling[0]
        most = ceiling[1] + self._known.rate * away + _RATE_CHANGE * abs(away)
        return abs(away) < _REFUTES and floor[1] > most + STAMP_AHEAD

    def _is_odd(self, arrival: float, stamp: float) -> bool:
        """Return whether neither latency nor a slowly changing rate explains a stamp."""
        assert self._known is not None
        if not self._floors:
            return False
        known = self._trusts_rate(arrival) and bool(self._ceilings)
        if known and self._refutes(self._ceilings[-1], (arrival, stamp)):
            return True
        if self._known.measured:
            allowed = STAMP_AHEAD + self._known.doubt
        else:
            elapsed = arrival - self._floors[0][0]
            allowed = _FIRST_AHEAD[0] + _FIRST_AHEAD[1] * elapsed if elapsed > 0.0 else math.inf
        ahead = stamp - self._known.vehicle(arrival)
        return ahead > allowed or stamp < self._floors[-1][1] - _BACK

    def _count_odd(self, arrival: float, stamp: float) -> bool:
        """Count odd stamps on end; start anew, and return True, where they persist."""
        assert self._known is not None
        self._odd_since = arrival if self._odd == 0 else self._odd_since
        self._odd += 1
        count, lasting = _PERSISTS
        if self._odd < count or arrival - self._odd_since < lasting:
            return False
        self._restart(arrival, stamp, self._known)
        return True

    def _restart(self, arrival: float, stamp: float, before: ClockEstimate) -> None:
        """Begin with one stamp; a clock that jumped is taken to keep its rate.

        Where it jumps again before that rate has been measured anew, the rate was wrong.
        """
        jumps = before.jumps + (self._known is not None)
        self._rate_known &= before.measured
        self._odd = 0
        self._began = arrival
        self._ceilings.clear()
        self._floors.clear()
        self._floors.append((arrival, stamp))
        self._known = ClockEstimate(stamp - before.rate * arrival, before.rate, jumps=jumps)

    def _keep_floor(self, arrival: float, stamp: float) -> None:
        """Keep the least delayed stamp of each bucket; forget old bounds."""
        assert self._known is not None
        rate, last = self._known.rate, self._floors[-1] if self._floors else None
        if last is not None and last[0] // _BUCKET == arrival // _BUCKET:
            if stamp - rate * arrival <= last[1] - rate * last[0]:
                return
            self._floors.pop()
        self._floors.append((arrival, stamp))
        for bounds in (self._floors, self._ceilings):
            while bounds and arrival - bounds[0][0] > _WINDOWS[0]:
                bounds.popleft()
        self._changed = True

    def _fit(self) -> None:
        """Estimate from the longest window in which one rate explains all stamps."""
        if not self._floors or self._known is None:
            return
        now = self._fitted_at = self._floors[-1][0]
        self._changed = False
        for window in _WINDOWS:
            floors = _since(self._floors, now - window)
            ceilings = _since(self._ceilings, now - window)
            line = above = _line_above(floors)
            if bounded := len(ceilings) >= _FEWEST:
                line = _line_between(floors, ceilings, above) or above
            if line is None or line.fits:
                break
        self._rate_known |= line is not None
        if line is None:
            offset = max(s - self._known.rate * a for a, s in floors)
            self._known = replace(self._known, offset=offset, rate_doubt=math.inf)
        else:
            offset = line.at_newest - line.rate * now
            jumps = self._known.jumps
            self._known = ClockEstimate(
                offset, line.rate, line.doubt, line.rate_doubt, bounded, jumps
            )


@dataclass(frozen=True)
class _Line:
    """A line through stamps: its height at the newest one [s], its rate, the doubts of both.

    fits: whether the stamps of the window follow one rate.
    """

    at_newest: float
    rate: float
    doubt: float
    rate_doubt: float
    fits: bool


def _since(points: Iterable[Point], start: float) -> list[Point]:
    return [p for p in points if p[0] >= start]


def _line_between(
    floors: Sequence[Point], ceilings: Sequence[Point], above: _Line | None
) -> _Line | None:
    """Return the line midway between floors and ceilings; None where they span too little.

    It has the rate of the line above the floors where the ceilings allow that, for there are many
    more floors; else the rate that leaves most room between them.
    """
    if max(floors[0][0], ceilings[0][0]) > floors[-1][0] - _SHORTEST:
        return None
    newest = np.array(floors[-1])
    low, high = np.array(floors) - newest, np.array(ceilings) - newest
    span = -min(float(low[0, 0]), float(high[0, 0]))
    rate = _roomiest(low, high) if above is None else above.rate
    bottom, top = _at_newest(rate, low, high)
    if above is not None and top < bottom:
        rate = _roomiest(low, high)
        bottom, top = _at_newest(rate, low, high)
    room, middle = top - bottom, (top + bottom) / 2.0
    rates = rate + _GRID * 4.0 * (max(room, 0.0) + _RESOLUTION) / span
    floor, ceiling = _around(rates, low, high)
    possible = ceiling - floor >= min(room, 0.0)
    rate_doubt = float(np.abs(rates[possible] - rate).max()) + _RESOLUTION / span
    doubt = max(float(ceiling[possible].max()) - middle, middle - float(floor[possible].min()))
    doubt += _RESOLUTION + 2.0 * max(-room, 0.0)
    return _Line(float(newest[1]) + middle, rate, doubt, rate_doubt, room >= -_MISFIT)


def _roomiest(floors: Vector, ceilings: Vector) -> float:
    """Return the rate that leaves most room between floors and ceilings (n,2)."""
    rate, reach = 1.0, _RATES[1] - 1.0
    while reach > _FINEST:
        rates = rate + reach * _GRID
        floor, ceiling = _around(rates, floors, ceilings)
        rate = float(rates[(ceiling - floor).argmax()])
        reach *= 2.0 * float(_GRID[-1] - _GRID[-2])
    return rate


def _at_newest(rate: float, floors: Vector, ceilings: Vector) -> tuple[float, float]:
    floor, ceiling = _around(np.array([rate]), floors, ceilings)
    return float(floor[0]), float(ceiling[0])


def _around(rates: Vector, floors: Vector, ceilings: Vector) -> tuple[Vector, Vector]:
    """Return how high lines of these rates (k,) must and may be at time 0; points: (n,2)."""
    floor = (floors[:, 1] - np.outer(rates, floors[:, 0])).max(axis=1)
    ceiling = (ceilings[:, 1] - np.outer(rates, ceilings[:, 0])).min(axis=1)
    return floor, ceiling


def _line_above(floors: Sequence[Point]) -> _Line | None:
    """Return the line above all floors that is nearest to them; None where they span too little."""
    newest = floors[-1]
    points = [(a - newest[0], s - newest[1]) for a, s in floors]
    span = -points[0][0]
    if span < _SHORTEST:
        return None
    left, right = _edge(points, (_OVER - 1.0) * span)
    rate = (right[1] - left[1]) / (right[0] - left[0])
    if not _RATES[0] < rate < _RATES[1]:
        return None
    heights = [s - rate * a for a, s in points]
    top = max(heights)
    spread = statistics.median(top - h for h in heights)
    rate_doubt = _RESOLUTION / (right[0] - left[0]) + spread / span
    late = top - max(h for h, (a, _) in zip(heights, points, strict=True) if a >= -1.0)
    doubt = _LEAST_LATENCY + rate_doubt * span / 2.0
    return _Line(newest[1] + top, rate, doubt, rate_doubt, late <= _LATE)


def _edge(points: Sequence[Point], at: float) -> tuple[Point, Point]:
    """Return the edge over `at` of the upper convex hull of points, which are sorted by time."""
    hull: list[Point] = []
    for p in points:
        while len(hull) > 1 and _turns_left(hull[-2], hull[-1], p):
            hull.pop()
        hull.append(p)
    return next(edge for edge in itertools.pairwise(hull) if edge[1][0] >= at)


def _turns_left(o: Point, a: Point, b: Point) -> bool:
    """Return whether the way o → a → b turns left, or not at all."""
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]) >= 0.0
