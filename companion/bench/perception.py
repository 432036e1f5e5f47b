"""Perception measured on labelled frames: tables per range and conditions, of tracks and of time.

A drone is in view where at least 35 % of it shows. A detection is right where a drone is within 3°
of it (or, near by, within a third of a metre) and between half and twice as far away. A detection
of a drone that shows less is neither right nor wrong.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from companion.bench.labels import Drones, LabelledFrame
from companion.estimation.assignment import assign
from companion.estimation.tracker import Tracker
from companion.estimation.tracker_config import TrackerConfig
from companion.perception.ball import Detector
from companion.perception.camera import Camera
from companion.types import Detection, Image, Trunk
from mavlink_bridge.shared.arrays import Vector, norm
from mavlink_bridge.shared.frames import rotation_matrix

FindTrunks = Callable[[Image, Vector, float], list[Trunk]]
BANDS = ((0.3, 2.0), (2.0, 4.0), (4.0, 6.0), (6.0, 8.0), (8.0, 10.0), (10.0, 12.0))
TO_8, TO_10 = (0.3, 8.0), (0.3, 10.0)
TRUNKS_TO_5 = (0.0, 5.0)
TRUNK_BANDS = ((0.0, 2.0), (2.0, 5.0), (5.0, 8.0), TRUNKS_TO_5, (0.0, 8.0))
VISIBLE = 0.35
CROWD = "neighbours-"  # prefix of conditions in which only time is measured
_FAR = 1e3
_SAME_ANGLE, _SAME_SIZE = np.radians(3.0), 0.33
_TRACK_GATE = 1.0  # m
_FRESH = 0.2  # s


@dataclass
class Tally:
    """Counts and errors of one range band.

    wanted: drones in view. found: of these. false: detections of no drone. bearing: rad. relative:
    error of range over range. normalised: error of range over its own 1σ. velocity: m/s.
    """

    wanted: int = 0
    found: int = 0
    false: int = 0
    bearing: list[float] = field(default_factory=list)
    relative: list[float] = field(default_factory=list)
    normalised: list[float] = field(default_factory=list)
    velocity: list[float] = field(default_factory=list)

    def figures(self) -> dict[str, float | int | None]:
        """Return the figures of the report; None where nothing was measured."""
        relative = np.array(self.relative, float)
        return {
            "wanted": self.wanted,
            "recall": _share(self.found, self.wanted),
            "precision": _share(self.found, self.found + self.false),
            "bearing_rms_deg": _rms(np.degrees(self.bearing)),
            "range_error_median": _percentile(np.abs(relative), 50),
            "range_bias_median": _percentile(relative, 50),
            "range_error_p95": _percentile(np.abs(relative), 95),
            "range_error_p95_sigma": _percentile(np.abs(np.array(self.normalised, float)), 95),
            "velocity_rmse_m_s": _rms(self.velocity),
        }


def measure(
    camera: Camera,
    frames: Sequence[LabelledFrame],
    detector: Detector,
    compared: dict[str, Callable[[Image], object]],
    find: FindTrunks,
) -> dict[str, Any]:
    """Return all tables.

    compared: by name, calls whose time is measured, too. find: of trunks, by a picture, down
    in the camera's frame and the altitude [m].
    """
    drones: dict[str, dict[tuple[float, float], Tally]] = {}
    tracked = {band: Tally() for band in (*BANDS, TO_8, TO_10)}
    trunks = Trunks(camera, find)
    times: dict[str, list[float]] = {"detect_track": [], **{name: [] for name in compared}}
    crowds: dict[int, list[float]] = {}
    flight: Flight | None = None
    for frame in frames:
        image = frame.image()
        if frame.sequence is not None and (flight is None or flight.number != frame.sequence):
            flight = Flight(frame.sequence, camera, tracked)
        begun = time.thread_time()
        found = detector.detect(image)
        if frame.sequence is not None and flight is not None:
            flight.update(frame, found)
        taken = (time.thread_time() - begun) * 1e3
        if frame.conditions.startswith(CROWD):
            crowds.setdefault(int(frame.conditions.removeprefix(CROWD)), []).append(taken)
        else:
            bands = drones.setdefault(
                frame.conditions, {band: Tally() for band in (*BANDS, TO_8, TO_10)}
            )
            score(bands, found, frame.drones)
        if frame.sequence is not None and flight is not None:
            flight.score(frame)
            times["detect_track"].append(taken)
            for name, run in compared.items():
                begun = time.thread_time()
                run(image)
                times[name].append((time.thread_time() - begun) * 1e3)
        if frame.conditions == "clean" and frame.sequence is None and frame.trunks is not None:
            trunks.add(frame, image)
    return {
        "drones": {name: _table(bands) for name, bands in drones.items()},
        "tracks": _table(tracked),
        "trunks": trunks.table(),
        "time_ms": {name: _times(t) for name, t in times.items()}
        | {"trunks": _times(trunks.times)},
        "scaling_ms": {n: _times(t) for n, t in sorted(crowds.items())},
    }


def score(bands: dict[tuple[float, float], Tally], found: list[Detection], drones: Drones) -> None:
    """Match one frame's detections to its drones and count them in all bands."""
    ranges = np.array([d.range for d in found])
    angle, ratio, right = matched_drones(found, drones)
    for drone, distance in enumerate(drones.ranges):
        if drones.visible[drone] < VISIBLE:
            continue
        for (low, high), tally in bands.items():
            if low <= distance < high:
                tally.wanted += 1
                if drone in right:
                    tally.found += 1
                    tally.bearing.append(float(angle[right[drone], drone]))
                    tally.relative.append(float(ratio[right[drone], drone] - 1.0))
                    error = ranges[right[drone]] - distance
                    tally.normalised.append(float(error / found[right[drone]].sigma_range))
    for n in sorted(set(range(len(found))) - set(right.values())):
        for (low, high), tally in bands.items():
            tally.false += bool(low <= ranges[n] < high)


def matched_drones(found: list[Detection], drones: Drones) -> tuple[Vector, Vector, dict[int, int]]:
    """Return angles [rad] and ratios of ranges (n,m), and the right detection of each drone."""
    rays = np.array([d.direction for d in found]).reshape(-1, 3)
    ranges = np.array([d.range for d in found])
    angle = np.arccos(np.clip(rays @ drones.rays.T, -1.0, 1.0))
    ratio = ranges[:, None] / np.maximum(drones.ranges, 1e-9)
    gate = np.maximum(_SAME_ANGLE, _SAME_SIZE / np.maximum(drones.ranges, 0.3))
    pairs = match(angle, (angle < gate) & (ratio > 0.5) & (ratio < 2.0))
    return angle, ratio, {drone: detection for detection, drone in pairs}


class Flight:
    """The tracker on one sequence, its tracks compared with the truth."""

    def __init__(
        self, number: int, camera: Camera, tallies: dict[tuple[float, float], Tally]
    ) -> None:
        self.number = number
        self._camera, self._tallies = camera, tallies
        self._tracker = Tracker(TrackerConfig())

    def update(self, frame: LabelledFrame, found: list[Detection]) -> None:
        """Give one frame's detections to the tracker."""
        self._tracker.update(frame.own.time, found, frame.own, self._camera.mount)

    def score(self, frame: LabelledFrame) -> None:
        """Compare fresh tracks with the truth; the first half second does not count."""
        tracks = [t for t in self._tracker.tracks() if t.unseen <= _FRESH]
        if frame.own.time < 0.5:
            return
        drones = frame.drones
        r_wc = rotation_matrix(frame.own.q_wb) @ rotation_matrix(self._camera.mount)
        true = frame.own.p + drones.rays * drones.ranges[:, None] @ r_wc.T
        places = np.array([t.p for t in tracks]).reshape(-1, 3)
        gap = np.linalg.norm(places[:, None] - true[None], axis=-1)
        right = {drone: track for track, drone in match(gap, gap < _TRACK_GATE)}
        for (low, high), tally in self._tallies.items():
            for drone, distance in enumerate(drones.ranges):
                if not low <= distance < high:
                    continue
                in_view = bool(drones.visible[drone] >= VISIBLE)
                tally.wanted += in_view
                if drone in right:
                    tally.found += in_view
                    error = tracks[right[drone]].v - drones.velocities[drone]
                    tally.velocity.append(norm(error))
            lost = sorted(set(range(len(tracks))) - set(right.values()))
            apart = np.linalg.norm(places[lost] - frame.own.p, axis=1)
            tally.false += int(((apart >= low) & (apart < high)).sum())


class Trunks:
    """What finds trunks, compared with the truth."""

    def __init__(self, camera: Camera, find: FindTrunks) -> None:
        self._camera, self._find = camera, find
        self._bands = {band: Tally() for band in TRUNK_BANDS}
        self.times: list[float] = []

    def add(self, frame: LabelledFrame, image: Any) -> None:
        """Detect in one frame and count."""
        assert frame.trunks is not None
        r_wc = rotation_matrix(frame.own.q_wb) @ rotation_matrix(self._camera.mount)
        begun = time.thread_time()
        found = self._find(image, -r_wc[2], float(frame.own.p[2]))
        self.times.append((time.thread_time() - begun) * 1e3)
        self._score(found, frame.trunks)

    def _score(self, found: list[Trunk], trunks: Vector) -> None:
        """Match the trunks and count in all bands."""
        surface = np.array([t.distance - t.radius for t in found])
        true = trunks[:, 3] - trunks[:, 4]
        right = matched_trunks(found, trunks)
        lost = surface[sorted(set(range(len(found))) - set(right.values()))]
        for (low, high), tally in self._bands.items():
            tally.false += int(((lost >= low) & (lost < high)).sum())
            here = (true >= low) & (true < high) & (trunks[:, 5] >= VISIBLE)
            for n in np.flatnonzero(here).tolist():
                tally.wanted += 1
                if n in right:
                    tally.found += 1
                    tally.relative.append(float(surface[right[n]] / max(true[n], 0.05) - 1.0))
                    error = surface[right[n]] - true[n]
                    tally.normalised.append(float(error / found[right[n]].sigma))

    def figures(self, band: tuple[float, float]) -> dict[str, float | int | None]:
        """Return the figures of one band of surface distance."""
        return self._bands[band].figures()

    def table(self) -> dict[str, Any]:
        """Return the figures per band of surface distance."""
        return _table(self._bands)


def matched_trunks(found: list[Trunk], trunks: Vector) -> dict[int, int]:
    """Return the right detection of each of `trunks` (k,6), as `LabelledFrame` has them.

    It is right by bearing, within the trunk's own width, and by distance.
    """
    rays = np.array([t.direction for t in found]).reshape(-1, 3)
    surface = np.array([t.distance - t.radius for t in found])
    true = trunks[:, 3] - trunks[:, 4]
    angle = np.arccos(np.clip(rays @ trunks[:, :3].T, -1.0, 1.0))
    width = np.arcsin(np.minimum(trunks[:, 4] / trunks[:, 3], 1.0))
    gap = np.abs(surface[:, None] - true)
    pairs = match(gap, (angle < 0.9 * width + 0.02) & (gap < 0.3 * true + 0.5))
    return {trunk: detection for detection, trunk in pairs}


def match(cost: Vector, allowed: Any) -> list[tuple[int, int]]:
    """Return the allowed pairs (row, column) of least total cost."""
    if not cost.size:
        return []
    return [pair for pair in assign(np.where(allowed, cost, _FAR)) if allowed[pair]]


def _table(bands: dict[tuple[float, float], Tally]) -> dict[str, Any]:
    return {f"{low:g}–{high:g} m": tally.figures() for (low, high), tally in bands.items()}


def _times(values: list[float]) -> dict[str, float] | None:
    if not values:
        return None
    return {name: float(np.percentile(values, q)) for name, q in (("p50", 50), ("p99", 99))}


def _percentile(values: Vector, q: float) -> float | None:
    return float(np.percentile(values, q)) if len(values) else None


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None


def _rms(values: Any) -> float | None:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else None
