"""The airframes of a scenario: what each drone is taken for, and what it truly is."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from mavlink_bridge.shared.settings import StrictModel
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.airframes import AIRFRAMES, Deviation

AirframeName = Literal["quad3", "quad5", "quad7"]
_Positive = Annotated[float, Field(gt=0)]
_Three = Annotated[list[_Positive], Field(min_length=3, max_length=3)]
Factor = _Positive | Annotated[list[_Positive], Field(min_length=2, max_length=2)]


class AirframeConfig(StrictModel):
    """An airframe by name, with values of its own where they are given."""

    name: AirframeName = "quad5"
    mass: _Positive | None = Field(None, description="kg.")
    inertia: _Three | None = Field(None, description="kg m², about forward, left, up.")
    arm: _Positive | None = Field(None, description="Centre to motor [m].")
    thrust_max: _Positive | None = Field(None, description="N per motor at full speed.")
    motor_time: _Positive | None = Field(None, description="Lag of the motors' speed [s].")
    drag_linear: _Three | None = Field(None, description="N/(m/s), along forward, left, up.")
    drag_quadratic: float | None = Field(None, ge=0, description="N/(m/s)².")
    radius: _Positive | None = Field(None, description="Of the sphere around the drone [m].")
    rotor_radius: _Positive | None = Field(None, description="m.")
    battery_ah: _Positive | None = Field(None, description="Capacity [A h].")
    battery_resistance: float | None = Field(
        None, ge=0, description="ohm; the voltage sags by it under load."
    )

    def airframe(self) -> Airframe:
        """Return the airframe."""
        given: dict[str, Any] = self.model_dump(exclude={"name"}, exclude_none=True)
        for key in ("inertia", "drag_linear"):
            if key in given:
                given[key] = tuple(given[key])
        return replace(AIRFRAMES[self.name], **given)


class ActualConfig(StrictModel):
    """How the vehicles truly differ from their airframes; neither autopilot nor companion knows.

    Factors; [least, most]: each drone draws its own.
    """

    mass: Factor = 1.0
    inertia: Factor = 1.0
    thrust: Factor = Field(1.0, description="Of all motors: worn propellers, thin air.")
    drag: Factor = 1.0
    motor_time: Factor = 1.0
    rate_gains: Factor = Field(1.0, description="P, I and D of the rate loops.")
    battery: Factor = Field(1.0, description="Internal resistance: an old battery sags more.")

    def deviations(self, count: int, seed: int) -> list[Deviation]:
        """Return each drone's deviation; the seed draws what is drawn."""
        columns = {}
        for purpose, field in enumerate(fields(Deviation)):
            factor = getattr(self, field.name)
            low, high = factor if isinstance(factor, list) else (factor, factor)
            rng = np.random.default_rng([seed, 9, purpose])
            columns[field.name] = rng.uniform(low, high, count)
        return [Deviation(**{k: float(v[i]) for k, v in columns.items()}) for i in range(count)]
