"""Tracker: from detections to neighbours with position, velocity and covariance, own ENU frame.

Each neighbour has a constant-velocity Kalman filter; all filters are kept as arrays. Detections
are associated by Mahalanobis distance (Hungarian method). A track is confirmed after two looks. It
ends when the neighbour should be in plain view and is not seen, or when its covariance is so large
that the memory says nothing any more. Where neighbours differ in size, the size is part of the
track (`track_size`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from companion.estimation import track_size
from companion.estimation.assignment import assign
from companion.estimation.turns import turn_about
from companion.types import Detection, Track
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import rotation_matrix
from mavlink_bridge.shared.settings import StrictModel
from mavlink_bridge.wire.messages import VehicleState


class TrackerConfig(StrictModel):
    """Numbers of the tracker, each with its reason."""

    acceleration: float = Field(
        1.5, gt=0, description="Std of a neighbour's acceleration [m/s²]; the NMPC uses ±2."
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
    hits_to_confirm: int = Field(2, ge=1, description="Clear looks before a neighbour counts.")
    clear: float = Field(
        0.2, gt=0, description="Std of range, as a share of it, up to which a look is clear."
    )
    life_per_look: float = Field(
        0.4,
        gt=0,
        description="Memory [s] out of view for each look: a ghost of few looks ends soon.",
    )
    misses_to_drop: int = Field(
        4,
        ge=1,
        description="Looks in a row at a neighbour's place without seeing it that end its track; "
        "fewer where the neighbour itself was seen in fewer.",
    )
    unseen_max: float = Field(4.0, gt=0, description="Longest memory [s] out of view.")
    sigma_max: float = Field(3.0, gt=0, description="Std of position [m] that ends a track.")
    damping: float = Field(
        0.7,
        ge=0,
        description="Rate [1/s] at which the velocity of an unseen neighbour fades: to the own "
        "velocity where it flew along, else to rest, see `along`. Near others every drone slows "
        "down, and a track that flew on in memory would leave the neighbour's place free.",
    )
    speed_max: float = Field(
        3.0,
        gt=0,
        description="Highest speed of a track [m/s]. A neighbour that comes out from behind "
        "another shows wider look by look, as if it approached at 6 m/s.",
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


_FADE_AFTER = 0.15  # s unseen in the frames that came: more than a tick
_FRAME_AGE_MAX = 0.25  # s without a frame during which no neighbour counts as out of sight
_STALE_AFTER = 0.5  # s unseen, after which the place of a neighbour is a guess
_IDENTITY = np.eye(3)
_NOWHERE = np.zeros(3)


class Tracker:
    """Tracks neighbours as arrays: mean (n,6) of p, v; covariance (n,6,6); ids, births, looks.

    Where sizes are unknown, mean (n,7) and covariance (n,7,7) are as in `track_size`.
    """

    def __init__(self, config: TrackerConfig) -> None:
        self._config = config
        self._time: float | None = None
        self._looked = -np.inf
        self._next_id = 1
        self._sized = config.size_sigma > 0.0
        states = track_size.STATES if self._sized else 6
        self._mean: Vector = np.zeros((0, states))
        self._covariance: Vector = np.zeros((0, states, states))
        self._ids = np.zeros(0, dtype=int)
        self._born: Vector = np.zeros(0)
        self._seen: Vector = np.zeros(0)
        self._hits = np.zeros(0, dtype=int)
        self._misses = np.zeros(0, dtype=int)
        self._along: Vector = np.zeros(0)  # share of the own velocity to which theirs fade
        self._own_velocity: Vector = np.zeros(3)
        self._last = (-np.inf, self._mean, self._covariance)  # as after the last frame
        self._noise = config.acceleration**2 * _IDENTITY
        self._identity = np.eye(states)

    def update(
        self,
        time: float,
        detections: Sequence[Detection],
        own: VehicleState,
        q_bc: Vector,
        in_view: Sequence[bool] | None = None,
    ) -> None:
        """Take in the detections of one frame, captured at `time` [s] in the own state `own`.

        q_bc: (4,) camera → body. in_view: whether each track should be visible, in the order of
        `positions`; None: unknown.
        """
        self.predict(time)
        self._looked = time
        z, r = self._measurements(detections, own, q_bc)
        clear = np.array([d.sigma_range <= self._config.clear * d.range for d in detections], bool)
        assigned = self._associate(z, r, clear, own.p)
        if in_view is not None:
            self._misses += np.asarray(in_view, bool)
        if assigned:
            track, looks = (np.array(ids) for ids in zip(*assigned, strict=True))
            self._correct(track, z[looks], r[looks], own.p)
            self._seen[track] = time
            self._hits[track] += clear[looks]
            self._misses[track] = 0
            off = np.linalg.norm(self._velocities[track] - own.v, axis=1)
            self._along[track] = np.exp(-((off / self._config.along) ** 2))
        self._own_velocity = own.v
        fresh = sorted(set(range(len(z))) - {d for _, d in assigned})
        self._end_tracks(time)
        for detection in fresh:
            self._start_track(time, z[detection], r[detection], bool(clear[detection]), own.p)
        self._last = (time, self._mean.copy(), self._covariance.copy())

    def predict(self, time: float) -> None:
        """Carry all tracks to `time` [s] at constant velocity, eq. (14); their covariance grows.

        The velocity of a neighbour out of sight fades, see `damping`.
        """
        self._rewind(time)
        dt = 0.0 if self._time is None else time - self._time
        self._time = time
        if dt == 0.0 or not len(self._ids):
            return
        before = self._mean.copy() if self._sized else self._mean
        self._mean[:, :3] += dt * self._mean[:, 3:6]
        if dt < 0.0:
            return
        # A neighbour abeam in formation keeps the own velocity, or it would fall back in memory.
        fading = time - min(time - self._looked, _FRAME_AGE_MAX) - self._seen > _FADE_AFTER
        keep = np.ones((len(fading), 1))
        keep[fading] = math.exp(-self._config.damping * dt)
        to = self._along[:, None] * self._own_velocity
        if self._sized:
            sigma = self._config.acceleration
            self._covariance = track_size.grow(before, self._covariance, dt, keep[:, 0], to, sigma)
            to = to * self._mean[:, 6:]
        self._mean[:, 3:6] = to + keep * (self._mean[:, 3:6] - to)
        if self._sized:
            return
        # F P F' + Q by blocks: a of positions, b of both, d of velocities
        c, keep = self._covariance, keep[..., None]
        q = self._noise
        a, b, d = c[:, :3, :3], c[:, :3, 3:], c[:, 3:, 3:]
        a += dt * (b + b.transpose(0, 2, 1)) + dt * dt * d + dt**4 / 4 * q
        b[:] = keep * (b + dt * d) + dt**3 / 2 * q
        c[:, 3:, :3] = b.transpose(0, 2, 1)
        d[:] = keep * keep * d + dt * dt * q

    def turn(self, p: Vector, angle: float) -> None:
        """Turn all tracks left about p (3,) m by a small `angle` [rad]."""
        for mean in (self._mean, self._last[1]):
            scale = mean[:, 6:] if self._sized else np.ones((len(mean), 1))
            places = mean[:, :3] / scale
            turn_about(places, p, angle)
            mean[:, :3] = places * scale
            turn_about(mean[:, 3:6], _NOWHERE, angle)

    def _rewind(self, time: float) -> None:
        """Go back to the last frame where `time` [s] lies between it and the last tick.

        Otherwise the covariance would grow, and the velocity fade, with every frame that is older
        than the tick before it.
        """
        if self._time is not None and self._last[0] <= time < self._time:
            self._time, self._mean, self._covariance = (
                self._last[0],
                self._last[1].copy(),
                self._last[2].copy(),
            )

    def tracks(self) -> list[Track]:
        """Return the confirmed tracks, oldest first."""
        time = self._time or 0.0
        sure = self._hits >= self._config.hits_to_confirm
        mean, covariance = self._mean[sure], self._covariance[sure]
        scales = np.ones(len(mean))
        if self._sized:
            scales = 1.0 / mean[:, 6]
            mean, covariance = track_size.in_world(mean, covariance)
        columns = (
            self._ids[sure].tolist(),
            mean[:, :3],
            mean[:, 3:],
            covariance,
            (time - self._born[sure]).tolist(),
            (time - self._seen[sure]).tolist(),
            scales.tolist(),
        )
        return [Track(*row) for row in zip(*columns, strict=True)]

    def positions(self) -> Vector:
        """Return the positions (n,3) m of all tracks, unconfirmed ones too."""
        return self._mean[:, :3] / self._mean[:, 6:] if self._sized else self._mean[:, :3].copy()

    @property
    def _velocities(self) -> Vector:
        """(n,3) m/s of all tracks."""
        return self._mean[:, 3:6] / self._mean[:, 6:] if self._sized else self._mean[:, 3:]

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
        two are never paired, or a ghost would come up between them.
        """
        if not len(z) or not len(self._ids):
            return []
        at, _, spread = self._expected(self._mean, self._covariance, here)
        s = spread[:, None] + r[None]
        residual = z[None] - at[:, None]
        solved = np.linalg.solve(s, residual[..., None])[..., 0]
        cost = np.einsum("tdi,tdi->td", residual, solved)
        fits = (cost < self._config.gate) & (clear | ~self._stale[:, None])
        if fits.sum(axis=0).max() <= 1 and fits.sum(axis=1).max() <= 1:  # there is no choice
            return [(track, detection) for track, detection in np.argwhere(fits).tolist()]
        # log det S keeps a track of large covariance from taking the detection of a sure track
        score = np.where(fits, cost + np.linalg.slogdet(s)[1], 1e3)
        return [pair for pair in assign(score) if score[pair] < 1e3]

    def _correct(self, n: NDArray[np.int_], z: Vector, r: Vector, here: Vector) -> None:
        """Correct tracks n (k,) by positions z (k,3) of covariance r (k,3,3), in Joseph's form."""
        p = self._covariance[n]
        at, across, spread = self._expected(self._mean[n], p, here)
        k = np.linalg.solve(spread + r, across).transpose(0, 2, 1)
        self._mean[n] += (k @ (z - at)[..., None])[..., 0]
        if self._sized:
            self._mean[n] = track_size.bounded(self._mean[n])
        speed = np.linalg.norm(self._velocities[n], axis=1)[:, None]
        self._mean[n, 3:6] *= np.minimum(1.0, self._config.speed_max / np.maximum(speed, 1e-9))
        a = np.zeros(p.shape)
        a[:] = self._identity
        a[:, :, :3] -= k
        if self._sized:
            a[:, :, 6] += k @ here
        corrected = a @ p @ a.transpose(0, 2, 1) + k @ r @ k.transpose(0, 2, 1)
        # Without this, rounding errors grow from update to update until a variance is negative.
        self._covariance[n] = 0.5 * (corrected + corrected.transpose(0, 2, 1))

    def _start_track(self, time: float, z: Vector, r: Vector, clear: bool, here: Vector) -> None:
        """Start a track at rest at z (3,) of covariance r (3,3), seen from here (3,)."""
        c = self._config
        mean, covariance = np.concatenate([z, np.zeros(3)]), np.zeros((6, 6))
        covariance[:3, :3] = r
        covariance[3:, 3:] = np.eye(3) * c.velocity_birth**2
        if self._sized:
            mean, covariance = track_size.birth(z, r, here, c.velocity_birth, c.size_sigma)
        self._mean = np.vstack([self._mean, mean[None]])
        self._covariance = np.concatenate([self._covariance, covariance[None]])
        self._ids = np.append(self._ids, self._next_id)
        self._born = np.append(self._born, time)
        self._seen = np.append(self._seen, time)
        self._hits = np.append(self._hits, int(clear))
        self._misses = np.append(self._misses, 0)
        self._along = np.append(self._along, 0.0)
        self._next_id += 1

    def _end_tracks(self, time: float) -> None:
        """Drop the tracks that are too old, missed too often, or too uncertain."""
        c = self._config
        p = self._covariance
        sigma = np.sqrt(p[:, 0, 0] + p[:, 1, 1] + p[:, 2, 2])
        if self._sized:
            sigma = track_size.sigma_of_known_size(self._mean, self._covariance)
        looks = np.maximum(self._hits, 1)
        life = np.minimum(c.life_per_look * looks, c.unseen_max)
        young = (time - self._seen <= life) & (self._misses < np.minimum(looks, c.misses_to_drop))
        keep = young & (sigma < c.sigma_max)
        if keep.all():
            return
        self._mean, self._covariance = self._mean[keep], self._covariance[keep]
        self._ids, self._born = self._ids[keep], self._born[keep]
        self._seen, self._hits = self._seen[keep], self._hits[keep]
        self._misses, self._along = self._misses[keep], self._along[keep]
