"""Own state from telemetry: the last attitude and position, carried to any instant near them.

Attitude and position come as separate streams with their own time stamps. A camera frame needs the
attitude at its capture, a tick needs the state now. Samples that cannot be true are refused.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import TypeVar

import numpy as np

from companion.estimation.coarse_telemetry import CoarseTelemetry
from companion.types import STAMP_AHEAD
from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.shared.frames import integrate
from mavlink_bridge.wire.messages import (
    Attitude,
    EulerAttitude,
    LocalPosition,
    Message,
    Odometry,
    VehicleState,
)

_TINY = float(np.finfo(np.float32).tiny)
_SAMPLES = (Attitude, LocalPosition, Odometry)
_Sample = TypeVar("_Sample", Attitude, LocalPosition)
_time = attrgetter("time")
_TIMEOUT = 0.5  # s without a stream, after which a substitute is accepted
_JUMP = 1.0  # m beyond what velocity and acceleration explain: a jump, not a motion
_ACCELERATION = 10.0  # m/s², the most between two samples
_RATE_MAX = 35.0  # rad/s about an axis: the range of the gyros of such vehicles, 2000 °/s
_PERSISTS = (5, 0.15)  # samples in a row, or s, from which an outlier is a fault
_IMPLAUSIBLE = 1.0  # s for which a fault makes the state implausible
_POSITION_LOST = 0.18  # s without a position while attitudes come
_POSITION_CORRUPT = 0.4  # s; the same, while positions come that are not finite
_REBOOTED = (1.0, 3)  # s by which the clock has to go back, in so many samples in a row
_TICKS_AHEAD = 3  # on end with samples of the future, from which on no stamp is believed
_HISTORY = 100  # two seconds of 50 Hz telemetry: more than the age of any frame in use


@dataclass(frozen=True)
class OdometryAttitude(Attitude):
    """The attitude from an ODOMETRY message."""


@dataclass(frozen=True)
class OdometryPosition(LocalPosition):
    """Position and velocity from an ODOMETRY message."""


@dataclass
class OwnStateCounters:
    """Telemetry refused since start, by reason."""

    not_finite: int = 0
    not_unit: int = 0
    too_fast: int = 0
    out_of_order: int = 0
    ahead: int = 0  # stamped in the future
    jumps: int = 0
    reboots: int = 0


class _OutlierRun:
    """Counts outliers in a row: a few are refused, more of them are a fault."""

    def __init__(self) -> None:
        self._count, self._since = 0, 0.0

    def count(self, time: float) -> bool:
        """Count an outlier at `time` [s]; return whether the run is long enough for a fault."""
        self._since = time if self._count == 0 else self._since
        self._count += 1
        count, lasting = _PERSISTS
        return self._count >= count or time - self._since >= lasting

    def end(self) -> None:
        """End the run: a good sample came."""
        self._count = 0


class OwnState:
    """The drone's own state in its own ENU frame, from Attitude and LocalPosition messages.

    Odometry replaces the stream that the vehicle does not send. Where the vehicle sends none of the
    three, its coarse messages are used: see `coarse_telemetry.py`.
    """

    def __init__(self) -> None:
        self.counters = OwnStateCounters()
        self.new_attitudes: list[Attitude] = []  # of the last call of `add`
        # Until the vehicle shows that it sends LOCAL_POSITION_NED or ATTITUDE_QUATERNION.
        self._coarse: CoarseTelemetry | None = CoarseTelemetry()
        self._attitudes: deque[Attitude] = deque(maxlen=_HISTORY)
        self._positions: deque[LocalPosition] = deque(maxlen=_HISTORY)
        self._implausible_at = self._corrupt_at = -np.inf
        self._horizon = np.inf
        self._ticks_ahead = 0  # on end, with samples of the future
        self._clock_back_count = 0
        self._bad_attitudes, self._jumped = _OutlierRun(), _OutlierRun()

    def _reset(self) -> None:
        """Forget everything: the autopilot has rebooted."""
        self._attitudes.clear()
        self._positions.clear()
        self._coarse = CoarseTelemetry()
        self._implausible_at = self._corrupt_at = -np.inf
        self._clock_back_count = 0
        self.counters.reboots += 1

    def add(self, messages: Iterable[Message], horizon: float = math.inf) -> None:
        """Take in the messages that tell of the own state; ignore the others.

        horizon: s, the latest that the vehicle's clock can show now. A sample with a later stamp
        is refused: it would be carried back in time, and would never grow old. Where such samples
        come tick after tick, all stamps are wrong, and all samples are refused.
        """
        self.new_attitudes = []
        self._horizon = horizon + STAMP_AHEAD
        for message in self._refined(self._credible(messages)):
            if isinstance(message, Attitude):
                if not self._repeats(message) and self._sane_attitude(message):
                    self._attitudes.append(message)
                    self.new_attitudes.append(message)
            elif isinstance(message, LocalPosition) and self._sane_position(message):
                self._positions.append(message)

    @property
    def rates_by_gyro(self) -> bool:
        """Return whether body rates are measured; those of coarse telemetry follow from angles."""
        return self._coarse is None

    def _credible(self, messages: Iterable[Message]) -> list[Message]:
        """Return the messages without samples of the future, which are counted."""
        known = list(messages)
        times = [m.time for m in known if isinstance(m, _SAMPLES)]
        if times:
            self._ticks_ahead = self._ticks_ahead + 1 if max(times) > self._horizon else 0
        latest = self._horizon if self._ticks_ahead < _TICKS_AHEAD else -np.inf
        self.counters.ahead += sum(time > latest for time in times)
        return [m for m in known if not isinstance(m, _SAMPLES) or m.time <= latest]

    def _refined(self, messages: Iterable[Message]) -> Iterable[Message]:
        """Yield the messages; where the vehicle sends only coarse ones, their fine equivalents."""
        for message in messages:
            if isinstance(message, Odometry):
                self._coarse = None
                yield from self._substitutes(message)
                continue
            if isinstance(message, LocalPosition) or type(message) is Attitude:
                self._coarse = None  # this vehicle sends fine messages
            if self._coarse is None:
                yield message
            else:
                yield from self._coarse.add(message)

    def _substitutes(self, o: Odometry) -> Iterator[Attitude | LocalPosition]:
        """Yield the attitude and position of an odometry whose own streams are silent."""
        if self._silent(self._attitudes, o):
            yield OdometryAttitude(o.time, o.q_wb, o.omega)
        if self._silent(self._positions, o):
            yield OdometryPosition(o.time, o.p, o.v)

    @staticmethod
    def _silent(samples: Sequence[Attitude | LocalPosition], o: Odometry) -> bool:
        """Return whether a stream has no recent sample but those from odometry."""
        last = samples[-1] if samples else None
        from_odometry = isinstance(last, OdometryAttitude | OdometryPosition)
        return last is None or from_odometry or o.time - last.time > _TIMEOUT

    def age(self, time: float) -> float:
        """Return the age [s] of the older of the two streams; infinite before both have come.

        While the position is lost, return the age of the attitude. Where samples are newer than
        `time`, but not newer than can be, the age is 0; negative where the clock has gone back.
        """
        if not self._attitudes or not self._positions:
            return float("inf")
        attitude, position = self._attitudes[-1].time, self._positions[-1].time
        age = time - (attitude if self._position_lost else min(attitude, position))
        ahead = max(attitude, position) - self._horizon
        return -ahead if ahead > 0.0 else max(age, 0.0)

    def plausible(self, time: float) -> bool:
        """Return whether recent attitudes and positions can be those of a flying drone."""
        return time - self._implausible_at > _IMPLAUSIBLE and not self._position_lost

    @property
    def _position_lost(self) -> bool:
        """Whether attitudes come and positions have ceased."""
        if not self._attitudes or not self._positions:
            return False
        now = self._attitudes[-1].time
        corrupt = now - self._corrupt_at < _POSITION_LOST
        longest = _POSITION_CORRUPT if corrupt else _POSITION_LOST
        return now - self._positions[-1].time > longest

    def at(self, time: float) -> VehicleState | None:
        """Return the state at `time` [s, vehicle's clock]; None before both streams have come.

        The nearest sample is carried there by its own rates, without a model.
        """
        if not self._attitudes or not self._positions:
            return None
        attitude = _nearest(self._attitudes, time)
        position = _nearest(self._positions, time)
        dp, dq = time - position.time, time - attitude.time
        return VehicleState(
            time=time,
            p=position.p + position.v * dp,
            v=position.v,
            q_wb=integrate(attitude.q_wb, attitude.omega, dq),
            omega=attitude.omega,
        )

    def _repeats(self, a: Attitude) -> bool:
        """Return whether these are angles that PX4 sends besides the quaternion."""
        return (
            isinstance(a, EulerAttitude)
            and bool(self._attitudes)
            and not isinstance(self._attitudes[-1], EulerAttitude)
            and a.time - self._attitudes[-1].time < _TIMEOUT
        )

    def _sane_attitude(self, a: Attitude) -> bool:
        """Return whether to keep an attitude; count it where it is refused."""
        if not (_finite(a.q_wb) and _finite(a.omega)):
            self.counters.not_finite += 1
        elif self._impossible(a):
            if self._bad_attitudes.count(a.time):
                self._implausible_at = max(self._implausible_at, a.time)
        else:
            if not isinstance(a, EulerAttitude):  # angles are always those of some rotation
                self._bad_attitudes.end()
            return self._in_order(a.time, self._attitudes)
        return False

    def _impossible(self, a: Attitude) -> bool:
        """Return whether this is no rotation, or faster than a gyro measures; count it."""
        not_unit = abs(norm(a.q_wb) - 1.0) > 0.02
        too_fast = max(map(abs, a.omega.tolist())) > _RATE_MAX
        self.counters.not_unit += not_unit
        self.counters.too_fast += too_fast
        return not_unit or too_fast

    def _sane_position(self, lp: LocalPosition) -> bool:
        """Return whether to keep a position; a jump that persists is kept, and is a fault."""
        if not (_finite(lp.p) and _finite(lp.v)):
            self.counters.not_finite += 1
            self._corrupt_at = lp.time
            return False
        if not self._in_order(lp.time, self._positions):
            return False
        if not self._positions or not self._jumps(lp):
            self._jumped.end()
            return True
        self.counters.jumps += 1
        if not self._jumped.count(lp.time):
            return False
        self._implausible_at = max(self._implausible_at, lp.time)
        self._jumped.end()
        return True

    def _jumps(self, lp: LocalPosition) -> bool:
        """Return whether no motion leads from the last position to this one."""
        before = self._positions[-1]
        dt = lp.time - before.time
        away = lp.p - before.p - 0.5 * dt * (lp.v + before.v)
        return norm(away) > _JUMP + 0.5 * _ACCELERATION * dt * dt

    def _in_order(self, time: float, samples: deque[_Sample]) -> bool:
        """Return whether a sample of `time` is not older than the last; a reboot starts anew."""
        if not samples or time >= samples[-1].time:
            self._clock_back_count = 0
            return True
        back, count = _REBOOTED
        self._clock_back_count += samples[-1].time - time > back
        if self._clock_back_count >= count:
            self._reset()
            return True
        self.counters.out_of_order += 1
        return False


def _finite(values: Vector) -> bool:
    """Return whether all values are finite, and normal as float32: a denormal is garbage.

    A velocity of 1e-45 m/s from one sample to the next would be believed as a halt.
    """
    return all(x == 0.0 or _TINY <= abs(x) < math.inf for x in values.tolist())


def _nearest(samples: deque[_Sample], time: float) -> _Sample:
    """Return the sample nearest to `time` [s]; of two that are as near, the older one."""
    n = bisect_left(samples, time, key=_time)
    if n == len(samples) or (n > 0 and time - samples[n - 1].time <= samples[n].time - time):
        n = bisect_left(samples, samples[n - 1].time, key=_time)
    return samples[n]
