"""Threat of each neighbour, and the critical neighbours: at most three (section III-C).

The paper's R_ij = RD/RS (eq. 8) with RD = exp(|p_ij| - d_ref) (eq. 9) and RS the closing
speed (eq. 10) shrinks as danger grows and divides by zero. Its inverse orders neighbours the
same way and is defined everywhere: threat = max(closing speed, floor) · exp(d_ref - |p_ij|).
A larger threat is worse.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from pydantic import Field

from companion.types import Track
from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.shared.settings import StrictModel
from mavlink_bridge.wire.messages import VehicleState


class ThreatConfig(StrictModel):
    """How threat is measured."""

    closing_floor: float = Field(
        0.6,
        gt=0,
        description="Least closing speed [m/s] that counts: a near neighbour is a threat even "
        "while it flies away.",
    )
    critical: int = Field(
        3, ge=1, le=12, description="Most critical neighbours (out-degree < 4 in the paper)."
    )
    range_max: float = Field(
        10.0, gt=0, description="R of eq. (6) [m]: a neighbour farther away is ignored."
    )


def threat(own: VehicleState, p: Vector, v: Vector, d_ref: float, config: ThreatConfig) -> float:
    """Return the threat [m/s] of a neighbour, eq. (8)-(10).

    The neighbour is at p (3,) m and moves with v (3,) m/s, own ENU frame; d_ref [m] is that of (9).
    """
    offset = p - own.p
    distance = norm(offset)
    closing = float(offset @ (own.v - v)) / max(distance, 1e-6)
    return max(closing, config.closing_floor) * math.exp(d_ref - distance)


def rated_neighbours(
    own: VehicleState, tracks: Sequence[Track], d_ref: float, config: ThreatConfig
) -> list[tuple[Track, float]]:
    """Return the tracks in range with their threat, worst first, in whatever order they come.

    The first `critical` of them are the critical neighbours.
    """
    near = [t for t in tracks if norm(t.p - own.p) <= config.range_max]
    rated = [(t, threat(own, t.p, t.v, d_ref, config)) for t in near]
    return sorted(rated, key=lambda r: (-r[1], r[0].id))
