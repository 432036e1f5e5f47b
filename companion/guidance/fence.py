"""Where the drone may be: sides, floor and ceiling, as half-spaces."""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import Field, model_validator

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import Contradiction, StrictModel

_FENCE_REACH = 6.0  # m, more than the horizon's 2 s at any speed


class FenceConfig(StrictModel):
    """Where the drone may be, own ENU frame [m]; planes of the NMPC."""

    altitude_min: float = Field(0.8, description="No plan leads below, once in flight.")
    altitude_max: float = Field(5.0, gt=1, description="Not above.")
    altitude_band: float = Field(
        1.0,
        gt=0,
        description="Around the goal's height: who evades up or down leaves the others' view.",
    )
    east: list[float] | None = Field(
        None, min_length=2, max_length=2, description="[least, most]; none where not given."
    )
    north: list[float] | None = Field(
        None, min_length=2, max_length=2, description="[least, most]; none where not given."
    )

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        for key in ("east", "north"):
            limits = getattr(self, key)
            if limits is not None and limits[0] >= limits[1]:
                raise Contradiction((key,), f"must be [least, most], got {limits}")
        return self

    def planes(self) -> Vector:
        """(H,4) half-spaces n·p <= b: the sides, and the top last."""
        rows = []
        for axis, limits in enumerate((self.east, self.north)):
            for sign, limit in zip((-1.0, 1.0), limits or (), strict=False):
                row = [0.0, 0.0, 0.0, sign * limit]
                row[axis] = sign
                rows.append(row)
        return np.array([*rows, [0.0, 0.0, 1.0, self.altitude_max]])

    def sides(self) -> Vector:
        """(K,4) half-spaces n·p <= b, upright."""
        return self.planes()[:-1]

    def near(self, p: Vector, apart: float) -> Vector:
        """(K,4) the sides that a plan from p (3,) could reach, which keeps `apart` [m] from them.

        One that is crossed already only lets it go no farther. Sides and trunks share one slack:
        who were to come back at any price would come through a trunk.
        """
        sides = self.sides()
        beyond = sides[:, :3] @ p - sides[:, 3]
        sides[:, 3] += np.where(beyond > 0.0, beyond + apart, 0.0)
        near: Vector = sides[beyond > -_FENCE_REACH]
        return near

    def across(self, p: Vector, v: Vector) -> tuple[float, float]:
        """How far [m] p (3,) is outside (< 0: within), and how fast [m/s] v leads on outwards."""
        planes = self.planes()
        beyond = planes[:, :3] @ p - planes[:, 3]
        worst = int(np.argmax(beyond))
        return float(beyond[worst]), float(planes[worst, :3] @ v)

    def altitude_planes(self, goal_altitude: float) -> Vector:
        """(2,4) half-spaces n·p <= b: the band around the goal's height, inside the fence."""
        top = min(self.altitude_max, goal_altitude + self.altitude_band)
        bottom = max(self.altitude_min, goal_altitude - self.altitude_band)
        return np.array([[0, 0, 1, top], [0, 0, -1, -bottom]], dtype=float)
