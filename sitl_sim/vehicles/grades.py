"""Grades of state estimate: how wrong motion capture, RTK, GPS and VIO are, and what they report.

Every figure has its source; where a source gives a range, each vehicle draws its own value.

RTK     u-blox ZED-F9P data sheet (UBX-17051259): 0.01 m + 1 ppm CEP fixed, 0.05 m/s. Float: 0.2 to
        0.5 m (u-blox ZED-F9P integration manual, UBX-18010802).
GPS     u-blox NEO-M9N data sheet (UBX-19014285): 1.5 m CEP, 0.05 m/s; its error is correlated over
        tens of seconds: Rankin, "GPS and differential GPS: an error model for sensor simulation",
        IEEE PLANS 1994. Delay: PX4's EKF2_GPS_DELAY is 110 ms, ArduPilot's receivers 100 to 220 ms;
        what is left is the delay that nobody measured.
compass PX4 EKF2_HEAD_NOISE 0.3 rad for one sample; after calibration 2 to 5° of hard iron and
        declination remain (Groves, "Principles of GNSS, Inertial and Multisensor Integrated
        Navigation Systems", 2nd ed., 6.1.1).
VIO     Delmerico and Scaramuzza, "A benchmark comparison of monocular visual-inertial odometry
        algorithms for flying robots", ICRA 2018: 0.5 to 1.5 % of the distance, yaw 1 to 3° after
        100 m (OKVIS, ROVIO, VINS-Mono).
tilt    1 to 1.5° while manoeuvring: accelerometer bias and lever arm, with a GPS in the filter.
baro    TE MS5611-01BA03 data sheet: ±0.1 m short-term; Bosch BMP388: 0.75 Pa/K, 0.06 m/K.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from mavlink_bridge.wire.ids import GpsFix
from sitl_sim.vehicles.sensor_noise import SensorNoise

StateGrade = Literal["mocap", "rtk", "gps", "vio"]
Span = tuple[float, float]  # each vehicle draws a value between the two

_DEG = math.pi / 180.0
_NO_NOISE = (0.0, 0.0)


@dataclass(frozen=True)
class Steps:
    """Steps of the position estimate: multipath, an RTK solution that floats, a VIO relocalisation.

    every: mean time between two [s]. size, up: of a step along the ground and in height [m].
    lasts: s, until the estimate returns; infinite: never. slide: s, time constant with which the
    filter follows; 0: at once, and the reset counter counts it. turn: rad, 1 σ of the yaw. shown:
    share of the slide's speed that the reported velocity shows.
    """

    every: float
    size: Span
    up: Span
    lasts: Span
    slide: float
    turn: float = 0.0
    shown: float = 0.3
    floats: bool = False  # a GPS receiver calls it RTK_FLOAT


@dataclass(frozen=True)
class Grade:
    """Errors of a state estimate (1 σ) and what its estimator reports.

    wander, wander_up: slow error of the position [m], second-order Gauss-Markov with time constant
    wander_time [s]; the reported velocity does not show it. flutter: the fast error [m]; the
    velocity shows it. velocity: m/s. tilt: rad. yaw_bias: rad, constant. yaw_walk: rad/√s. scale:
    of the distance. walk: m/√m. baro: m/s, of the height. latency: s, that the filter does not
    know of; it acts below 1/latency_filter. reported_…: standard deviations in ODOMETRY.
    """

    noise: SensorNoise
    wander: Span = _NO_NOISE
    wander_up: Span = _NO_NOISE
    wander_time: float = 1.0
    flutter: float = 0.0
    flutter_time: float = 2.0
    velocity: float = 0.0
    velocity_time: float = 0.7
    tilt: Span = _NO_NOISE
    tilt_time: float = 10.0
    yaw_bias: Span = _NO_NOISE
    yaw_walk: float = 0.0
    scale: float = 0.0
    walk: float = 0.0
    baro: Span = _NO_NOISE
    latency: Span = _NO_NOISE
    latency_filter: float = 0.5
    steps: Steps | None = None
    fix: GpsFix = GpsFix.FIX_3D
    satellites: int = 14
    absolute: bool = True  # the position is one on the Earth
    reported_position: float = 0.1
    reported_height: float = 0.15
    reported_velocity: float = 0.05
    reported_attitude: float = 0.5 * _DEG
    reported_yaw: float = 1.0 * _DEG
    reported_float: float = 0.3  # m, while the RTK solution floats


_INERTIAL = SensorNoise(position=0.0, velocity=0.0, attitude=0.0)  # the gyro's noise, and 10 ms

GRADES: dict[str, Grade] = {
    "mocap": Grade(noise=SensorNoise()),
    "rtk": Grade(
        noise=_INERTIAL,
        wander=(0.008, 0.015),
        wander_up=(0.015, 0.03),
        wander_time=5.0,
        flutter=0.005,
        velocity=0.05,
        tilt=(0.5 * _DEG, 0.8 * _DEG),
        yaw_bias=(1.0 * _DEG, 2.0 * _DEG),
        latency=(0.02, 0.06),
        steps=Steps(60.0, (0.2, 0.5), (0.2, 0.7), (5.0, 20.0), 0.3, floats=True),
        fix=GpsFix.RTK_FIXED,
        satellites=22,
        reported_position=0.02,
        reported_height=0.03,
    ),
    "gps": Grade(
        noise=_INERTIAL,
        wander=(0.5, 1.0),
        wander_up=(0.3, 0.5),
        wander_time=20.0,
        flutter=0.08,
        velocity=0.08,
        tilt=(1.0 * _DEG, 1.5 * _DEG),
        yaw_bias=(2.0 * _DEG, 5.0 * _DEG),
        baro=(0.0005, 0.002),
        latency=(0.1, 0.2),
        steps=Steps(60.0, (0.5, 1.5), (0.3, 1.0), (5.0, 15.0), 1.0),
        reported_position=0.6,
        reported_height=0.5,
        reported_velocity=0.15,
        reported_attitude=1.0 * _DEG,
        reported_yaw=3.0 * _DEG,
    ),
    "vio": Grade(
        noise=_INERTIAL,
        flutter=0.01,
        velocity=0.04,
        tilt=(0.3 * _DEG, 0.6 * _DEG),
        yaw_walk=0.1 * _DEG,
        scale=0.006,
        walk=0.02,
        latency=(0.03, 0.08),
        steps=Steps(60.0, (0.15, 0.25), (0.0, 0.08), (math.inf, math.inf), 0.0, turn=0.5 * _DEG),
        fix=GpsFix.NO_FIX,
        satellites=0,
        absolute=False,
        reported_position=0.1,
        reported_height=0.1,
        reported_velocity=0.08,
    ),
}
