"""The camera from a whole flight: mounting angles, lag and focal length, by least squares.

A corner seen in the direction r₁ before and r₂ after shows, in the camera's frame,

    r₂ = C r₁ + f/d + noise,    C = Mᵀ R(t₂−L)ᵀ R(t₁−L) M,

with the attitude R that telemetry tells, the mount M, the lag L of the pictures behind their
stamps, and the flow f of a point one metre away that the own way causes; the distance d is not
known. So what a corner misses across f counts by its pixels, and along f hardly. Turning tells
the angles about the axes that are not turned about, the lag and the focal length; the own way
tells where the camera points, too, as far as the reported attitude is right: how wrong it may be
is estimated besides. A wrong attitude turns with the drone, and does not spoil what turning tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from companion.commissioning.attitude_curve import AttitudeCurve, rotations_of
from companion.commissioning.least_squares import Fit, solve
from companion.perception.camera import Camera
from companion.perception.corner_pairs import CornerPairs
from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.shared.frames import rotation_matrix

PARAMETERS = ("roll", "pitch", "yaw", "lag", "focal")  # °, °, °, s, factor
# 1 σ about what is configured; then, of the angles [°] by which the reported attitude is wrong.
_PRIOR = np.array([30.0, 30.0, 30.0, 0.3, 0.3, 1.0, 1.0, 4.0])
_STEPS = np.array([0.05, 0.05, 0.05, 0.001, 0.001, 0.05, 0.05, 0.05])  # of the derivatives
_LAGS = np.arange(-0.25, 0.2501, 0.05)  # s, from which the search starts
_THINNED = 6  # every so many corners for the starts
_PIXEL = 0.3  # px of a picture 320 px wide, 1 σ of a followed corner
_DISTANCE = 6.0  # m, typical of corners: its inverse and the inverse's 1 σ are alike
_NEAR = 0.1  # share of the parallax by which the own way is not known
_BLOCK = 1.0  # s for which errors may be alike
_EXPLAINED = 2.0  # px of a picture 320 px wide, by which an explained corner may miss
_LEAST_PAIRS, _LEAST_CORNERS = 60, 600  # pictures, and corners in all of them


@dataclass(frozen=True)
class CameraFit:
    """The camera's parameters by `PARAMETERS`, their covariance, and how well they explain.

    values: (5,). covariance: (5,5). halves: (2,5), of the halves of the flight. explained: share
    of the corners. pairs: of pictures.
    """

    values: Vector
    covariance: Vector
    halves: Vector
    explained: float
    pairs: int


def fit_camera(
    camera: Camera,
    start: Sequence[float],
    curve: AttitudeCurve,
    velocity: tuple[Vector, Vector],
    pairs: Sequence[CornerPairs],
) -> CameraFit | None:
    """Return the parameters of the camera; None where too few pictures can be compared.

    camera: as configured, not turned by `mount_deg`. start: (5,) as configured. velocity: times
    (n,) s and velocities (n,3) m/s, world.
    """
    corners = _Corners(camera, curve, velocity, pairs)
    if corners.pairs < _LEAST_PAIRS or len(corners.times) < _LEAST_CORNERS:
        return None
    first = np.concatenate([start, np.zeros(3)])
    values = _started(corners.thinned(_THINNED), first)
    fit = solve(corners, values, first, _PRIOR, _STEPS)
    middle = float(np.median(corners.times))
    halves = [
        solve(corners.chosen(chosen), fit.values, first, _PRIOR, _STEPS).values
        for chosen in (corners.times <= middle, corners.times > middle)
    ]
    n = len(PARAMETERS)
    return CameraFit(
        fit.values[:n],
        fit.covariance[:n, :n],
        np.array(halves)[:, :n],
        corners.explained(fit.values),
        corners.pairs,
    )


def _started(corners: _Corners, first: Vector) -> Vector:
    """Return the parameters (8,) from the start among `_LAGS` that explains the corners best."""
    best: tuple[float, Fit] | None = None
    for lag in _LAGS:
        values = first.copy()
        values[3] = lag
        fit = solve(corners, values, first, _PRIOR, _STEPS, most=4)
        cost = float(np.median(np.abs(corners.residuals(fit.values)[0][1])))
        if best is None or cost < best[0]:
            best = cost, fit
    assert best is not None
    return best[1].values


@dataclass(frozen=True, eq=False)
class _Rows:
    """Corners of all pairs: which pair each is of, and its pixels (n,4)."""

    pair: NDArray[np.int64]
    pixels: Vector


class _Corners:
    """All corners of a flight as a problem of least squares; see `least_squares.Problem`."""

    def __init__(
        self,
        camera: Camera,
        curve: AttitudeCurve,
        velocity: tuple[Vector, Vector],
        pairs: Sequence[CornerPairs],
    ) -> None:
        self._camera, self._curve = camera, curve
        self._velocity = velocity
        reach = float(-_LAGS[0]) + 0.05
        stamps = np.array([[p.before, p.after] for p in pairs]).reshape(-1, 2)
        usable = [curve.known(stamps[:, k] + off) for k in (0, 1) for off in (-reach, reach)]
        kept = [pair for pair, good in zip(pairs, np.all(usable, axis=0), strict=True) if good]
        self._before = np.array([p.before for p in kept])
        self._after = np.array([p.after for p in kept])
        self.pairs = len(kept)
        pixels = [np.zeros((0, 4)), *(p.pixels.astype(float) for p in kept)]
        counts = [len(p.pixels) for p in kept]
        self._rows = _Rows(np.repeat(np.arange(len(kept)), counts), np.concatenate(pixels))
        self._sigma = _PIXEL * (camera.width / min(camera.width, 320)) / camera.fx

    @property
    def times(self) -> Vector:
        """(n,) s, of each corner."""
        times: Vector = self._after[self._rows.pair]
        return times

    @property
    def blocks(self) -> NDArray[np.int64]:
        """(n,) number of the block of time that each corner is of."""
        return np.floor(self.times / _BLOCK).astype(np.int64)

    def chosen(self, kept: NDArray[np.bool_] | slice) -> _Corners:
        """Return the problem with some of the corners alone."""
        other = _Corners.__new__(_Corners)
        other.__dict__.update(self.__dict__)
        other._rows = _Rows(self._rows.pair[kept], self._rows.pixels[kept])
        return other

    def thinned(self, every: int) -> _Corners:
        """Return the problem with every so many corners."""
        return self.chosen(slice(None, None, every))

    def residuals(self, values: Vector) -> tuple[Vector, Vector]:
        """Return the misses [rad] along and across the flow (2,n), and their variances (2,n)."""
        rows = self._rows
        camera = _camera(self._camera, values)
        mount = rotation_matrix(camera.mount)
        before, after = (t - values[3] for t in (self._before, self._after))
        r1, r2 = (self._curve.at(t) for t in (before, after))
        turn = mount.T @ np.swapaxes(r2, 1, 2) @ r1 @ mount
        middle = 0.5 * (before + after)
        times, v = self._velocity
        way = np.stack([np.interp(middle, times, c) for c in v.T], axis=1)
        way = way * (after - before)[:, None]
        way = np.einsum("nji,nj->ni", r2, way) @ rotations_of(np.radians(values[None, 5:]))[0].T
        moved = (way @ mount)[rows.pair]
        first, second = (camera.unproject(rows.pixels[:, k : k + 2]) for k in (0, 2))
        error = second - np.einsum("nij,nj->ni", turn[rows.pair], first)
        flow = np.einsum("ni,ni->n", second, moved)[:, None] * second - moved
        size = np.linalg.norm(flow, axis=1)
        # Without motion any two directions will do.
        still = np.cross(second, [0.0, 1.0, 1e-3])
        along = np.where(size[:, None] > 1e-6, flow, still)
        along = along / np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
        across = np.cross(second, along)
        length = size / _DISTANCE
        a = np.einsum("ni,ni->n", error, along) - length
        b = np.einsum("ni,ni->n", error, across)
        variance = self._sigma**2 + np.stack([length, _NEAR * length]) ** 2
        return np.stack([a, b]), variance

    def explained(self, values: Vector) -> float:
        """Return the share of the corners that miss across the flow by little."""
        across = np.abs(self.residuals(values)[0][1])
        return float(np.mean(across < _EXPLAINED / _PIXEL * self._sigma))


def _camera(camera: Camera, values: Vector) -> Camera:
    """Return the camera with mount and focal length by the parameters."""
    zoomed = replace(camera, fx=camera.fx * values[4], fy=camera.fy * values[4])
    return zoomed.turned([float(v) for v in values[:3]])
