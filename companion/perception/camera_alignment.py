"""Camera alignment: does the picture turn as the gyro says, in direction, amount and time?

Whenever the drone turns, the rotation between two pictures (`visual_rotation.py`) is compared with
the sum of the gyro's rates between the capture times, and between times a little earlier and later.
With φ seen and E expected, both rotation vectors in the camera's frame,

    φ = s (E + δ × E)

has three unknowns worth knowing: the lag of the picture behind its stamp, the scale s (true over
assumed focal length; negative in a mirrored picture) and the angle δ by which the camera is turned
against its mount. All are found by recursive least squares for each lag of a grid; the lag with
the least misfit is the picture's. Too little turning, and nothing is said.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from companion.perception.ground_plane import LEVEL, GroundPlane
from companion.perception.reduced import Grey, Reduced
from companion.perception.view import View
from companion.perception.visual_rotation import VisualGyro
from mavlink_bridge.shared.arrays import Vector, cross, norm
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import VehicleState

_TRIED = 0.0125  # s between two lags that are tried: at a wrong one the turns look smaller
_LAGS = np.arange(-0.25, 0.3001, _TRIED)  # s, picture behind its stamp
_LEAST_TURN = 0.02  # rad from picture to picture, below which noise is all that there is
_STEP = 0.02  # s, of the sum over the gyro's rates
_LATE = 0.1  # s by which telemetry may be late: rates from longer ago do not change any more
_LONGEST = 0.25  # s between two pictures that are compared
_LEAST_PAIRS = 4.0
_PAIRS_AGAINST = 8.0  # pairs from which a contradiction is told
# rad/m of own way: what near things move, of which the visual gyro leaves a part; from turn to turn
# alike, so that many turns tell little more than one.
_PARALLAX = 0.2
_LOW = 0.5  # m over the ground, below which nearly all that is seen is near
_SURPRISE, _IN_A_ROW = 0.5, 2  # share of the turn, and turns, from which the camera has moved
_KEEP = 0.97  # of the evidence, from one pair of pictures to the next
_FLOOR, _SHARE = 0.002, 0.03  # rad, and share of the turn: errors of attitude and tracking
_NOISE_PRIOR = 12.0  # components; in so few the sigma of a turn is believed, later their misfit
_PRIOR = np.array([0.5, 0.5, 0.5, 0.5]) ** -2.0  # information on s − 1 and δ [rad] before any look
_SIGMAS = 3.0  # a finding differs from none by so many standard deviations
# A lens that was as configured does not change little by little; the vehicle's attitude may.
_SETTLED = 2.0
_SCALE, _ANGLE = 0.06, math.radians(6.0)  # findings smaller than this fly well
_MEASURES = 0.03  # 1 σ of the scale, beyond which a focal length is not yet checked
_LAG_FLOOR = 0.007  # s; the parabola through the grid is no better
_LAG_SIGMA = 0.02  # s; a less certain lag is not used
_LAG_USED = 0.02  # s; smaller lags are within the stamps' own errors
_LAG_PRIOR = 0.05  # s, 1 σ before any look
_SPARE = (2, 8)  # once all is known, so many pictures of so many are looked at
_KNOWN = (0.01, 0.02, 0.08)  # 1 σ of lag [s], scale and angles [rad] below which all is known
_LAG_FLOWN = 0.2  # s; a picture later than this shows what was

StateAt = Callable[[float], VehicleState | None]


@dataclass(frozen=True)
class Alignment:
    """What the turns so far tell of the camera; a 1 σ is infinite where they do not tell.

    lag: s, of the picture behind its stamp, 0 where too small to matter. scale: true over assumed
    focal length. tilt: rad, rotation vector (3,) of the camera against its mount, camera frame.
    sigmas: 1 σ of lag, scale and the angles. contradiction: in words; empty where all is well.
    """

    lag: float = 0.0
    scale: float = 1.0
    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sigmas: tuple[float, float, float] = (math.inf, math.inf, math.inf)
    contradiction: str = ""

    @property
    def measures(self) -> bool:
        """Tell whether the focal length is known well enough to measure motion in the picture."""
        near = abs(self.scale - 1.0) < _SCALE and self.sigmas[1] < _MEASURES
        return near and not self.contradiction


@dataclass(frozen=True)
class _Shot:
    """A picture taken at `time` [s], reduced."""

    time: float
    grey: Grey


@dataclass(frozen=True)
class _Turn:
    """A rotation seen between the pictures stamped `start` and `end` [s]."""

    start: float
    end: float
    vector: Vector
    sigma: float


class CameraAlignment:
    """Compares the pictures of one camera with the vehicle's attitude, turn by turn."""

    def __init__(self, view: View) -> None:
        self._view = view
        self._gyro = VisualGyro(view.camera)
        self._before: _Shot | None = None
        self._frames = 0
        self._waiting: deque[_Turn] = deque(maxlen=8)
        self._surprises = 0
        self._rates: dict[int, Vector] = {}  # rad/s, by the step at which they were
        self.estimate = Alignment()
        self._forget()

    def _forget(self) -> None:
        """Start the evidence anew; the estimate stays until there is another."""
        n = len(_LAGS)
        self._information = np.zeros((n, 4, 4))
        self._weighted = np.zeros((n, 4))
        self._squares = np.zeros(n)
        self._pairs = 0.0
        self._surprises = 0
        self._fits = True  # the last turn fits what was known
        self._settled = False

    def update(
        self,
        time: float,
        stamp: float,
        picture: Reduced,
        at: StateAt,
        ground: GroundPlane = LEVEL,
        wander: float = 0.0,
    ) -> None:
        """Take in a picture, stamped `stamp` [s], at a tick's `time`.

        at: returns the own state at a time [s] of the last second. wander: m/√s, 1 σ of
        the error of the reported way, a random walk.
        """
        # The attitude after a capture is known a little later.
        while self._waiting and self._waiting[0].end - _LAGS[0] <= time:
            self._learn(self._waiting.popleft(), time, at)
        if self._before is not None and stamp <= self._before.time:
            return
        self._frames += 1
        spare = self._pairs >= _PAIRS_AGAINST and self._known
        if spare and self._frames % _SPARE[1] >= _SPARE[0]:
            return
        shot = _Shot(stamp, self._gyro.reduce(picture))
        before, self._before = self._before, shot
        if before is not None and 0.0 < stamp - before.time < _LONGEST:
            self._compare(before, shot, at, ground, wander)

    @property
    def _known(self) -> bool:
        return self._fits and not self.estimate.contradiction and _sure(self.estimate.sigmas)

    def _compare(
        self, before: _Shot, after: _Shot, at: StateAt, ground: GroundPlane, wander: float
    ) -> None:
        """Measure the rotation between two pictures, where the drone turned around that time."""
        then, now = at(before.time), at(after.time)
        if then is None or now is None:
            return
        height = ground.under(now.p)
        if height < _LOW:
            return
        turning = max(norm(s.omega) for s in (then, now))
        if turning * (after.time - before.time) < _LEAST_TURN:
            return
        moved = self._view.to_camera(now, (now.p - then.p)[None])[0]
        seen = self._gyro.rotation(before.grey, after.grey, moved)
        if seen is not None:
            # Near the ground, as in take-off, all that is seen is near.
            near = min(height, 1.0) ** 2
            unknown = wander * math.sqrt(after.time - before.time) / height
            sigma = math.hypot(seen.sigma, _PARALLAX / near * norm(moved), unknown)
            self._waiting.append(_Turn(before.time, after.time, seen.vector, sigma))

    def _learn(self, turn: _Turn, time: float, at: StateAt) -> None:
        """Add a turn to the evidence for each lag, at a tick's `time`."""
        e = self._expected(turn, time, at)
        if e is None:
            return
        sigma = math.hypot(turn.sigma, _FLOOR, _SHARE * norm(turn.vector))
        if self._surprising(turn, e, sigma):
            self._forget()
        rows = np.concatenate([e[:, :, None], -_crosses(e)], axis=2) / sigma
        off = (turn.vector - e) / sigma
        self._information = _KEEP * self._information + np.einsum("lij,lik->ljk", rows, rows)
        self._weighted = _KEEP * self._weighted + np.einsum("lij,li->lj", rows, off)
        self._squares = _KEEP * self._squares + np.einsum("li,li->l", off, off)
        self._pairs = _KEEP * self._pairs + 1.0
        self.estimate = self._estimate()

    def _surprising(self, turn: _Turn, expected: Vector, sigma: float) -> bool:
        """Return whether turn after turn is far from the estimate: the camera has moved."""
        known = self._pairs >= _PAIRS_AGAINST
        nearest = expected[int(np.argmin(np.abs(_LAGS - self.estimate.lag)))]
        tilted = nearest + cross(np.array(self.estimate.tilt), nearest)
        error = norm(turn.vector - self.estimate.scale * tilted)
        self._fits = error < _SIGMAS * sigma
        self._surprises = (self._surprises + 1) * int(
            known and error > max(_SURPRISE * norm(nearest), 2.0 * _SIGMAS * sigma)
        )
        return self._surprises >= _IN_A_ROW

    def _expected(self, turn: _Turn, time: float, at: StateAt) -> Vector | None:
        """Return the camera's rotation vectors (n,3), by the gyro, for each lag of the picture.

        Not by the attitude: the errors of an attitude that GPS corrects do not turn with the drone.
        """
        first = math.floor((turn.start - _LAGS[-1]) / _STEP)
        last = math.ceil((turn.end - _LAGS[0]) / _STEP)
        rates = self._rates_between(first, last, time, at)
        if rates is None:
            return None
        # The turn is small: rates may be added up.
        w = rates @ rotation_matrix(self._view.mount)
        sums = np.zeros_like(w)
        np.cumsum(0.5 * _STEP * (w[1:] + w[:-1]), axis=0, out=sums[1:])
        place = (np.array([[turn.end], [turn.start]]) - _LAGS) / _STEP - first
        before = np.minimum(place.astype(np.intp), last - first - 1)
        share = (place - before)[..., None]
        late, early = sums[before] + share * (sums[before + 1] - sums[before])
        return np.asarray(late - early)

    def _rates_between(self, first: int, last: int, time: float, at: StateAt) -> Vector | None:
        """Return the gyro's rates (n,3) [rad/s, body frame] at steps first…last, each asked once.

        None where not all are known. Those that telemetry may tell anew are asked again.
        """
        kept, self._rates = self._rates, {}
        rates = []
        for step in range(first, last + 1):
            rate = kept.get(step)
            if rate is None:
                state = at(step * _STEP)
                if state is None:
                    return None
                rate = state.omega
            if step * _STEP < time - _LATE:
                self._rates[step] = rate
            rates.append(rate)
        return np.array(rates)

    def _estimate(self) -> Alignment:
        """Return what the evidence tells."""
        if self._pairs < _LEAST_PAIRS:
            return self.estimate
        information = self._information + np.diag(_PRIOR)
        solution = np.asarray(np.linalg.solve(information, self._weighted[..., None])[..., 0])
        misfit = self._squares - np.einsum("lj,lj->l", solution, self._weighted)
        freedom = 3.0 * self._pairs - 4.0
        lag, lag_sigma, best = _minimum(misfit, freedom)
        noise = _noise(float(misfit[best]), freedom)
        covariance = np.linalg.inv(information[best]) * noise
        found, per_second = _between(solution, lag, best)
        # While the drone begins to turn, a picture dated wrongly looks like one of another scale.
        deviation = np.hypot(np.sqrt(np.diag(covariance)), per_second * min(lag_sigma, _TRIED))
        scale = 1.0 + float(found[0])
        x, y, z = (float(a) / max(abs(scale), 0.2) for a in found[1:])
        sigmas = (lag_sigma, float(deviation[0]), float(deviation[1:].max()))
        likely = lag / (1.0 + (lag_sigma / _LAG_PRIOR) ** 2)
        used = likely if abs(likely) > _LAG_USED else 0.0
        # No number of turns averages out an error that they share, as of a gyro that is late.
        shared = deviation / math.sqrt(min(noise, 1.0))
        text = _contradiction(
            scale, np.array([x, y, z]), shared, _SETTLED if self._settled else 1.0
        )
        if self._pairs < _PAIRS_AGAINST:
            text = self.estimate.contradiction
        elif not text and lag_sigma < _LAG_SIGMA and lag > _LAG_FLOWN:
            text = f"pictures show what was {lag:.2f} s before their stamps"
        sure = _sure(sigmas)
        if not text and not sure:  # a contradiction ends by evidence, not for want of it
            text = self.estimate.contradiction
        settled = sure and not text and sigmas[2] < _ANGLE / _SIGMAS
        self._settled |= settled and self._pairs >= _PAIRS_AGAINST
        return Alignment(used if lag_sigma < _LAG_SIGMA else 0.0, scale, (x, y, z), sigmas, text)


def _sure(sigmas: tuple[float, float, float]) -> bool:
    return all(s < known for s, known in zip(sigmas, _KNOWN, strict=True))


def _contradiction(scale: float, tilt: Vector, deviation: Vector, slack: float) -> str:
    """Return in words how the picture contradicts the gyro; empty where it does not.

    slack: factor on what is let pass.
    """
    if scale < -_SIGMAS * deviation[0]:
        return "the picture turns against the gyro: mirrored or upside down"
    if abs(scale - 1.0) > max(slack * _SCALE, _SIGMAS * deviation[0]):
        return (
            f"the picture turns {scale:.2f} times as far as the gyro says: the focal length is "
            f"{scale:.2f} times the configured one"
        )
    if (np.abs(tilt) > np.maximum(slack * _ANGLE, _SIGMAS * deviation[1:])).any():
        angle = math.degrees(norm(tilt))
        return f"the picture turns about another axis: the camera is {angle:.0f}° off its mount"
    return ""


def _minimum(misfit: Vector, freedom: float) -> tuple[float, float, int]:
    """Return the lag [s] of least misfit, its 1 σ [s], and the index of the nearest lag tried."""
    best = int(np.argmin(misfit))
    if not 0 < best < len(_LAGS) - 1:
        return float(_LAGS[best]), math.inf, best
    left, middle, right = misfit[best - 1 : best + 2].tolist()
    step = _TRIED
    bend = left - 2.0 * middle + right
    if bend <= 0.0:
        return float(_LAGS[best]), math.inf, best
    lag = float(_LAGS[best]) + 0.5 * step * (left - right) / bend
    noise = _noise(middle, freedom)
    return lag, math.hypot(_LAG_FLOOR, step * math.sqrt(2.0 * noise / bend)), best


def _noise(misfit: float, freedom: float) -> float:
    """Return the square error of a turn as a share of what its sigma says."""
    return (misfit + _NOISE_PRIOR) / (freedom + _NOISE_PRIOR)


def _between(solution: Vector, lag: float, best: int) -> tuple[Vector, Vector]:
    """Return the solution (4,) at `lag` [s], and how fast (4,) it changes with the lag [1/s].

    solution: (n,4), at each lag tried. best: index of the nearest of them.
    """
    side = best + 1 if lag > _LAGS[best] else best - 1
    side = min(max(side, 0), len(_LAGS) - 1)
    if side == best:
        return solution[best], np.zeros(4)
    per_second = (solution[side] - solution[best]) / float(_LAGS[side] - _LAGS[best])
    return solution[best] + per_second * (lag - float(_LAGS[best])), per_second


def _crosses(vectors: Vector) -> Vector:
    """Return the matrices (n,3,3) of v × for vectors (n,3)."""
    matrices = np.zeros((len(vectors), 9))
    matrices[:, [5, 6, 1]] = -vectors
    matrices[:, [7, 2, 3]] = vectors
    return matrices.reshape(-1, 3, 3)
