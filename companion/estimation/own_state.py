"""Own state from telemetry: what the autopilot last said, carried to any instant near it.

Attitude and position come as separate streams with their own time stamps; a camera frame
needs the attitude at its capture, a tick needs the state now. Refuses what cannot be true.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from companion.estimation.coarse_telemetry import CoarseTelemetry
from mavlink_bridge.shared.arrays import Vector
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
_Sample = TypeVar("_Sample", Attitude, LocalPosition)
_SILENT = 0.5  # s without ATTITUDE_QUATERNION or LOCAL_POSITION_NED: then others have to do
_JUMP = 1.0  # m beyond what velocity and acceleration explain: another place, not a motion
_ACCELERATION = 10.0  # m/s², most that a drone may have had since the sample before
_RATE_MAX = 35.0  # rad/s about an axis: what the gyros of such vehicles can tell, 2000 °/s
_PERSISTS = (5, 0.15)  # samples on end, or s: then it is no slip, whatever it is
_DOUBT = 1.0  # s that what cannot be believed, and persists, casts doubt
_POSITION_LOST = 0.18  # s without a position while attitudes come
_POSITION_GARBLED = 0.4  # s; the same, while positions come that are no numbers
_REBOOTED = (1.0, 3)  # s that the clock has to go back, in so many samples on end
_HISTORY = 100  # two seconds of 50 Hz telemetry: more than the oldest frame that is of use


@dataclass(frozen=True)
class OdometryAttitude(Attitude):
    """What ODOMETRY says of the attitude."""


@dataclass(frozen=True)
class OdometryPosition(LocalPosition):
    """What ODOMETRY says of position and velocity."""


@dataclass
class OwnStateCounters:
    """Telemetry refused since start, by reason."""

    not_finite: int = 0
    not_unit: int = 0
    too_fast: int = 0
    out_of_order: int = 0
    jumps: int = 0
    reboots: int = 0


class _Slip:
    """Something that cannot be: once it is a slip, again and again it is a fault."""

    def __init__(self) -> None:
        self._count, self._since = 0, 0.0

    def persists(self, time: float) -> bool:
        """It is seen at `time` [s] (again); whether that is too often."""
        self._since = time if self._count == 0 else self._since
        self._count += 1
        count, lasting = _PERSISTS
        return self._count >= count or time - self._since >= lasting

    def over(self) -> None:
        """All is well."""
        self._count = 0


class OwnState:
    """The drone's own state in its own ENU frame, from Attitude and LocalPosition messages.

    Of what a vehicle does not send, Odometry takes the place. Where it sends none of the three,
    its coarse messages do: see `coarse.py`.
    """

    def __init__(self) -> None:
        self.counters = OwnStateCounters()
        # Until the vehicle shows that it sends LOCAL_POSITION_NED or ATTITUDE_QUATERNION.
        self._coarse: CoarseTelemetry | None = CoarseTelemetry()
        self._attitudes: deque[Attitude] = deque(maxlen=_HISTORY)
        self._positions: deque[LocalPosition] = deque(maxlen=_HISTORY)
        self._doubted = self._garbled = -np.inf
        self._from_the_past = 0
        self._wild, self._elsewhere = _Slip(), _Slip()

    def _reset(self) -> None:
        """Forget everything: the autopilot has rebooted."""
        self._attitudes.clear()
        self._positions.clear()
        self._coarse = CoarseTelemetry()
        self._doubted = self._garbled = -np.inf
        self._from_the_past = 0
        self.counters.reboots += 1

    def add(self, messages: Iterable[Message]) -> None:
        """Take what is telemetry of this kind; the rest is not for here."""
        for message in self._refined(messages):
            if isinstance(message, Attitude):
                if not self._repeats(message) and self._sane_attitude(message):
                    self._attitudes.append(message)
            elif isinstance(message, LocalPosition) and self._sane_position(message):
                self._positions.append(message)

    def _refined(self, messages: Iterable[Message]) -> Iterable[Message]:
        """The messages; where they are all coarse ones, what can be made of them."""
        for message in messages:
            if isinstance(message, Odometry):
                self._coarse = None
                yield from self._lacking(message)
                continue
            if isinstance(message, LocalPosition) or type(message) is Attitude:
                self._coarse = None  # this vehicle can do better
            if self._coarse is None:
                yield message
            else:
                yield from self._coarse.add(message)

    def _lacking(self, o: Odometry) -> Iterator[Attitude | LocalPosition]:
        """What of an odometry its vehicle does not say otherwise."""
        if self._odometry_counts(self._attitudes, o):
            yield OdometryAttitude(o.time, o.q_wb, o.omega)
        if self._odometry_counts(self._positions, o):
            yield OdometryPosition(o.time, o.p, o.v)

    @staticmethod
    def _odometry_counts(samples: Sequence[Attitude | LocalPosition], o: Odometry) -> bool:
        last = samples[-1] if samples else None
        mine = isinstance(last, OdometryAttitude | OdometryPosition)
        return last is None or mine or o.time - last.time > _SILENT

    def age(self, time: float) -> float:
        """Seconds since the older of the two streams last spoke; infinite before both did.

        Where the position is lost, of the attitude alone.
        """
        if not self._attitudes or not self._positions:
            return float("inf")
        attitude, position = self._attitudes[-1].time, self._positions[-1].time
        return time - (attitude if self._position_lost else min(attitude, position))

    def plausible(self, time: float) -> bool:
        """Return whether recent attitudes and positions can be those of a flying drone."""
        return time - self._doubted > _DOUBT and not self._position_lost

    @property
    def _position_lost(self) -> bool:
        if not self._attitudes or not self._positions:
            return False
        now = self._attitudes[-1].time
        longest = _POSITION_GARBLED if now - self._garbled < _POSITION_LOST else _POSITION_LOST
        return now - self._positions[-1].time > longest

    def at(self, time: float) -> VehicleState | None:
        """State at `time` [s, vehicle's clock]; None before both streams have spoken.

        Between samples the nearest one is carried over by its own rates; no model.
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
        """PX4 sends the angles besides the quaternion; they add nothing to it."""
        return (
            isinstance(a, EulerAttitude)
            and bool(self._attitudes)
            and not isinstance(self._attitudes[-1], EulerAttitude)
            and a.time - self._attitudes[-1].time < _SILENT
        )

    def _sane_attitude(self, a: Attitude) -> bool:
        if not (_numbers(a.q_wb) and _numbers(a.omega)):
            self.counters.not_finite += 1
        elif self._impossible(a):
            if self._wild.persists(a.time):
                self._doubted = max(self._doubted, a.time)
        else:
            if not isinstance(a, EulerAttitude):  # angles are always those of some rotation
                self._wild.over()
            return self._in_order(a.time, self._attitudes)
        return False

    def _impossible(self, a: Attitude) -> bool:
        """No rotation, or faster than any gyro can tell; counted."""
        not_unit = abs(float(np.linalg.norm(a.q_wb)) - 1.0) > 0.02
        too_fast = float(np.abs(a.omega).max()) > _RATE_MAX
        self.counters.not_unit += not_unit
        self.counters.too_fast += too_fast
        return not_unit or too_fast

    def _sane_position(self, lp: LocalPosition) -> bool:
        if not (_numbers(lp.p) and _numbers(lp.v)):
            self.counters.not_finite += 1
            self._garbled = lp.time
            return False
        if not self._in_order(lp.time, self._positions):
            return False
        if not self._positions or not self._jumps(lp):
            self._elsewhere.over()
            return True
        self.counters.jumps += 1
        if not self._elsewhere.persists(lp.time):
            return False
        self._doubted = max(self._doubted, lp.time)
        self._elsewhere.over()
        return True

    def _jumps(self, lp: LocalPosition) -> bool:
        before = self._positions[-1]
        dt = lp.time - before.time
        away = lp.p - before.p - 0.5 * dt * (lp.v + before.v)
        return float(np.linalg.norm(away)) > _JUMP + 0.5 * _ACCELERATION * dt * dt

    def _in_order(self, time: float, samples: deque[_Sample]) -> bool:
        """Whether a sample of `time` is no older than the last; a clock that went back is new."""
        if not samples or time >= samples[-1].time:
            self._from_the_past = 0
            return True
        back, count = _REBOOTED
        self._from_the_past += samples[-1].time - time > back
        if self._from_the_past >= count:
            self._reset()
            return True
        self.counters.out_of_order += 1
        return False


def _numbers(values: Vector) -> bool:
    """Whether all are finite, and none so small that only garbage is: no float32 of full precision.

    A velocity of 1e-45 m/s from one sample to the next would be believed as a halt.
    """
    return all(x == 0.0 or _TINY <= abs(x) < math.inf for x in values.tolist())


def _nearest(samples: deque[_Sample], time: float) -> _Sample:
    """The sample next to `time`, searching from the newest."""
    best = samples[-1]
    for sample in reversed(samples):
        if abs(sample.time - time) > abs(best.time - time):
            break
        best = sample
    return best
