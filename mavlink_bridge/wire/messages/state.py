"""Attitude, position and velocity of a vehicle."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mavlink_bridge.shared.arrays import Vector


@dataclass(frozen=True)
class VehicleState:
    """State of a vehicle at one instant of its clock: the NMPC's X without the input.

    p (3,) m ENU, v (3,) m/s ENU, q_wb (4,) w,x,y,z body→world, omega (3,) rad/s FLU.
    """

    time: float
    p: Vector
    v: Vector
    q_wb: Vector
    omega: Vector


@dataclass(frozen=True)
class Attitude:
    """ATTITUDE_QUATERNION: q_wb (4,) w,x,y,z body→world; omega (3,) rad/s FLU."""

    time: float
    q_wb: Vector
    omega: Vector


@dataclass(frozen=True)
class EulerAttitude(Attitude):
    """ATTITUDE: as `Attitude`, but three angles on the wire."""


@dataclass(frozen=True)
class AttitudeTarget:
    """ATTITUDE_TARGET, what the autopilot's loops follow now: thrust normalised, 0…1.

    q_wb (4,) w,x,y,z body→world; omega (3,) rad/s FLU.
    """

    time: float
    q_wb: Vector
    omega: Vector
    thrust: float
    type_mask: int = 0


@dataclass(frozen=True)
class LocalPosition:
    """LOCAL_POSITION_NED: p (3,) m and v (3,) m/s in the vehicle's own ENU frame."""

    time: float
    p: Vector
    v: Vector


@dataclass(frozen=True)
class Odometry:
    """ODOMETRY: p (3,) m, v (3,) m/s in the vehicle's own ENU frame; q_wb (4,); omega (3,) FLU.

    p is NaN where its frame on the wire is not aligned with north and up. The standard deviations
    of p [m, ENU], v [m/s, ENU] and attitude [rad, about forward, left, up], (3,) each, are None
    where the estimator does not tell them. resets: 0…255, grows by one at each jump of the
    estimate. estimator: MAV_ESTIMATOR_TYPE. quality: %, 0 unknown, -1 failed.
    """

    time: float
    p: Vector
    v: Vector
    q_wb: Vector
    omega: Vector
    position_sigma: Vector | None = None
    velocity_sigma: Vector | None = None
    attitude_sigma: Vector | None = None
    resets: int = 0
    estimator: int = 0
    quality: int = 0


@dataclass(frozen=True)
class GlobalPosition:
    """GLOBAL_POSITION_INT: degrees, metres; v (3,) m/s ENU; heading rad, clockwise from north."""

    time: float
    latitude_deg: float
    longitude_deg: float
    altitude: float
    relative_altitude: float
    v: Vector
    heading: float | None = None


@dataclass(frozen=True)
class HomePosition:
    """HOME_POSITION, the place of the take-off; p (3,) m in the vehicle's own ENU frame."""

    latitude_deg: float
    longitude_deg: float
    altitude: float
    p: Vector = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class EstimatorStatus:
    """ESTIMATOR_STATUS: flags are bits, position accuracies in metres.

    The ratios are test ratios of the innovations: above 1 the filter rejects what it measured.
    """

    time: float
    flags: int
    horizontal_accuracy: float
    vertical_accuracy: float
    velocity_ratio: float = 0.1
    horizontal_ratio: float = 0.1
    vertical_ratio: float = 0.1
    magnetometer_ratio: float = 0.1
    height_over_ground_ratio: float = 0.1
