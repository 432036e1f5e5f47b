"""The pose of a vehicle at any instant of the recent past, from what its autopilot reports.

Attitude and position come as separate messages, each with its own stamp of the vehicle's clock, and
at other instants than a camera takes its pictures. Between two samples the pose is interpolated;
beyond the newest one nothing is assumed.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Iterable
from typing import TypeVar

import numpy as np

from mavlink_bridge.shared.frames import conjugate, multiply, rotate, rotation_vector
from mavlink_bridge.wire.messages import (
    Attitude,
    EulerAttitude,
    LocalPosition,
    Message,
    Odometry,
    VehicleState,
)

_KEPT = 200  # samples of each kind
_LONGEST_GAP = 0.25  # s between two samples that are interpolated
_BACK = 1.0  # s by which a stamp goes back where the vehicle has started anew
_Sample = TypeVar("_Sample", Attitude, LocalPosition)


class ReportedPoses:
    """Follows one vehicle's telemetry, in its own ENU frame and its own clock.

    ATTITUDE_QUATERNION is preferred to ATTITUDE, LOCAL_POSITION_NED to ODOMETRY, from the first one
    on. restarts: how often the vehicle's clock has gone back: it was rebooted.
    """

    def __init__(self) -> None:
        self.restarts = 0
        self._attitudes: deque[Attitude] = deque(maxlen=_KEPT)
        self._positions: deque[LocalPosition] = deque(maxlen=_KEPT)

    def hear(self, messages: Iterable[Message]) -> None:
        """Take in the messages that tell of the pose; ignore the others."""
        for m in messages:
            if isinstance(m, Odometry):
                self._add(self._attitudes, EulerAttitude(m.time, m.q_wb, m.omega))
                self._add(self._positions, _FromOdometry(m.time, m.p, m.v))
            elif isinstance(m, Attitude):
                self._add(self._attitudes, m)
            elif isinstance(m, LocalPosition):
                self._add(self._positions, m)

    def _add(self, samples: deque[_Sample], sample: _Sample) -> None:
        """Append a sample, where it is finite, newer than the last, and none of a coarser kind."""
        values = (
            (sample.q_wb, sample.omega) if isinstance(sample, Attitude) else (sample.p, sample.v)
        )
        if not all(np.isfinite(v).all() for v in values):
            return
        if isinstance(sample, Attitude) and abs(float(np.linalg.norm(sample.q_wb)) - 1.0) > 0.02:
            return
        if samples:
            last = samples[-1]
            if isinstance(sample, _COARSE) and not isinstance(last, _COARSE):
                return
            if sample.time < last.time - _BACK:
                self.restarts += 1
                self._attitudes.clear()
                self._positions.clear()
            elif sample.time <= last.time:
                return
            elif isinstance(last, _COARSE) and not isinstance(sample, _COARSE):
                samples.clear()
        samples.append(sample)

    @property
    def lacking(self) -> list[str]:
        """What has not come yet: attitude, position."""
        told = {"attitude": self._attitudes, "position": self._positions}
        return [name for name, samples in told.items() if not samples]

    @property
    def newest(self) -> float:
        """The newest stamp of all [s]; minus infinity before the first."""
        return max((s[-1].time for s in (self._attitudes, self._positions) if s), default=-math.inf)

    @property
    def known_until(self) -> float:
        """The time [s] up to which the pose is known; minus infinity before both have come."""
        if self.lacking:
            return -math.inf
        return min(self._attitudes[-1].time, self._positions[-1].time)

    @property
    def flowing(self) -> bool:
        """Whether both come so often that the pose between two samples is known."""
        both = (self._attitudes, self._positions)
        return all(len(s) > 1 and s[-1].time - s[-2].time <= _LONGEST_GAP for s in both)

    def at(self, time: float) -> VehicleState | None:
        """Return the pose at `time` [s]; None where no two near samples lie around it."""
        attitudes, positions = _around(self._attitudes, time), _around(self._positions, time)
        if attitudes is None or positions is None:
            return None
        (a, b, share), (c, d, way) = attitudes, positions
        turn = rotation_vector(multiply(conjugate(a.q_wb), b.q_wb))
        return VehicleState(
            time=time,
            p=c.p + way * (d.p - c.p),
            v=c.v + way * (d.v - c.v),
            q_wb=rotate(a.q_wb, share * turn),
            omega=a.omega + share * (b.omega - a.omega),
        )


class _FromOdometry(LocalPosition):
    """A position of ODOMETRY."""


_COARSE = (EulerAttitude, _FromOdometry)


def _around(samples: deque[_Sample], time: float) -> tuple[_Sample, _Sample, float] | None:
    """Return the samples before and after `time`, and the share 0…1 of the way between them."""
    k = bisect_right(samples, time, key=lambda s: s.time)
    if k and samples[k - 1].time == time:
        return samples[k - 1], samples[k - 1], 0.0
    if not 0 < k < len(samples):
        return None
    before, after = samples[k - 1], samples[k]
    gap = after.time - before.time
    return None if gap > _LONGEST_GAP else (before, after, (time - before.time) / gap)
