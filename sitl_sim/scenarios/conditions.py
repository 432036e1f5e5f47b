"""Conditions of a flight: delays, wind, and the air between drones and ground."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import Contradiction, StrictModel
from sitl_sim.vehicles.turbulence import Strength

Delay = float | Annotated[list[float], Field(min_length=2, max_length=2)]


def _span(delay: float | list[float]) -> tuple[float, float]:
    """Return the least and the largest value of a delay."""
    return (delay[0], delay[1]) if isinstance(delay, list) else (delay, delay)


def drawn(delay: float | list[float], count: int, seed: int, purpose: int) -> Vector:
    """Return the delay (count,) s of each drone; purpose: a number for each key."""
    low, high = _span(delay)
    return np.random.default_rng([seed, purpose]).uniform(low, high, count)


class TimingConfig(StrictModel):
    """Timing of the lockstep, and of real time."""

    speed: float = Field(
        1.0,
        ge=0.25,
        le=4,
        description="Simulated seconds in a second of --real-time: how fast the vehicles' clocks "
        "run against the companions'.",
    )
    compute_delay: Delay = Field(
        0.02,
        description="Tick to effect [s], 0.002 to 0.2; [least, most]: each drone draws its own. "
        "No companion is told.",
    )
    compute_jitter: float = Field(
        0.0, ge=0, le=0.1, description="compute_delay varies by up to ± this at each tick [s]."
    )
    telemetry_lag: Delay = Field(
        0.0,
        description="Age of what telemetry tells [s], 0 to 0.2; [least, most]: each drone draws "
        "its own. No companion is told.",
    )
    telemetry_jitter: float = Field(
        0.0, ge=0, le=0.05, description="telemetry_lag varies by up to ± this [s]."
    )
    telemetry_stamp: Literal["sent", "measured"] = Field(
        "sent",
        description="Of late telemetry: the time at which it is sent, as autopilots do, or at "
        "which it was measured.",
    )
    answer_timeout: float = Field(
        30.0, gt=0, description="Wall seconds after which a silent companion counts as dead."
    )

    @model_validator(mode="after")
    def _within_reach(self) -> Self:
        for key, least, most in (("compute_delay", 0.002, 0.2), ("telemetry_lag", 0.0, 0.2)):
            low, high = _span(getattr(self, key))
            if not least <= low <= high <= most:
                raise Contradiction((key,), f"takes {least:g}…{most:g} s, or [least, most] in it")
        return self


class WindConfig(StrictModel):
    """The wind: a list of three numbers stands for its mean."""

    mean: list[float] = Field(
        [0.0, 0.0, 0.0], min_length=3, max_length=3, description="m/s ENU, the same everywhere."
    )
    turbulence: Strength = Field(
        "none",
        description="Gusts after MIL-F-8785C (Dryden), different at each drone: none, light, "
        "moderate, severe.",
    )

    @model_validator(mode="before")
    @classmethod
    def _list_is_the_mean(cls, value: Any) -> Any:
        return {"mean": value} if isinstance(value, list) else value


class AirConfig(StrictModel):
    """What drones and ground do to the air."""

    downwash: bool = Field(False, description="The wake of a drone pushes those below it.")
    ground_effect: bool = Field(False, description="Near the ground the rotors give more thrust.")
