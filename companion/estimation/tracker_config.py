"""Numbers of the tracker."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from companion.estimation.existence import check_chances
from mavlink_bridge.shared.settings import StrictModel


class TrackerConfig(StrictModel):
    """Numbers of the tracker, each with its reason."""

    acceleration: float = Field(
        2.5,
        gt=0,
        description="Std of the acceleration [m/s²] of a neighbour that manoeuvres; the NMPC uses "
        "±2. This, `drift` and the two times make remembered places likeliest on two recorded "
        "flights.",
    )
    drift: float = Field(
        0.4, gt=0, description="Std of the acceleration [m/s²] of a neighbour that keeps on."
    )
    keeps_on: float = Field(3.0, gt=0, description="Mean time [s] for which a neighbour keeps on.")
    manoeuvres: float = Field(
        1.5, gt=0, description="Mean time [s] for which a neighbour manoeuvres."
    )
    velocity_birth: float = Field(
        1.2, gt=0, description="Std of velocity [m/s] of a neighbour just seen: up to cruise."
    )
    attitude_sigma: float = Field(
        0.006, ge=0, description="Std [rad] of the own attitude; adds to each bearing."
    )
    gate: float = Field(
        16.3,
        gt=0,
        description="Gate of the squared Mahalanobis distance: 99.9 % of chi² with 3 dof. With a "
        "smaller one a neighbour that swerves is lost.",
    )
    detected: float = Field(
        0.85,
        gt=0,
        lt=1,
        description="Probability that a neighbour in plain view is seen. Assumed, as is `ghosts`: "
        "two clear looks make a neighbour, four misses end it.",
    )
    ghosts: float = Field(
        0.05,
        gt=0,
        lt=1,
        description="Probability that something clear is seen at a place where no neighbour is.",
    )
    clear: float = Field(
        0.25, gt=0, description="Std of range, as a share of it, up to which a look is clear."
    )
    unseen_max: float = Field(
        4.0,
        gt=0,
        description="Longest memory [s] out of view, of the surest neighbour: others, and ghosts, "
        "are forgotten sooner.",
    )
    sigma_max: float = Field(3.0, gt=0, description="Std of position [m] that ends a track.")
    damping: float = Field(
        0.7,
        ge=0,
        description="Rate [1/s] at which the velocity of an unseen neighbour that manoeuvres "
        "fades: to the own velocity where it flew along, else to rest, see `along`.",
    )
    speed_max: float = Field(
        8.0,
        gt=0,
        description="Highest speed of a track [m/s]: above what attacks, so that a track keeps up "
        "with it.",
    )
    along: float = Field(
        1.5,
        gt=0,
        description="Scale of how far a neighbour flies along: where its velocity differs by d "
        "[m/s] from the own one when last seen, the share exp(-(d/along)²) of the own velocity is "
        "what its velocity fades to.",
    )
    size_sigma: float = Field(
        0.0,
        ge=0,
        le=0.6,
        description="Std of a neighbour's size, as a share of the one that the detector assumes; "
        "0: all are of that size, 0.4: of any from half to twice.",
    )

    @model_validator(mode="after")
    def _check_chances(self) -> Self:
        check_chances(self.detected, self.ghosts)
        return self
