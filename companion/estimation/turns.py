"""Turns of the attitude that the gyro does not show: an estimator's correction, or its error."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import Attitude

_LONGEST_GAP = 0.25  # s between two attitudes, over which rates are not summed up


@dataclass(frozen=True)
class Turn:
    """The part of the turn between two attitudes that the body rates do not show.

    time: s, at its end. dt: s. follows: whether the turn before ends where it begins. off: rad,
    rotation vector, body. spread: rad, by how much the rates changed between. up: rad, of `off`,
    about the vertical; to the left.
    """

    time: float
    dt: float
    follows: bool
    off: tuple[float, float, float]
    spread: float
    up: float


def turn_about(places: Vector, p: Vector, angle: float) -> None:
    """Turn places (n,≥2), x and y first, left about p (≥2,) by `angle` [rad], in place."""
    arms, (c, s) = places[:, :2] - p[:2], (math.cos(angle), math.sin(angle))
    places[:, 0] = p[0] + c * arms[:, 0] - s * arms[:, 1]
    places[:, 1] = p[1] + s * arms[:, 0] + c * arms[:, 1]


class UnexplainedTurns:
    """Compares each attitude's turn since the one before with the mean of both rates."""

    def __init__(self) -> None:
        self._before: tuple[Attitude, Vector] | None = None  # and its matrix
        self._follows = False

    def update(self, attitudes: Iterable[Attitude]) -> list[Turn]:
        """Return the turns to new attitudes, in order of time."""
        turns = []
        for now in attitudes:
            before, self._before = self._before, (now, rotation_matrix(now.q_wb))
            dt = -1.0 if before is None else now.time - before[0].time
            if before is None or not 0.0 < dt < _LONGEST_GAP:
                self._follows = False
                continue
            matrix = self._before[1]
            # Sines of so small a turn are its angles; in plain numbers, at each attitude.
            (_, xy, xz), (yx, _, yz), (zx, zy, _) = (before[1].T @ matrix).tolist()
            seen = 0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy)
            x, y, z = rates = now.omega.tolist()
            a, b, c = earlier = before[0].omega.tolist()
            half = 0.5 * dt
            off = seen[0] - half * (x + a), seen[1] - half * (y + b), seen[2] - half * (z + c)
            spread = half * math.dist(rates, earlier)
            down: list[float] = matrix[2].tolist()
            up = down[0] * off[0] + down[1] * off[1] + down[2] * off[2]
            turns.append(Turn(now.time, dt, self._follows, off, spread, up))
            self._follows = True
        return turns
