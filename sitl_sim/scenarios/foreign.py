"""The foreign drones of a scenario: drones that are not ours, and what flies each of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Self

from pydantic import Field, model_validator

from mavlink_bridge.shared.settings import Contradiction, SettingsError, StrictModel

PILOTS = ("hover", "straight", "pursue")
_SPEEDS = {"straight": 2.0, "pursue": 5.0}  # m/s, where a scenario gives none
_AFTER = 8.0  # s: the drones of a packaged scenario have climbed, and are on their way


class ForeignConfig(StrictModel):
    """One foreign drone: it gives way to nobody, has no targets to reach, and may hit obstacles."""

    does: str = Field(
        description="hover: takes off and stays; straight: takes off, flies from target to target "
        "round trunks, and stays at the last; pursue: takes off, then flies at the nearest "
        "drone of ours; or the name of a controller, with which its companion flies.",
    )
    speed: float | None = Field(
        None,
        gt=0,
        le=10,  # what a quad5 holds against its drag with the tilt that its autopilot allows
        description="straight, pursue: m/s; 2 and 5 where not given.",
    )
    after: float | None = Field(
        None,
        ge=0,
        description="pursue: it hovers until this time of the flight [s]; 8 where not given.",
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.speed is not None and self.does not in _SPEEDS:
            raise Contradiction(("speed",), f"belongs to does: {', '.join(_SPEEDS)}")
        if self.after is not None and self.does != "pursue":
            raise Contradiction(("after",), "belongs to does: pursue")
        return self

    @property
    def piloted(self) -> bool:
        """Whether the simulator flies it, so that it has no companion."""
        return self.does in PILOTS

    @property
    def fastest(self) -> float:
        """Its speed [m/s], where it has one."""
        return self.speed if self.speed is not None else _SPEEDS.get(self.does, 0.0)

    @property
    def begins(self) -> float:
        """Time of the flight [s] from which it pursues."""
        return _AFTER if self.after is None else self.after


Foreign = Mapping[str, ForeignConfig]


def check_names(foreign: Foreign, names: Sequence[str]) -> None:
    """Refuse foreign drones that do not exist, and flights in which no drone is ours.

    Raises:
        SettingsError: the message lists the drones that there are.
    """
    if unknown := [n for n in foreign if n not in names]:
        raise SettingsError([f"drones.foreign: no drone {unknown[0]!r}; valid: {', '.join(names)}"])
    if not any(n not in foreign for n in names):
        raise SettingsError(["drones.foreign: one drone at least must be ours"])
