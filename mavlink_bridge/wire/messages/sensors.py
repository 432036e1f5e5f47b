"""GPS fixes, and the sensors and motors of a simulated vehicle (HIL)."""

from __future__ import annotations

from dataclasses import dataclass

from mavlink_bridge.shared.arrays import Vector


@dataclass(frozen=True)
class GpsRaw:
    """GPS_RAW_INT; fix_type: GPS_FIX_TYPE; speed [m/s]; course: ENU yaw [rad].

    hdop, vdop: dilutions of precision. The accuracies (1 σ) are m and m/s; 0 where not told.
    """

    time: float
    fix_type: int
    latitude_deg: float
    longitude_deg: float
    altitude: float
    satellites: int
    speed: float = 0.0
    course: float = 0.0
    hdop: float = 0.8
    vdop: float = 1.2
    horizontal_accuracy: float = 0.0
    vertical_accuracy: float = 0.0
    speed_accuracy: float = 0.0


@dataclass(frozen=True)
class DistanceSensor:
    """DISTANCE_SENSOR: distance, least and greatest that the sensor measures [m].

    orientation: MAV_SENSOR_ORIENTATION. kind: MAV_DISTANCE_SENSOR. sigma: m, 0 where not told.
    quality: %, 0 unknown, 1 no echo.
    """

    time: float
    distance: float
    minimum: float
    maximum: float
    orientation: int
    kind: int = 0
    sigma: float = 0.0
    quality: int = 0


@dataclass(frozen=True)
class GpsInput:
    """GPS_INPUT, a fix that a receiver sends to an autopilot; degrees, m.

    v: m/s, (3,) ENU, (2,) where the vertical is not given, None where the horizontal is not.
    """

    time: float
    fix_type: int
    latitude_deg: float
    longitude_deg: float
    altitude: float
    v: Vector | None
    satellites: int = 12


@dataclass(frozen=True)
class HilSensor:
    """HIL_SENSOR: force (3,) m/s² and omega (3,) rad/s FLU, magnetic (3,) gauss FLU, hPa, m."""

    time: float
    force: Vector
    omega: Vector
    magnetic: Vector
    pressure: float
    altitude: float


@dataclass(frozen=True)
class HilGps:
    """HIL_GPS, a simulated receiver's fix: degrees, m, v (3,) m/s ENU.

    horizontal, vertical: accuracy that the receiver states [m].
    """

    time: float
    latitude_deg: float
    longitude_deg: float
    altitude: float
    v: Vector
    horizontal: float = 0.3
    vertical: float = 0.4


@dataclass(frozen=True)
class HilActuators:
    """HIL_ACTUATOR_CONTROLS: the autopilot's motor commands, 0…1 each (16)."""

    time: float
    controls: tuple[float, ...]
    armed: bool


@dataclass(frozen=True)
class HilState:
    """HIL_STATE_QUATERNION, where a simulated vehicle truly is: degrees, m, v (3,) m/s ENU.

    time: s; 0 where it is not told, as by PX4. q_wb (4,), omega (3,) rad/s FLU.
    """

    time: float
    q_wb: Vector
    omega: Vector
    latitude_deg: float
    longitude_deg: float
    altitude: float
    v: Vector
