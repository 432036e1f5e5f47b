"""How well the companions perceived: their logs against the truth.

A drone is in view as in eq. (6): inside the picture, within range, and visible to 35 % at least
behind obstacles and other drones. A detection is right where a drone is near its direction and
about as far away; range errors are a share of the true range. Detections are compared with the
true attitude, tracks relative to the drone's own position estimate.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from mavlink_bridge.shared.arrays import Vector
from sitl_sim.figures.metrics import AIRBORNE
from sitl_sim.recording.run_folder import OwnFrame, Truth, own_frames
from sitl_sim.scenarios.scenario import Scenario
from sitl_sim.sensors.perfect_detector import camera_rays, seen
from sitl_sim.worlds.world import Occluders

DETECTION_RANGE = 8.0  # m: detections within this are scored
TRACK_RANGE = 10.0  # m: tracks within this are scored
VISIBLE = 0.35  # share of a drone's core that must be visible for it to count as in view
_CORE = 0.5  # of a drone's radius: hull and marker; arms and propellers hide nothing
_BLOCK = 2048  # sight lines at a time: what the processor's cache holds
_BEARING_GATE = np.radians(3.0)
_SIZE_GATE = 0.3  # m across the line of sight: near drones fill more than the angle above
_TRACK_GATE = 1.0  # m
_WELL = "none"  # a healthy camera in a log
_FRESH = 0.2  # s since last seen: the velocity of such a track counts


@dataclass(frozen=True)
class FrameScore:
    """One frame of one drone against the truth; a frame that was due and did not come is empty.

    time: world [s]. in_view, found: drones in view, and those detected. detections, right: all,
    and the right ones. bearing [rad], range_error (share of the range): of right detections. The
    same for tracks; velocity (k,3) m/s: errors of the fresh ones.
    """

    time: float
    in_view: int
    found: int
    detections: int
    right: int
    bearing: Vector
    range_error: Vector
    tracks_in_view: int
    tracks_found: int
    tracks: int
    tracks_right: int
    velocity: Vector


def perception(scores: dict[str, list[FrameScore]]) -> dict[str, Any]:
    """Return the figures of `metrics.json`, over all drones."""
    every = [s for one in scores.values() for s in one]
    bearing = np.concatenate([s.bearing for s in every]) if every else np.zeros(0)
    ranges = np.concatenate([s.range_error for s in every]) if every else np.zeros(0)
    velocity = np.concatenate([s.velocity for s in every]) if every else np.zeros((0, 3))
    return {
        "recall": _share(every, "found", "in_view"),
        "precision": _share(every, "right", "detections"),
        "range_error_median": float(np.median(np.abs(ranges))) if len(ranges) else None,
        "bearing_error_deg": _rms(np.degrees(bearing)),
        "velocity_rmse_m_s": _rms(np.linalg.norm(velocity, axis=1)),
        "track_recall": _share(every, "tracks_found", "tracks_in_view"),
        "track_precision": _share(every, "tracks_right", "tracks"),
        "frames": len(every),
        "detection_range_m": DETECTION_RANGE,
        "track_range_m": TRACK_RANGE,
    }


def score_frames(
    scenario: Scenario, world: dict[str, Any], truth: Truth, logs: dict[str, list[dict[str, Any]]]
) -> dict[str, list[FrameScore]]:
    """Score every frame of every drone in flight; by drone name."""
    scorer = _Scorer(scenario, world, truth)
    frames = own_frames(scenario, world)
    return {
        name: list(scorer.frames(i, frames[i], log)) for i, (name, log) in enumerate(logs.items())
    }


class _Scorer:
    """Scores the frames of a flight against its truth."""

    def __init__(self, scenario: Scenario, world: dict[str, Any], truth: Truth) -> None:
        s = scenario.sensing
        half = np.radians(s.fov_deg) / 2
        self._view = (half, half * s.height / s.width)
        self._occluders = Occluders(world)
        self._radius = float(world["drone_radius"])
        self._t = truth["t"]
        self._p, self._v, self._q = (
            truth[k].astype(float) for k in ("position", "velocity", "attitude")
        )

    def frames(self, i: int, frame: OwnFrame, log: list[dict[str, Any]]) -> Iterator[FrameScore]:
        """Yield scores of frames taken in flight, and of those due while the camera was faulty."""
        log = [r for r in log if _due(r) is not None and "own" in r]
        times = np.array([_due(r) for r in log], float) - frame.boot
        flown = (times >= self._t[0]) & (times <= self._t[-1])
        flown[flown] &= self._at(self._p, times[flown])[:, i, 2] >= AIRBORNE
        log, times = [r for r, f in zip(log, flown, strict=True) if f], times[flown]
        if log:
            others = self._others(i, times)
            tracked = _score_tracks(log, frame, others, *self._tracked(i, frame, log))
            for n, parts in enumerate(zip(*_score_detections(log, others), *tracked, strict=True)):
                yield FrameScore(float(times[n]), *parts)

    def _others(self, i: int, times: Vector) -> _OtherDrones:
        """Return the other drones at each frame."""
        p, q = self._at(self._p, times), self._at(self._q, times)[:, i]
        q /= np.linalg.norm(q, axis=-1, keepdims=True)
        others = np.delete(np.arange(p.shape[1]), i)
        offsets = p[:, others] - p[:, i : i + 1]
        rays, distance = camera_rays(q, offsets), np.linalg.norm(offsets, axis=-1)
        asked = (distance <= TRACK_RANGE) & (rays[..., 2] > 0.0) & (p[:, others, 2] > AIRBORNE)
        visible = np.zeros(asked.shape, bool)
        visible[asked] = self._shares(p[:, i], q, offsets, asked) >= VISIBLE
        return _OtherDrones(rays, np.maximum(distance, 1e-9), visible)

    def _shares(
        self, viewpoint: Vector, q: Vector, offsets: Vector, asked: NDArray[np.bool_]
    ) -> Vector:
        """Return the visible share (k,) of each drone asked for: frames × drones, row by row.

        Points on its core must be in the picture and neither behind an obstacle nor behind
        the core of a nearer drone.
        """
        frame, drone = np.nonzero(asked)
        offset = offsets[frame, drone]
        points = offset[:, None] + _CORE * self._radius * _disc(offset)
        ends = (points + viewpoint[frame][:, None]).reshape(-1, 3)
        viewpoints = np.repeat(viewpoint[frame], points.shape[1], axis=0)
        blocks = [slice(at, at + _BLOCK) for at in range(0, len(ends), _BLOCK)]
        rows = [self._occluders.free(viewpoints[b], ends[b]) for b in blocks]
        free = np.concatenate([*rows, np.zeros(0, bool)]).reshape(points.shape[:2])
        free &= seen(camera_rays(q[frame], points), *self._view)
        distance = np.linalg.norm(points, axis=-1)
        for k in range(offsets.shape[1]):
            other = offsets[frame, k][:, None]
            along = (points * other).sum(axis=-1) / distance  # of the other, on the sight line
            miss2 = (other**2).sum(axis=-1) - along**2
            nearer = (along > 0.0) & (along < distance - self._radius) & (drone != k)[:, None]
            free &= ~(nearer & (miss2 < (_CORE * self._radius) ** 2))
        share: Vector = free.mean(axis=1)
        return share

    def _tracked(self, i: int, frame: OwnFrame, log: list[dict[str, Any]]) -> tuple[Vector, Vector]:
        """Return the other drones at each tick: offsets and velocities (k,m,3)."""
        times = np.minimum(np.array([r["time"] for r in log]) - frame.boot, self._t[-1])
        p, v = self._at(self._p, times), self._at(self._v, times)
        others = np.delete(np.arange(p.shape[1]), i)
        offsets = p[:, others] - p[:, i : i + 1]
        return offsets, v[:, others]

    def _at(self, series: Vector, times: Vector) -> Vector:
        """Return the truth (k,N,…) at times (k,), interpolated between its samples."""
        k = np.clip(np.searchsorted(self._t, times) - 1, 0, len(self._t) - 2)
        share = ((times - self._t[k]) / (self._t[k + 1] - self._t[k]))[:, None, None]
        between: Vector = series[k] + share * (series[k + 1] - series[k])
        return between


def _due(record: dict[str, Any]) -> float | None:
    """Return when the frame of a tick was taken, or was due from a faulty camera; else None.

    A tick without a frame while the camera is healthy lies between two frames.
    """
    taken: float | None = record.get("frame")
    blind = record.get("camera", record.get("eye", _WELL)) != _WELL  # "eye": logs of 0.1
    return float(record["time"]) if taken is None and blind else taken


@dataclass(frozen=True)
class _OtherDrones:
    """The other drones seen from one, frame by frame: rays (k,m,3), distance, visible (k,m)."""

    rays: Vector
    distance: Vector
    visible: NDArray[np.bool_]


def _score_detections(log: list[dict[str, Any]], others: _OtherDrones) -> tuple[Iterable[Any], ...]:
    """Return in_view … range_error of `FrameScore`, frame by frame."""
    frames = len(log)
    of, rows = _flat([r["detections"] for r in log], 5)
    angle = _angles(rows[:, :3], others.rays[of])
    ratio = rows[:, 3:4] / others.distance[of]
    near = angle < np.maximum(_BEARING_GATE, _SIZE_GATE / others.distance[of])
    found, drones = _match(angle, near & (ratio > 0.5) & (ratio < 2.0), of)
    wanted = others.visible & (others.distance <= DETECTION_RANGE)
    given = rows[:, 3] <= DETECTION_RANGE
    right = given[found]
    return (
        wanted.sum(axis=1).tolist(),
        _counts(frames, of[found][wanted[of[found], drones]]),
        _counts(frames, of[given]),
        _counts(frames, of[found][right]),
        _by_frame(angle[found, drones][right], of[found][right], frames),
        _by_frame((ratio[found, drones] - 1.0)[right], of[found][right], frames),
    )


def _score_tracks(
    log: list[dict[str, Any]],
    frame: OwnFrame,
    others: _OtherDrones,
    true_offsets: Vector,
    true_v: Vector,
) -> tuple[Iterable[Any], ...]:
    """Return the last five fields of `FrameScore`, tick by tick."""
    frames = len(log)
    of, rows = _flat([[[*t["p"], *t["v"], t["unseen"]] for t in r["tracks"]] for r in log], 7)
    own = np.array([r["own"]["p"] for r in log], float)
    offsets, speeds = frame.vectors(rows[:, :3] - own[of]), frame.vectors(rows[:, 3:6])
    counted = (rows[:, 6] <= _FRESH) & (np.linalg.norm(offsets, axis=1) <= TRACK_RANGE)
    gap = np.linalg.norm(offsets[:, None] - true_offsets[of], axis=-1)
    found, drones = _match(gap, gap < _TRACK_GATE, of)
    wanted = others.visible & (others.distance <= TRACK_RANGE)
    right = counted[found]
    wrong_v = (speeds[found] - true_v[of[found], drones])[right]
    return (
        wanted.sum(axis=1).tolist(),
        _counts(frames, of[found][wanted[of[found], drones]]),
        _counts(frames, of[counted]),
        _counts(frames, of[found][right]),
        _by_frame(wrong_v, of[found][right], frames),
    )


def _flat(rows: list[list[list[float]]], width: int) -> tuple[NDArray[np.int_], Vector]:
    """Return the frame (n,) of each row, and the rows of all frames in one array (n,width)."""
    of = np.repeat(np.arange(len(rows)), [len(r) for r in rows])
    return of, np.array([row for frame in rows for row in frame], float).reshape(-1, width)


def _counts(frames: int, of: NDArray[np.int_]) -> list[int]:
    """Count how often each frame occurs."""
    return [int(c) for c in np.bincount(of, minlength=frames)]


def _by_frame(values: Vector, of: NDArray[np.int_], frames: int) -> list[Vector]:
    """Split `values`, which are in order of their frames, by frame."""
    return np.split(values, np.searchsorted(of, np.arange(1, frames)))


def _disc(offsets: Vector) -> Vector:
    """Return (n,8,3) centre and ring of a disc of radius 1 that faces each of `offsets` (n,3)."""
    ray = offsets / np.maximum(np.linalg.norm(offsets, axis=1, keepdims=True), 1e-9)
    side = np.cross(ray, [0.0, 0.0, 1.0])
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-9)
    up = np.cross(side, ray)
    angle = np.linspace(0.0, 2 * np.pi, 7, endpoint=False)[:, None]
    ring = 0.75 * (np.cos(angle) * side[:, None] + np.sin(angle) * up[:, None])
    disc: Vector = np.concatenate([np.zeros((len(offsets), 1, 3)), ring], axis=1)
    return disc


def _angles(a: Vector, b: Vector) -> Vector:
    """Return angles (n,m) rad between directions a (n,3) and unit b (n,m,3), exact if small."""
    a = a / np.maximum(np.linalg.norm(a, axis=1, keepdims=True), 1e-9)
    half: Vector = np.linalg.norm(a[:, None] - b, axis=-1) / 2
    return 2 * np.arcsin(np.minimum(half, 1.0))


def _match(
    cost: Vector, allowed: NDArray[np.bool_], of: NDArray[np.int_]
) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Return the best assignment of rows to columns in each frame, among the allowed pairs.

    of: (n,) the frame of each row, ascending. Most rows fit exactly one column.
    """
    rows, columns = np.nonzero(allowed)
    place = of[rows] * allowed.shape[1] + columns
    contested = np.unique(of[rows[_repeated(rows) | _repeated(place)]])
    clear = ~np.isin(of[rows], contested)
    pairs = [np.stack([rows[clear], columns[clear]])]
    for frame in contested:
        first, end = np.searchsorted(of, (frame, frame + 1))
        may = allowed[first:end]
        r, c = linear_sum_assignment(np.where(may, cost[first:end], 1e3))
        pairs.append(np.stack([first + r[may[r, c]], c[may[r, c]]]))
    found = np.concatenate(pairs, axis=1)
    found = found[:, np.argsort(found[0], kind="stable")]
    return found[0], found[1]


def _repeated(values: NDArray[np.int_]) -> NDArray[np.bool_]:
    """Return which values occur more than once."""
    _, places, counts = np.unique(values, return_inverse=True, return_counts=True)
    several: NDArray[np.bool_] = counts[places] > 1
    return several


def _rms(values: Vector) -> float | None:
    return float(np.sqrt((values**2).mean())) if len(values) else None


def _share(scores: list[FrameScore], part: str, whole: str) -> float | None:
    total = sum(getattr(s, whole) for s in scores)
    return sum(getattr(s, part) for s in scores) / total if total else None
