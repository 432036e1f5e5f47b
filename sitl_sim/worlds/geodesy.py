"""Between metres (ENU) around a reference and WGS 84 degrees, on the local tangent plane."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

A = 6378137.0  # m, WGS 84 semi-major axis
E2 = 6.69437999014e-3  # first eccentricity squared


@dataclass(frozen=True)
class GeoReference:
    """Place of the world's origin on the Earth: degrees, metres above sea level."""

    latitude_deg: float = 47.397742
    longitude_deg: float = 8.545594
    altitude: float = 488.0

    @cached_property
    def _radii(self) -> tuple[float, float]:
        """Metres per radian of latitude and of longitude."""
        s = math.sin(math.radians(self.latitude_deg))
        w = 1.0 - E2 * s * s
        north = A * (1.0 - E2) / w**1.5
        east = A / math.sqrt(w) * math.cos(math.radians(self.latitude_deg))
        return north, east

    def to_degrees(self, x: float, y: float) -> tuple[float, float]:
        """Return latitude and longitude [deg] of a point x east and y north of the origin [m]."""
        north, east = self._radii
        return (
            self.latitude_deg + math.degrees(y / north),
            self.longitude_deg + math.degrees(x / east),
        )

    def to_metres(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Return the metres east and north of the origin of a latitude and longitude [deg]."""
        north, east = self._radii
        return (
            math.radians(longitude_deg - self.longitude_deg) * east,
            math.radians(latitude_deg - self.latitude_deg) * north,
        )


class LocalFrame:
    """A vehicle's own ENU frame: its origin in the world, turned by `yaw` [rad] about z.

    The vehicle's east is the world's east turned by yaw. Its GPS agrees with its own frame around
    its origin, so that all its telemetry is consistent.
    """

    def __init__(self, origin: Floats, yaw: float, reference: GeoReference) -> None:
        self.origin = np.array(origin, dtype=np.float64)
        self.yaw, self.reference = float(yaw), reference
        self._cos, self._sin = math.cos(self.yaw), math.sin(self.yaw)
        self._q = (math.cos(self.yaw / 2), math.sin(self.yaw / 2))

    def vector(self, v: Floats) -> Floats:
        """Return a world vector (3,) in the own frame."""
        x, y, z = v.tolist()
        return np.array([self._cos * x + self._sin * y, self._cos * y - self._sin * x, z])

    def point(self, p: Floats) -> Floats:
        """Return a world point (3,) m in the own frame."""
        return self.vector(p - self.origin)

    def attitude(self, q: Floats) -> Floats:
        """Return an attitude (4,) body → world as body → own frame.

        The product of two quaternions, one of which is about z: written out, half of it is zero.
        """
        w, x, y, z = q.tolist()
        c, s = self._q
        return np.array([c * w + s * z, c * x + s * y, c * y - s * x, c * z - s * w])

    def to_world(self, p: Floats) -> tuple[float, float, float]:
        """Return a point (3,) m of the own frame in the world."""
        x, y, z = float(p[0]), float(p[1]), float(p[2])
        ox, oy, oz = (float(k) for k in self.origin)
        return (
            ox + self._cos * x - self._sin * y,
            oy + self._sin * x + self._cos * y,
            oz + z,
        )

    def to_geo(self, p: Floats) -> tuple[float, float, float]:
        """Return latitude, longitude [deg] and altitude [m] of a world point, by the own frame."""
        x, y, z = self.point(p).tolist()
        lat, lon = self.reference.to_degrees(x + float(self.origin[0]), y + float(self.origin[1]))
        return lat, lon, self.reference.altitude + z + float(self.origin[2])

    def from_geo(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Return world x, y [m] of a latitude and longitude [deg]: the inverse of `to_geo`."""
        x, y = self.reference.to_metres(latitude_deg, longitude_deg)
        own = np.array([x - float(self.origin[0]), y - float(self.origin[1]), 0.0])
        return self.to_world(own)[:2]
