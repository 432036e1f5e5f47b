"""Goals in order, each in the drone's own ENU frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from companion.types import Vector
from mavlink_bridge.messages import VehicleState
from mavlink_bridge.settings import StrictModel


class MissionConfig(StrictModel):
    """What to fly."""

    goals: list[list[float]] = Field(
        [], description="[x, y, z] m each, own ENU frame (origin: where the vehicle booted)."
    )
    tolerance: float = Field(1.0, gt=0, description="A goal is reached within this [m].")
    final_tolerance: float = Field(
        0.5, gt=0, description="The last goal is reached within this [m], and slowly."
    )
    final_speed: float = Field(0.4, gt=0, description="Speed [m/s] called slow.")
    auto: bool = Field(
        False, description="Arm, take off, fly and land without being told; else wait for a pilot."
    )
    takeoff_altitude: float = Field(2.0, gt=0.5, description="m above where it stood.")
    land: bool = Field(True, description="Land at the last goal; else hold there.")


@dataclass(frozen=True)
class Progress:
    """Where the mission stands: goal (3,) m to fly to, its number, how many are reached."""

    goal: Vector
    index: int
    complete: bool


class Mission:
    """Flies `goals` one after another; holds the last."""

    def __init__(self, config: MissionConfig) -> None:
        self._config = config
        self._goals = [np.array(g, dtype=float) for g in config.goals]
        self._index = 0
        self._complete = not self._goals

    def update(self, own: VehicleState) -> Progress:
        """Advance where the present goal is reached; without goals, stay where the drone is."""
        while not self._complete and self._reached(own):
            if self._index + 1 < len(self._goals):
                self._index += 1
            else:
                self._complete = True
        goal = self._goals[self._index] if self._goals else own.p
        return Progress(goal, self._index, self._complete)

    def _reached(self, own: VehicleState) -> bool:
        distance = float(np.linalg.norm(self._goals[self._index] - own.p))
        if self._index + 1 < len(self._goals):
            return distance <= self._config.tolerance
        slow = float(np.linalg.norm(own.v)) <= self._config.final_speed
        return distance <= self._config.final_tolerance and slow


def check_goals(goals: Sequence[Sequence[float]]) -> None:
    """Refuse goals that are not [x, y, z].

    Raises:
        ValueError: naming the first bad one.
    """
    for n, goal in enumerate(goals):
        if len(goal) != 3:
            raise ValueError(f"goals.{n}: must be [x, y, z], got {len(goal)} numbers")
