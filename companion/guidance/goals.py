"""Goals: where a mission leads, said in the drone's own frame, from its home, or on the Earth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from pydantic import Field, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.settings import Contradiction, StrictModel
from mavlink_bridge.wire.messages import HomePosition

_EARTH = 6371000.0  # m, of PX4's own projection
_WAYS = "[x, y, z], {place: [x, y, z]}, {home: [east, north, up]} or {latitude, longitude, height}"


class GoalConfig(StrictModel):
    """One goal; `[x, y, z]` alone is `{place: [x, y, z]}`."""

    place: list[float] | None = Field(
        None, description="[x, y, z] m, own ENU frame (origin: where the vehicle booted)."
    )
    home: list[float] | None = Field(
        None, description="[east, north, up] m from the vehicle's home position."
    )
    latitude: float | None = Field(None, ge=-90, le=90, description="Degrees north.")
    longitude: float | None = Field(None, ge=-180, le=180, description="Degrees east.")
    height: float | None = Field(None, description="m above the vehicle's home position.")
    opening: bool = Field(
        False,
        description="The goal is behind or in an opening: the drone heads for the middle of the "
        "opening that it sees nearest to the place, which may be some metres wrong.",
    )

    @model_validator(mode="before")
    @classmethod
    def _plain_place(cls, data: Any) -> Any:
        return {"place": data} if isinstance(data, list | tuple | np.ndarray) else data

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        earth = (self.latitude, self.longitude, self.height)
        ways = [self.place is not None, self.home is not None, any(e is not None for e in earth)]
        if ways.count(True) != 1 or (ways[2] and None in earth):
            raise Contradiction((), f"must be one of {_WAYS}")
        for key in ("place", "home"):
            given = getattr(self, key)
            if given is not None and (len(given) != 3 or not np.isfinite(given).all()):
                raise Contradiction((), f"must be [x, y, z], got {given}")
        return self

    @property
    def on_map(self) -> bool:
        """Whether the goal's place is known without the vehicle's home."""
        return self.place is not None

    def at(self, home: HomePosition | None) -> Vector | None:
        """Return the place (3,) m in the own ENU frame; None where it needs a home not yet told."""
        if self.place is not None:
            return np.array(self.place, dtype=float)
        if home is None:
            return None
        if self.home is not None:
            return np.array(self.home, dtype=float) + home.p
        latitude, longitude, height = (
            float(e or 0.0) for e in (self.latitude, self.longitude, self.height)
        )
        return on_earth(latitude, longitude, height, home)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """Return the JSON schema: a list of three numbers, or the mapping."""
        place = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
        return {"anyOf": [place, handler(schema)]}


@dataclass(frozen=True)
class Goal:
    """A goal whose place p (3,) m, own ENU frame, is known. opening: see `GoalConfig`."""

    p: Vector
    opening: bool = False


def resolved(goals: Sequence[GoalConfig], home: HomePosition | None) -> list[Goal] | None:
    """Return the goals with their places; None where one needs a home that is not known."""
    places = [(g.at(home), g.opening) for g in goals]
    if any(p is None for p, _ in places):
        return None
    return [Goal(p, opening) for p, opening in places if p is not None]


def on_earth(latitude: float, longitude: float, up: float, home: HomePosition) -> Vector:
    """Return the place (3,) m in the own ENU frame; latitude, longitude: °, up: m above home."""
    north = math.radians(latitude - home.latitude_deg) * _EARTH
    east = math.radians(longitude - home.longitude_deg) * _EARTH
    east *= math.cos(math.radians(home.latitude_deg))
    return np.array([east, north, up]) + home.p
