"""Doubt of the own state, as the autopilot's estimator reports it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from companion.estimation.landmark_places import Drift
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.wire.messages import EstimatorStatus, Message, Odometry

_ATTITUDE_KNOWN, _PLACE_KNOWN = 0x1, 0x8 | 0x10  # ESTIMATOR_STATUS_FLAGS: relative or absolute
_POSITION_MAX = 5.0  # m; with more doubt no goal can be flown to
_REJECTED = 1.0  # test ratio above which the estimator rejects what it measures
_VELOCITY_TIME, ATTITUDE_TIME = 0.7, 10.0  # s for which errors of velocity and attitude last


@dataclass(frozen=True)
class OwnDoubt:
    """1 σ of the own state along one axis; without a report what motion capture reaches.

    position, height: m. velocity: m/s. tilt, yaw: rad. rejects: the estimator rejects what one of
    its sensors measures. inhibit_reason: why no flight can begin; empty: it can.
    """

    position: float = 0.05
    height: float = 0.05
    velocity: float = 0.05
    tilt: float = 0.006
    yaw: float = 0.006
    rejects: bool = False
    inhibit_reason: str = ""

    @property
    def wander(self) -> float:
        """Return how far the way flown may be wrong, as a random walk, [m/√s]."""
        return self.velocity * math.sqrt(2.0 * _VELOCITY_TIME)

    def drift(self, dt: float) -> Drift:
        """Return how far the pose may have drifted within `dt` [s]."""
        root = math.sqrt(max(dt, 0.0))
        return Drift(
            self.wander * root,
            self.yaw * math.sqrt(2.0 / ATTITUDE_TIME) * root,
            self.tilt,
            math.exp(-max(dt, 0.0) / ATTITUDE_TIME),
        )


class OwnDoubtEstimator:
    """Follows ODOMETRY and ESTIMATOR_STATUS."""

    def __init__(self) -> None:
        self.doubt = OwnDoubt()

    def hear(self, messages: Iterable[Message]) -> OwnDoubt:
        """Take in the messages since the last tick; return the doubt now."""
        told: dict[str, Any] = {}
        for m in messages:
            if isinstance(m, Odometry):
                told |= _of_odometry(m)
            elif isinstance(m, EstimatorStatus):
                told |= _of_status(m)
        if told:
            self.doubt = replace(self.doubt, **told)
        return self.doubt


def _of_odometry(o: Odometry) -> dict[str, float]:
    """Return what an odometry tells of `OwnDoubt`."""
    told: dict[str, float] = {}
    place, velocity = _finite(o.position_sigma), _finite(o.velocity_sigma)
    attitude = _finite(o.attitude_sigma)
    if place is not None:
        told["position"], told["height"] = max(place[0], place[1]), place[2]
    if velocity is not None:
        told["velocity"] = max(velocity)
    if attitude is not None:
        told["tilt"], told["yaw"] = max(attitude[0], attitude[1]), attitude[2]
    return told


def _of_status(s: EstimatorStatus) -> dict[str, bool | str]:
    """Return what the estimator's status tells of `OwnDoubt`."""
    reason = ""
    if not s.flags & _ATTITUDE_KNOWN:
        reason = "autopilot: its estimator has no attitude"
    elif not s.flags & _PLACE_KNOWN:
        reason = "autopilot: its estimator has no horizontal position"
    elif s.horizontal_accuracy > _POSITION_MAX:
        reason = (
            f"autopilot: its position is sure to {s.horizontal_accuracy:.1f} m, "
            f"{_POSITION_MAX:g} m are needed"
        )
    ratios = (s.velocity_ratio, s.horizontal_ratio, s.vertical_ratio, s.magnetometer_ratio)
    return {"rejects": any(r > _REJECTED for r in ratios), "inhibit_reason": reason}


def _finite(sigma: Vector | None) -> list[float] | None:
    """Return three standard deviations; None where they are not told or are no such numbers."""
    if sigma is None:
        return None
    sigmas: list[float] = sigma.tolist()
    return sigmas if all(0.0 <= s < math.inf for s in sigmas) else None
