"""The ground around the drone, as a plane in its own frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mavlink_bridge.shared.arrays import Vector


@dataclass(frozen=True)
class GroundPlane:
    """A plane: `level` [m] is its height at `at` (x, y) [m], `rise` its slope, m/m, east and north.

    Lengths are in m, places and directions in the own ENU frame.
    """

    level: float = 0.0
    at: tuple[float, float] = (0.0, 0.0)
    rise: tuple[float, float] = (0.0, 0.0)

    def below(self, places: Vector) -> Vector:
        """Return its height (n,) at places (n,2) or (n,3)."""
        east, north = self.rise
        x, y = places[..., 0] - self.at[0], places[..., 1] - self.at[1]
        return np.asarray(self.level + east * x + north * y)

    def under(self, p: Vector) -> float:
        """Return the height over it of a place p (3,)."""
        (x, y, z), (east, north) = p.tolist(), self.rise
        return float(z - self.level - east * (x - self.at[0]) - north * (y - self.at[1]))

    def half_space(self, apart: float) -> Vector:
        """Return the space at least `apart` [m] over it, as (4,) n, b: where n·p <= b."""
        (x, y), (east, north) = self.at, self.rise
        row = np.array([east, north, -1.0, east * x + north * y - self.level - apart])
        return np.asarray(row / np.linalg.norm(row[:3]))

    def drop(self, rays: Vector) -> Vector:
        """Return by how much directions (n,3) come nearer to it, (n,), per unit of length."""
        east, north = self.rise
        return np.asarray(rays[..., 0] * east + rays[..., 1] * north - rays[..., 2])


LEVEL = GroundPlane()
