"""Fence: the sides, floor and ceiling of where the drone may be, as half-spaces."""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import Field, model_validator

from companion.estimation.height import Height
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import Contradiction, StrictModel

_SURE = 0.2  # m, 1 σ of the height over ground, up to which altitude_min has room for it
_DOUBT_MAX = 0.5  # m; no more is added for a ground that nobody knows
_ROOM = 0.3  # m that stays between floor and ceiling
_REACH = 6.0  # m, farther than a plan gets in its 2 s at any speed


class FenceConfig(StrictModel):
    """Limits of the own place [m; own ENU frame]; planes of the NMPC."""

    altitude_min: float = Field(
        0.8, description="Least height [m] over ground of a plan in flight, and of a goal."
    )
    ground_min: float = Field(
        0.0,
        le=0.0,
        description="Lowest level [m] of the ground: on a slope goals may be as low as "
        "altitude_min over it.",
    )
    altitude_max: float = Field(5.0, gt=1, description="Highest altitude [m].")
    altitude_band: float = Field(
        0.7,
        gt=0,
        description="Half the height [m] of the band around the straight way from goal to goal; "
        "plans keep `nmpc.d_obstacle_safety` from its edges. A drone that plans farther up or "
        "down than 0.1 m leaves the view of those beside it, and meets them in a crowd.",
    )
    east: list[float] | None = Field(
        None, min_length=2, max_length=2, description="[least, most] x [m]; null: no limit."
    )
    north: list[float] | None = Field(
        None, min_length=2, max_length=2, description="[least, most] y [m]; null: no limit."
    )

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        for key in ("east", "north"):
            limits = getattr(self, key)
            if limits is not None and limits[0] >= limits[1]:
                raise Contradiction((key,), f"must be [least, most], got {limits}")
        return self

    def _limits(self) -> list[tuple[int, float, float]]:
        """Return axis, sign and b of the sides, and of the top last: free where sign · p <= b."""
        sides = [
            (axis, sign, sign * limit)
            for axis, limits in enumerate((self.east, self.north))
            for sign, limit in zip((-1.0, 1.0), limits or (), strict=False)
        ]
        return [*sides, (2, 1.0, self.altitude_max)]

    @property
    def goal_min(self) -> float:
        """Lowest altitude of a goal [m]."""
        return self.ground_min + self.altitude_min

    def planes(self) -> Vector:
        """Return the sides, and the top last, as (H,4) half-spaces n·p <= b."""
        limits = self._limits()
        rows = np.zeros((len(limits), 4))
        for row, (axis, sign, b) in zip(rows, limits, strict=True):
            row[axis], row[3] = sign, b
        return rows

    def sides(self) -> Vector:
        """Return the sides as (K,4) half-spaces n·p <= b."""
        return self.planes()[:-1]

    def near(self, p: Vector, apart: float) -> Vector:
        """Return the sides (K,4) that a plan from p (3,) m could reach; the plan keeps `apart` [m].

        A side that p has crossed is moved out so far that the plan must only lead no farther out.
        Sides and trunks share one slack: a drone that came back at any price would come through a
        trunk.
        """
        sides = self.sides()
        beyond = sides[:, :3] @ p - sides[:, 3]
        sides[:, 3] += np.where(beyond > 0.0, beyond + apart, 0.0)
        near: Vector = sides[beyond > -_REACH]
        return near

    def back(self, p: Vector, goal: Vector, apart: float) -> Vector:
        """Return the move (3,) m of a goal (3,) m that leads a drone at p (3,) m back inside.

        It brings the goal `apart` [m] within each side that p has crossed; 0 within all sides.
        """
        sides = self.sides()
        crossed = sides[sides[:, :3] @ p > sides[:, 3]]
        over = np.maximum(crossed[:, :3] @ goal - crossed[:, 3] + apart, 0.0)
        move: Vector = -over @ crossed[:, :3]
        return move

    def across(self, p: Vector, v: Vector) -> tuple[float, float]:
        """Return how far [m] p (3,) is outside (< 0: within), and the speed [m/s] of v outwards."""
        place, speed = p.tolist(), v.tolist()
        beyond = [(sign * place[axis] - b, sign * speed[axis]) for axis, sign, b in self._limits()]
        return max(beyond, key=lambda side: side[0])

    def floor(self, height: Height | None) -> float:
        """Return the lowest z [m] of a plan over the ground that `height` tells.

        A ground that is less sure than usual is kept farther below.
        """
        if height is None:
            return self.altitude_min
        return (
            height.ground.level
            + self.altitude_min
            + min(max(height.sigma - _SURE, 0.0), _DOUBT_MAX)
        )

    def altitude_planes(self, altitude: float, floor: float, z: float, apart: float) -> Vector:
        """Return the band around an altitude [m] above the floor [m], as (2,4) half-spaces.

        Where the floor is near the ceiling, the floor counts. z: m, where the drone is; its plan
        keeps `apart` [m]. One that has been pushed out of the band must only go no farther out:
        hurled back it would meet who is above or below it, out of its view.
        """
        top = max(min(self.altitude_max, altitude + self.altitude_band), z + apart)
        bottom = max(floor, min(altitude - self.altitude_band, z - apart))
        top = max(top, bottom + _ROOM)
        return np.array([[0, 0, 1, top], [0, 0, -1, -bottom]], dtype=float)
