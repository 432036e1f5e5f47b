"""Tracker: from detections to neighbours with position, velocity and covariance, own ENU frame.

Each neighbour has two Kalman filters: in one it keeps its velocity, in the other it manoeuvres
(`motion_modes`); all filters are kept as arrays. Detections are associated by Mahalanobis distance
(Hungarian method). Of each track the odds are kept that there is such a neighbour: looks that see
it raise them, looks at its place that do not lower them. A track ends when they are spent, or when
its covariance is so large that the memory says nothing any more. Where neighbours differ in size,
the size is part of the track (`track_size`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from companion.estimation import track_size
from companion.estimation.assignment import assign
from companion.estimation.existence import CONFIRMED, SUREST
from companion.estimation.motion_modes import MANOEUVRES, Modes
from companion.estimation.tracker_config import TrackerConfig
from companion.estimation.turns import turn_about
from companion.types import Detection, Track
from mavlink_bridge.shared.arrays import Vector, lengths, squares
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.wire.messages import VehicleState

_FADE_AFTER = 0.15  # s unseen in the frames that came: more than a tick
_FRAME_AGE_MAX = 0.25  # s without a frame during which no neighbour counts as out of sight
_STALE_AFTER = 0.5  # s unseen, after which the place of a neighbour is a guess
# How much of a sign a look is that is not clear; a clear one is 1. Of the finds to 6 m in eight
# recorded flights 8.5 clear ones were right for each wrong one, and 1.5 of the others. So 0.4 would
# be fair if each told something new; but false ones come in runs.
_UNCLEAR = 0.3
_AS_EXPECTED = 3.0  # squared distance of a look from where a track is expected, in its doubt: mean
_IDENTITY = np.eye(3)
_STAYS, _MOVES = np.eye(6), np.eye(6, k=3)  # of (p, v) from (p, v): 1, and p from v
_IS_MOVED, _SPEEDS_UP = np.eye(6, 3), np.eye(6, 3, k=-3)  # p and v from the acceleration


class Tracker:
    """Tracks neighbours as arrays: their states in both modes, see `Modes`; ids, births, odds.

    A state is p, v (6,); where sizes are unknown, it is that of `track_size` (7,).

    known: how many detections of the newest frame are of tracks that were confirmed before it.
    """

    def __init__(self, config: TrackerConfig) -> None:
        self._config = config
        self.known = 0
        self._time: float | None = None
        self._looked = -np.inf
        self._next_id = 1
        self._sized = config.size_sigma > 0.0
        states = track_size.STATES if self._sized else 6
        self._modes = Modes.none(states)
        self._ids = np.zeros(0, dtype=int)
        self._born: Vector = np.zeros(0)
        self._seen: Vector = np.zeros(0)
        self._odds: Vector = np.zeros(0)  # log of the odds that there is such a neighbour
        self._confirmed = np.zeros(0, dtype=bool)
        self._along: Vector = np.zeros(0)  # share of the own velocity to which theirs fade
        self._own_velocity: Vector = np.zeros(3)
        self._last = (-np.inf, self._modes)  # as after the last frame
        self._noise = np.array([config.drift, config.acceleration])  # of each mode
        self._rates = np.array([1.0 / config.keeps_on, 1.0 / config.manoeuvres])
        self._hit = math.log(config.detected / config.ghosts)

    def update(
        self,
        time: float,
        detections: Sequence[Detection],
        own: VehicleState,
        q_bc: Vector,
        in_view: Sequence[bool] | None = None,
        partly: bool = False,
    ) -> None:
        """Take in the detections of one frame, captured at `time` [s] in the own state `own`.

        q_bc: (4,) camera → body. in_view: whether a neighbour at each of `positions` would show;
        None: unknown. partly: whether only those of `lately` were looked for.
        """
        self.predict(time)
        self._looked = time
        z, r = self._measurements(detections, own, q_bc)
        clear = np.array([d.sigma_range <= self._config.clear * d.range for d in detections], bool)
        assigned = self._associate(z, r, clear, own.p)
        self.known = sum(bool(self._confirmed[track]) for track, _ in assigned)
        if in_view is not None:
            looked = np.array(in_view, bool).reshape(2, -1) & ~(partly & self._stale)
            self._miss(looked, [track for track, _ in assigned])
        if assigned:
            track, looks = (np.array(ids) for ids in zip(*assigned, strict=True))
            lasting = np.array([d.lasting for d in detections])
            self._correct(track, z[looks], r[looks], own.p, lasting[looks])
            self._seen[track] = time
            # A look without a search leans on what the last search said: it is half as good a sign.
            sign = np.where(clear[looks], 1.0, _UNCLEAR)
            self._odds[track] += sign * (0.5 if partly else 1.0) * self._hit
            self._odds = np.minimum(self._odds, SUREST)
            self._confirmed |= self._odds >= CONFIRMED
        mean, covariance = self._modes.mixture()
        if assigned:
            off = lengths(self._velocities(mean)[track] - own.v)
            self._along[track] = np.exp(-((off / self._config.along) ** 2))
        self._own_velocity = own.v
        fresh = sorted(set(range(len(z))) - {d for _, d in assigned})
        self._end_tracks(time, mean, covariance)
        for detection in fresh:
            self._start_track(time, z[detection], r[detection], own.p)
        self._last = (time, self._modes.copy())

    def _miss(self, in_view: NDArray[np.bool_], seen: list[int]) -> None:
        """Note the tracks that were looked for and not seen; in_view: (2,n), by mode."""
        missed = in_view.astype(float)
        missed[:, seen] = 0.0
        if not missed.any():
            return
        shows = (self._modes.weight * missed).sum(axis=0)
        self._odds += np.log(1.0 - self._config.detected * shows)
        self._modes.weigh(np.arange(len(self._ids)), np.log(1.0 - self._config.detected * missed))

    def predict(self, time: float) -> None:
        """Carry all tracks to `time` [s]; their covariance grows.

        A neighbour keeps its velocity, eq. (14); where it manoeuvres out of sight, that fades, see
        `damping`.
        """
        self._rewind(time)
        dt = 0.0 if self._time is None else time - self._time
        self._time = time
        if dt == 0.0 or not len(self._ids):
            return
        if dt < 0.0:
            self._modes.mean[:, :3] += dt * self._modes.mean[:, 3:6]
            return
        self._modes.mix(1.0 - np.exp(-dt * self._rates))
        # A neighbour abeam in formation keeps the own velocity, or it would fall back in memory.
        fading = time - min(time - self._looked, _FRAME_AGE_MAX) - self._seen > _FADE_AFTER
        keep = np.ones((2, len(fading)))
        keep[MANOEUVRES, fading] = math.exp(-self._config.damping * dt)
        to = self._along[:, None] * self._own_velocity
        to = np.concatenate([to, to])
        self._carry(dt, keep.ravel(), to, self._noise.repeat(len(fading)))

    def _carry(self, dt: float, keep: Vector, to: Vector, sigma: Vector) -> None:
        """Carry both modes of all tracks on by dt [s].

        keep: (2n,) share of the velocity's difference from `to` (2n,3) that is left. sigma: (2n,)
        m/s², 1 σ of the acceleration.
        """
        mean, c = self._modes.mean, self._modes.covariance
        if self._sized:
            c[:] = track_size.grow(mean, c, dt, keep, to, sigma)
            to = to * mean[:, 6:]
        mean[:, :3] += dt * mean[:, 3:6]
        mean[:, 3:6] = to + keep[:, None] * (mean[:, 3:6] - to)
        if self._sized:
            return
        step = np.empty(c.shape)
        step[:] = _STAYS + dt * _MOVES
        step[:, 3:] *= keep[:, None, None]
        jolt = dt * _SPEEDS_UP + 0.5 * dt * dt * _IS_MOVED
        c[:] = step @ c @ step.mT + (sigma * sigma)[:, None, None] * (jolt @ jolt.T)

    def turn(self, p: Vector, angle: float) -> None:
        """Turn all tracks left about p (3,) m by a small `angle` [rad]."""
        for modes in (self._modes, self._last[1]):
            mean = modes.mean
            scale = mean[:, 6:] if self._sized else np.ones((len(mean), 1))
            places = mean[:, :3] / scale
            turn_about(places, p, angle)
            mean[:, :3] = places * scale
            turn_about(mean[:, 3:6], np.zeros(3), angle)

    def _rewind(self, time: float) -> None:
        """Go back to the last frame where `time` [s] lies between it and the last tick.

        Otherwise the covariance would grow, and the velocity fade, with every frame that is older
        than the tick before it.
        """
        if self._time is not None and self._last[0] <= time < self._time:
            self._time, self._modes = self._last[0], self._last[1].copy()

    def tracks(self) -> list[Track]:
        """Return the confirmed tracks, oldest first."""
        return self._tracks(self._confirmed)

    def lately(self) -> list[Track]:
        """Return the tracks whose place is no guess, unconfirmed ones, too, oldest first."""
        return self._tracks(~self._stale)

    def _tracks(self, which: NDArray[np.bool_]) -> list[Track]:
        time = self._time or 0.0
        modes = self._modes if which.all() else self._modes.kept(which)
        mean, covariance = modes.mixture()
        scales = np.ones(len(mean))
        if self._sized:
            scales = 1.0 / mean[:, 6]
            mean, covariance = track_size.in_world(mean, covariance)
        columns = (
            self._ids[which].tolist(),
            mean[:, :3],
            mean[:, 3:],
            covariance,
            (time - self._born[which]).tolist(),
            (time - self._seen[which]).tolist(),
            scales.tolist(),
            self._confirmed[which].tolist(),
        )
        return [Track(*row) for row in zip(*columns, strict=True)]

    def courses(self) -> tuple[list[int], Vector, Vector]:
        """Return ids, places (n,3) m and velocities (n,3) m/s of the confirmed tracks.

        They are those of `tracks`, which also makes covariances.
        """
        mean = self._modes.means()[self._confirmed]
        places = mean[:, :3] / mean[:, 6:] if self._sized else mean[:, :3]
        return self._ids[self._confirmed].tolist(), places, self._velocities(mean)

    def positions(self) -> Vector:
        """Return where neighbours may be, unconfirmed ones too: (2n,3) m, a row for each mode.

        First all as if they kept on, then the same ones as if they manoeuvred.
        """
        mean = self._modes.mean
        return mean[:, :3] / mean[:, 6:] if self._sized else mean[:, :3].copy()

    def sigmas(self) -> Vector:
        """Return 1 σ [m] of each of `positions` along an axis, in the mean of the three (2n,)."""
        c, mean = self._modes.covariance, self._modes.mean
        scale = mean[:, 6] if self._sized else 1.0
        return np.asarray(np.sqrt(np.maximum(_traces(c), 0.0) / 3.0) / scale)

    def _velocities(self, mean: Vector) -> Vector:
        """Return (m,3) m/s of tracks of such means (m,k)."""
        return mean[:, 3:6] / mean[:, 6:] if self._sized else mean[:, 3:]

    @property
    def _stale(self) -> NDArray[np.bool_]:
        """(n,) whether a neighbour has been unseen for so long that its place is a guess."""
        stale: NDArray[np.bool_] = (self._time or 0.0) - self._seen > _STALE_AFTER
        return stale

    def _measurements(
        self, detections: Sequence[Detection], own: VehicleState, q_bc: Vector
    ) -> tuple[Vector, Vector]:
        """Return the detections' positions (m,3) [m; own ENU frame] and covariances (m,3,3)."""
        if not detections:
            return np.zeros((0, 3)), np.zeros((0, 3, 3))
        r_wc = rotation_matrix(own.q_wb) @ rotation_matrix(q_bc)
        rays = np.array([d.direction for d in detections]) @ r_wc.T
        ranges = np.array([d.range for d in detections])
        bearing = np.array([d.sigma_bearing for d in detections])
        along = np.array([d.sigma_range for d in detections]) ** 2
        across = (ranges * np.hypot(bearing, self._config.attitude_sigma)) ** 2
        outer = rays[:, :, None] * rays[:, None, :]
        covariance = (along - across)[:, None, None] * outer + across[:, None, None] * _IDENTITY
        return own.p + rays * ranges[:, None], covariance

    def _expected(
        self, mean: Vector, covariance: Vector, here: Vector
    ) -> tuple[Vector, Vector, Vector]:
        """Return where detections from here (3,) show tracks of such means and covariances.

        That place (n,3), its covariance with the states (n,3,k) and with itself (n,3,3).
        """
        if not self._sized:
            return mean[:, :3], covariance[:, :3, :], covariance[:, :3, :3]
        at, slope = track_size.seen_from(mean, here)
        across = slope @ covariance
        return at, across, across @ slope.T

    def _associate(
        self, z: Vector, r: Vector, clear: NDArray[np.bool_], here: Vector
    ) -> list[tuple[int, int]]:
        """Return the (track, detection) pairs within the gate of least total distance.

        A look that is not clear says little of the range, a stale track little of the bearing: the
        two are never paired, or a ghost would come up between them. Nor are a look and a track that
        are in different directions: where neither says much of the range both fit the place that
        all directions share, which is the own one.
        """
        if not len(z) or not len(self._ids):
            return []
        at, _, spread = self._expected(*self._modes.mixture(), here)
        residual = z[None] - at[:, None]
        # No variance is larger than the trace: what is out of the gate by that is out of it.
        most = _traces(spread)[:, None] + _traces(r)
        fits = squares(residual) < self._config.gate * most
        fits &= clear | ~self._stale[:, None]
        fits &= self._in_line(at - here, spread, z - here, r)
        track, look = fits.nonzero()
        off, s = residual[track, look][..., None], spread[track] + r[look]
        cost = (off * np.linalg.solve(s, off)).sum(axis=(1, 2))
        fits[track, look] = near = cost < self._config.gate
        if fits.sum(axis=0).max() <= 1 and fits.sum(axis=1).max() <= 1:  # there is no choice
            pairs = fits.nonzero()
            return list(zip(pairs[0].tolist(), pairs[1].tolist(), strict=True))
        # log det S keeps a track of large covariance from taking the detection of a sure track
        score = np.full(fits.shape, 1e3)
        score[track[near], look[near]] = (cost + np.linalg.slogdet(s)[1])[near]
        return [pair for pair in assign(score) if score[pair] < 1e3]

    def _in_line(self, at: Vector, spread: Vector, z: Vector, r: Vector) -> NDArray[np.bool_]:
        """Return (n,m) whether tracks at (n,3) m from here and looks at z (m,3) may be in line.

        spread (n,3,3), r (m,3,3): their covariances, of which only what is across their own
        directions counts.
        """
        track, look = lengths(at), lengths(z)
        ray, line = at / np.maximum(track, 1e-6)[:, None], z / look[:, None]
        doubt = (_across(spread, ray) / np.maximum(track, 1e-6) ** 2)[:, None]
        doubt = doubt + _across(r, line) / look**2
        angle = np.arccos(np.clip(ray @ line.T, -1.0, 1.0))
        return np.asarray(angle**2 < self._config.gate * doubt)

    def _correct(
        self, n: NDArray[np.int_], z: Vector, r: Vector, here: Vector, lasting: Vector
    ) -> None:
        """Correct tracks n (m,) by positions z (m,3) of covariance r (m,3,3), seen from here (3,).

        lasting: (m,) share of the variance of the range that the next looks share: how it changes
        says nothing of the velocity. Nor does it where a stale track is seen again somewhere else.
        """
        means, covariances = self._modes.mean, self._modes.covariance
        ray = (z - here) / lengths(z - here)[:, None]
        tells = _IDENTITY - lasting[:, None, None] * ray[:, :, None] * ray[:, None]
        stale = np.tile(self._stale[n], 2)
        n = np.concatenate([n, n + len(self._ids)])  # both modes
        z, r, tells = (np.concatenate([a, a]) for a in (z, r, tells))
        mean, p = means[n], covariances[n]
        at, across, spread = self._expected(mean, p, here)
        s, off = spread + r, (z - at)[..., None]
        solved = np.linalg.solve(s, np.concatenate([across, off], axis=2))
        distance = (off * solved[..., -1:]).sum(axis=(1, 2))
        tells[stale & (distance > _AS_EXPECTED)] = 0.0
        gain = solved[..., :-1].mT
        gain[:, 3:6] = gain[:, 3:6] @ tells
        mean += (gain @ off)[..., 0]
        if self._sized:
            mean = track_size.bounded(mean)
        speed = lengths(self._velocities(mean))[:, None]
        mean[:, 3:6] *= np.minimum(1.0, self._config.speed_max / np.maximum(speed, 1e-9))
        less = gain @ across
        # Half of it and half of its transpose: rounding errors would grow until one is negative.
        corrected = 0.5 * p - less + 0.5 * gain @ s @ gain.mT  # of any gain
        means[n], covariances[n] = mean, corrected + corrected.mT
        fit = -0.5 * (distance + np.linalg.slogdet(s)[1])
        self._modes.weigh(n[: len(n) // 2], fit.reshape(2, -1))

    def _start_track(self, time: float, z: Vector, r: Vector, here: Vector) -> None:
        """Start a track at rest at z (3,) of covariance r (3,3), seen from here (3,)."""
        c = self._config
        mean, covariance = np.concatenate([z, np.zeros(3)]), np.zeros((6, 6))
        covariance[:3, :3] = r
        covariance[3:, 3:] = np.eye(3) * c.velocity_birth**2
        if self._sized:
            mean, covariance = track_size.birth(z, r, here, c.velocity_birth, c.size_sigma)
        self._modes.add(mean, covariance)
        self._ids = np.append(self._ids, self._next_id)
        self._born = np.append(self._born, time)
        self._seen = np.append(self._seen, time)
        self._odds = np.append(self._odds, 0.0)
        self._confirmed = np.append(self._confirmed, False)
        self._along = np.append(self._along, 0.0)
        self._next_id += 1

    def _end_tracks(self, time: float, mean: Vector, p: Vector) -> None:
        """Drop the tracks of what is unlikely to be there, or may be anywhere.

        Out of view the odds that still count fall with time. mean (n,k), p (n,k,k): of all tracks.
        """
        c = self._config
        sigma = np.sqrt(p[:, 0, 0] + p[:, 1, 1] + p[:, 2, 2])
        if self._sized:
            sigma = track_size.sigma_of_known_size(mean, p)
        known = self._odds >= SUREST / c.unseen_max * (time - self._seen)
        keep = known & (sigma < c.sigma_max)
        if keep.all():
            return
        self._modes = self._modes.kept(keep)
        self._ids, self._born = self._ids[keep], self._born[keep]
        self._seen, self._odds = self._seen[keep], self._odds[keep]
        self._confirmed, self._along = self._confirmed[keep], self._along[keep]


def _across(covariances: Vector, rays: Vector) -> Vector:
    """Return the variances (n,) across unit rays (n,3), in the mean of all such directions."""
    along = (rays[:, None] @ covariances @ rays[..., None])[:, 0, 0]
    return np.asarray(0.5 * (_traces(covariances) - along))


def _traces(matrices: Vector) -> Vector:
    """Return the traces (n,) of matrices (n,3,3), sooner than numpy does."""
    return np.asarray(matrices[:, 0, 0] + matrices[:, 1, 1] + matrices[:, 2, 2])
