"""Height over ground: a rangefinder that looks down, the ground's parallax, the own altitude.

Where the own height is in doubt, as with GPS, most of a level that is not 0 is its error, and goals
move with it: drones whose heights wander, each another way, fly above each other, out of each
other's view.

The level of the ground below is a random walk: it changes with the way flown (a slope), and seems
to change with the drift of the own height. A rangefinder measures it. So do the points of the
ground that the camera sees pass by: their distance by parallax needs no height, only the own
motion (`parallax.py`). Where neither tells, the doubt grows with every second and metre.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.estimation.own_doubt import OwnDoubt
from companion.estimation.slope import Slope
from companion.perception.ground_plane import LEVEL, GroundPlane
from companion.perception.parallax import FixedPoints
from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.ids import SensorRotation
from mavlink_bridge.wire.messages import DistanceSensor, VehicleState

_SIGMA = 0.1  # m, of the ground's level where the own frame began
_SLOPE = 0.1  # m of level per √m flown: a slope of 10° within 3 m
_DRIFT = 0.02  # m per √s: the own height drifts at least so fast
_TERRAIN = 0.3  # m, 1 σ of the true ground's level around where the flight began
_WANDER_TIME = 40.0  # s in which a height wanders by what its estimator doubts
_SENSOR = 0.03  # m, where the rangefinder does not tell its error
_TILT_MIN = 0.8  # cosine of the angle beyond which the beam looks aside
_GATE = 5.0  # standard deviations; a look farther off is a bush or a neighbour below
# Such looks in a row are the ground: a step. Pictures in a row show the same corners.
_INSIST = {"range": 5, "picture": 20}
_NO_ECHO = 1  # quality of a look without an echo
_STEEP = 0.3  # sine of the angle below the horizon; flatter sight lines say little of the level
_BESIDE = 0.3  # m from the bark of a known trunk, within which a point may be the trunk's
_MOVES = 0.4  # m/s; slower, the pictures say little
_POINTS = 8  # points of the ground that make a look
_AGREE, _SHARE = 0.1, 0.4  # of the height, to which they agree; their share of all below
_LASTS = 0.7  # s for which the error of the own velocity lasts, and so that of all such looks
_SCALE = 0.06  # of the height, least error of such a look: a drone that speeds up turns, too
_NO_TRUNKS: Vector = np.zeros((0, 3))


@dataclass(frozen=True)
class Height:
    """Height over ground [m], its 1 σ [m], and the ground in the own frame.

    drift: m, how much of the ground's level is an error of the own height, and no hill.
    """

    value: float
    sigma: float
    ground: GroundPlane = LEVEL
    drift: float = 0.0


class HeightEstimator:
    """Follows the level of the ground below the drone."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the ground: the own frame has begun anew."""
        self._level, self._variance = 0.0, _SIGMA**2  # m and m², in the own frame
        self._slope = Slope()
        self._before: tuple[float, Vector] | None = None
        self._refused: dict[str, int] = {}  # looks in a row that were refused, by what looked
        self._pictured = -math.inf  # s, of the last look of the camera

    def update(
        self,
        own: VehicleState,
        looks: Iterable[DistanceSensor],
        doubt: float = 0.0,
        stands: bool = False,
    ) -> Height:
        """Return the height in state `own`, after the looks since the last tick.

        doubt: m, 1 σ of the own height as its estimator tells. stands: on the ground, disarmed:
        whatever height its estimator tells, that is the ground.
        """
        if self._before is not None:
            dt, way = own.time - self._before[0], norm((own.p - self._before[1])[:2])
            drift = max(_DRIFT**2, 2.0 * doubt**2 / _WANDER_TIME)  # m²/s
            self._variance += drift * max(dt, 0.0) + _SLOPE**2 * float(way)
            self._slope.move(float(way))
        self._before = own.time, own.p
        if stands:
            self._level, self._variance = float(own.p[2]), _SIGMA**2
        for look in looks:
            self._look(own, look, doubt)
        value = float(own.p[2]) - self._level
        drift = self._level * doubt**2 / (doubt**2 + _TERRAIN**2)
        x, y, _ = own.p.tolist()
        ground = GroundPlane(self._level, (x, y), self._slope.rise)
        return Height(value, math.sqrt(self._variance), ground, drift)

    def _look(self, own: VehicleState, look: DistanceSensor, doubt: float) -> None:
        """Correct the level by one look of a rangefinder. doubt: m, 1 σ of the own height."""
        up = rotation_matrix(own.q_wb)[:, 2].tolist()
        upright = up[2]
        heard = look.minimum < look.distance < look.maximum and look.quality != _NO_ECHO
        if look.orientation != SensorRotation.DOWN or not heard or upright < _TILT_MIN:
            return
        # In plain numbers: such looks come 50 times a second.
        dt, far, sigma = look.time - own.time, look.distance, max(look.sigma, _SENSOR)
        beam = zip(own.p.tolist(), own.v.tolist(), up, strict=True)
        x, y, z = (p + v * dt - far * u for p, v, u in beam)
        east, north = self._slope.rise
        if self._correct("range", z + far * (east * up[0] + north * up[1]), sigma):
            drift = doubt * math.sqrt(2.0 / _WANDER_TIME)
            self._slope.pass_over((x, y, z), look.time, sigma, drift)

    def see(
        self, own: VehicleState, fixed: FixedPoints, doubt: OwnDoubt, trunks: Vector = _NO_TRUNKS
    ) -> None:
        """Take in the points of a picture taken in state `own`; most of those below are ground.

        trunks (k,3): known ones, x, y, radius, m; their points are not. doubt: of the own state. A
        wrong speed scales all distances, a wrong tilt moves all levels alike: neither grows less by
        more points, the tilt's not even by more pictures.
        """
        speed = norm(own.v)
        if len(fixed.places) < _POINTS or speed < _MOVES:
            return
        rays = fixed.places - own.p
        lengths = np.maximum(np.linalg.norm(rays, axis=1), 1e-6)
        below = (rays[:, 2] < -_STEEP * lengths) & ~_on_trunks(fixed.places, trunks)
        if np.count_nonzero(below) < _POINTS:
            return
        places = fixed.places[below]
        levels = places[:, 2] - rays[below, :2] @ self._slope.rise
        ground = _alike(levels, _AGREE * float(own.p[2] - self._level))
        if ground is None:
            return
        level = float(levels[ground].mean())
        away = statistics.median(np.hypot(rays[below, 0], rays[below, 1]).tolist())  # m
        spread = statistics.median((fixed.sigmas / lengths)[below].tolist())
        scale = math.hypot(spread, doubt.velocity / speed, _SCALE)
        once = scale * (float(own.p[2]) - level)
        least = doubt.tilt * away
        dt = min(max(own.time - self._pictured, 0.02), _LASTS)
        self._pictured = own.time
        often = once * math.sqrt(2.0 * _LASTS / dt)
        if self._correct("picture", level, often, math.hypot(once, least), least):
            heights = (fixed.sigmas * -rays[:, 2] / lengths)[below][ground]
            self._slope.see(places[ground], heights, 2.0 * _LASTS / dt, doubt.tilt)

    def _correct(
        self, by: str, level: float, sigma: float, alone: float | None = None, least: float = 0.0
    ) -> bool:
        """Correct the level [m] by a look with 1 σ [m]; return whether it is believed.

        alone: m, 1 σ of this look by itself, where looks share an error. least: m, 1 σ that any
        number of looks leaves.
        """
        off, noise = level - self._level, sigma**2
        if off * off > _GATE**2 * (self._variance + (alone or sigma) ** 2):
            self._refused[by] = self._refused.get(by, 0) + 1
            if self._refused[by] < _INSIST[by]:
                return False
            self._variance = off * off
        self._refused[by] = 0
        gain = self._variance / (self._variance + noise)
        self._level += gain * off
        self._variance = max((1.0 - gain) * self._variance, min(self._variance, least**2))
        return True


def _on_trunks(places: Vector, trunks: Vector) -> NDArray[np.bool_]:
    """Return which places (n,3) may be of a trunk (k,3)."""
    off = places[:, None, :2] - trunks[:, :2]
    near = np.hypot(off[..., 0], off[..., 1]) < trunks[:, 2] + _BESIDE
    return np.asarray(near.any(axis=1))


def _alike(levels: Vector, to: float) -> NDArray[np.bool_] | None:
    """Return which levels (n,) m agree most, to so many metres.

    None where too few do: a trunk fills the picture, whose points are at any level.
    """
    agree = np.abs(levels[:, None] - levels[None]) < to
    most = agree[int(np.argmax(agree.sum(axis=1)))]
    count = np.count_nonzero(most)
    return most if count >= max(_POINTS, _SHARE * len(levels)) else None
