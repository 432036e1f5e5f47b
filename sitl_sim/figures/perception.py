"""How well the companions saw: their logs against truth.

In view is what eq. (6) says: inside the picture, within range, not hidden, here by an obstacle or
by another drone, to 35 % at least. A detection is
right where a drone is near its direction and about as far away; ranges are compared as a
share of the true one. Detections are judged with the true attitude, tracks relative to the
drone's own estimate of where it is.
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

DETECTION_RANGE = 8.0  # m, within which detections are judged
TRACK_RANGE = 10.0  # m, within which tracks are judged
VISIBLE = 0.35  # share of a drone's core that must be visible for it to count as in view
_CORE = 0.5  # of a drone's radius: hull and marker; arms and propellers hide nothing
_BLOCK = 2048  # sight lines at a time: what the processor's cache holds
_BEARING_GATE = np.radians(3.0)
_SIZE_GATE = 0.3  # m across the line of sight: near drones fill more than the angle above
_TRACK_GATE = 1.0  # m
_WELL = "none"  # no trouble with the camera, as a log says it
_FRESH = 0.2  # s since last seen: whose velocity counts


@dataclass(frozen=True)
class Sight:
    """One frame of one drone against truth; one that was due and did not come shows nothing.

    time: of the world [s]. in_view, found: drones to see and seen; detections, right: given and
    true. bearing [rad], range_error (share of the range): of what was right. The same of tracks;
    velocity (k,3) m/s: errors of the fresh ones.
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


def perception(seen: dict[str, list[Sight]]) -> dict[str, Any]:
    """The figures of `metrics.json`, over all drones."""
    every = [s for one in seen.values() for s in one]
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


def sights(
    scenario: Scenario, world: dict[str, Any], truth: Truth, logs: dict[str, list[dict[str, Any]]]
) -> dict[str, list[Sight]]:
    """Every frame of every drone in flight, by its name."""
    judge = _Judge(scenario, world, truth)
    frames = own_frames(scenario)
    return {
        name: list(judge.frames(i, frames[i], log)) for i, (name, log) in enumerate(logs.items())
    }


class _Judge:
    """Truth, and what can be seen in it."""

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

    def frames(self, i: int, frame: OwnFrame, log: list[dict[str, Any]]) -> Iterator[Sight]:
        """Frames that drone i took in flight, or that were due while its eye was in trouble."""
        log = [r for r in log if _due(r) is not None and "own" in r]
        times = np.array([_due(r) for r in log], float) - frame.boot
        flown = (times >= self._t[0]) & (times <= self._t[-1])
        flown[flown] &= self._at(self._p, times[flown])[:, i, 2] >= AIRBORNE
        log, times = [r for r, f in zip(log, flown, strict=True) if f], times[flown]
        if log:
            others = self._others(i, times)
            tracked = _tracks(log, frame, others, *self._tracked(i, frame, log))
            for n, parts in enumerate(zip(*_looks(log, others), *tracked, strict=True)):
                yield Sight(float(times[n]), *parts)

    def _others(self, i: int, times: Vector) -> _Others:
        """The other drones at each frame."""
        p, q = self._at(self._p, times), self._at(self._q, times)[:, i]
        q /= np.linalg.norm(q, axis=-1, keepdims=True)
        others = np.delete(np.arange(p.shape[1]), i)
        offsets = p[:, others] - p[:, i : i + 1]
        rays, distance = camera_rays(q, offsets), np.linalg.norm(offsets, axis=-1)
        asked = (distance <= TRACK_RANGE) & (rays[..., 2] > 0.0) & (p[:, others, 2] > AIRBORNE)
        visible = np.zeros(asked.shape, bool)
        visible[asked] = self._shares(p[:, i], q, offsets, asked) >= VISIBLE
        return _Others(rays, np.maximum(distance, 1e-9), visible)

    def _shares(self, eye: Vector, q: Vector, offsets: Vector, asked: NDArray[np.bool_]) -> Vector:
        """(k,) visible share of each drone that is asked for: frames × drones, row by row.

        Points on its core must be in the picture and neither behind an obstacle nor behind
        the core of a nearer drone.
        """
        frame, drone = np.nonzero(asked)
        offset = offsets[frame, drone]
        points = offset[:, None] + _CORE * self._radius * _disc(offset)
        ends = (points + eye[frame][:, None]).reshape(-1, 3)
        eyes = np.repeat(eye[frame], points.shape[1], axis=0)
        blocks = [slice(at, at + _BLOCK) for at in range(0, len(ends), _BLOCK)]
        rows = [self._occluders.free(eyes[b], ends[b]) for b in blocks]
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
        """The other drones at each tick: offsets and velocities (k,m,3)."""
        times = np.minimum(np.array([r["time"] for r in log]) - frame.boot, self._t[-1])
        p, v = self._at(self._p, times), self._at(self._v, times)
        others = np.delete(np.arange(p.shape[1]), i)
        offsets = p[:, others] - p[:, i : i + 1]
        return offsets, v[:, others]

    def _at(self, series: Vector, times: Vector) -> Vector:
        """Truth (k,N,…) at times (k,) between its samples."""
        k = np.clip(np.searchsorted(self._t, times) - 1, 0, len(self._t) - 2)
        share = ((times - self._t[k]) / (self._t[k + 1] - self._t[k]))[:, None, None]
        between: Vector = series[k] + share * (series[k + 1] - series[k])
        return between


def _due(record: dict[str, Any]) -> float | None:
    """When the frame of a tick was taken, or fell due that showed nothing; None: there was none.

    A tick without a frame while the eye is well lies between two frames.
    """
    taken: float | None = record.get("frame")
    blind = record.get("eye", _WELL) != _WELL
    return float(record["time"]) if taken is None and blind else taken


@dataclass(frozen=True)
class _Others:
    """The other drones seen from one, frame by frame: rays (k,m,3), distance, visible (k,m)."""

    rays: Vector
    distance: Vector
    visible: NDArray[np.bool_]


def _looks(log: list[dict[str, Any]], others: _Others) -> tuple[Iterable[Any], ...]:
    """Detections against the others, frame by frame: in_view … range_error of `Sight`."""
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


def _tracks(
    log: list[dict[str, Any]],
    frame: OwnFrame,
    others: _Others,
    true_offsets: Vector,
    true_v: Vector,
) -> tuple[Iterable[Any], ...]:
    """Tracks at the ticks against truth: the last five of `Sight`."""
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
    """Rows of all frames in one array (n,width), and the frame of each (n,)."""
    of = np.repeat(np.arange(len(rows)), [len(r) for r in rows])
    return of, np.array([row for frame in rows for row in frame], float).reshape(-1, width)


def _counts(frames: int, of: NDArray[np.int_]) -> list[int]:
    """How often each frame stands there."""
    return [int(c) for c in np.bincount(of, minlength=frames)]


def _by_frame(values: Vector, of: NDArray[np.int_], frames: int) -> list[Vector]:
    """`values`, in order of their frames, cut up by frame."""
    return np.split(values, np.searchsorted(of, np.arange(1, frames)))


def _disc(offsets: Vector) -> Vector:
    """(n,8,3) the middle and a ring on a disc of radius 1 that faces each of `offsets` (n,3)."""
    ray = offsets / np.maximum(np.linalg.norm(offsets, axis=1, keepdims=True), 1e-9)
    side = np.cross(ray, [0.0, 0.0, 1.0])
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-9)
    up = np.cross(side, ray)
    angle = np.linspace(0.0, 2 * np.pi, 7, endpoint=False)[:, None]
    ring = 0.75 * (np.cos(angle) * side[:, None] + np.sin(angle) * up[:, None])
    disc: Vector = np.concatenate([np.zeros((len(offsets), 1, 3)), ring], axis=1)
    return disc


def _angles(a: Vector, b: Vector) -> Vector:
    """(n,m) rad between directions a (n,3) and unit b (n,m,3); exact for small ones too."""
    a = a / np.maximum(np.linalg.norm(a, axis=1, keepdims=True), 1e-9)
    half: Vector = np.linalg.norm(a[:, None] - b, axis=-1) / 2
    return 2 * np.arcsin(np.minimum(half, 1.0))


def _match(
    cost: Vector, allowed: NDArray[np.bool_], of: NDArray[np.int_]
) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Pairs (row, column) among the allowed ones, as many and as near as can be in each frame.

    of: (n,) the frame of each row, ascending. Most rows fit one column and no other does.
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
    """Which of the values stand there more than once."""
    _, places, counts = np.unique(values, return_inverse=True, return_counts=True)
    several: NDArray[np.bool_] = counts[places] > 1
    return several


def _rms(values: Vector) -> float | None:
    return float(np.sqrt((values**2).mean())) if len(values) else None


def _share(sights: list[Sight], part: str, whole: str) -> float | None:
    total = sum(getattr(s, whole) for s in sights)
    return sum(getattr(s, part) for s in sights) / total if total else None
