"""What the companions believed and planned, from their logs, in the world's frame."""

from __future__ import annotations

import bisect
from dataclasses import dataclass
from typing import Any

import numpy as np

from mavlink_bridge.shared.arrays import Vector
from sitl_sim.recording.run_folder import OwnFrame, Run, own_frames

_SAME = 1.0  # m: a track this near to a drone is that drone


@dataclass(frozen=True)
class Threat:
    """A critical neighbour as a companion believed it.

    position: (3,) m, world. value: of the threat. drone: index of the real drone there, or None.
    """

    position: Vector
    value: float
    drone: int | None


@dataclass(frozen=True)
class Belief:
    """What one companion believed at one tick; plan (n,3) m and tracks (k,3) m in the world."""

    record: dict[str, Any]
    plan: Vector
    tracks: Vector
    critical: list[Threat]


class Beliefs:
    """What the companions of a run believed, by world time."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._frames = own_frames(run.scenario, run.world)
        self._times = [
            [r["time"] - frame.boot for r in run.logs[name]]
            for name, frame in zip(run.names, self._frames, strict=True)
        ]

    def positions(self, time: float) -> Vector:
        """Return the true positions (N,3) m of the drones."""
        k = int(np.searchsorted(self._run.truth["t"], time))
        p: Vector = self._run.truth["position"][min(k, len(self._run.truth["t"]) - 1)].astype(float)
        return p

    def at(self, drone: int, time: float) -> Belief | None:
        """Return the belief at the drone's last tick before `time` [s]; None before its first."""
        k = bisect.bisect_right(self._times[drone], time) - 1
        if k < 0:
            return None
        record = self._run.logs[self._run.names[drone]][k]
        return belief_of(record, self._frames[drone], drone, self.positions(time))


def belief_of(record: dict[str, Any], frame: OwnFrame, drone: int, truth: Vector) -> Belief:
    """Return a log record of a drone in the world's frame.

    truth: (N,3) m, the true positions, by which critical tracks are matched with drones.
    """
    tracks = frame.points(np.array([t["p"] for t in record["tracks"]]).reshape(-1, 3))
    place = {t["id"]: p for t, p in zip(record["tracks"], tracks, strict=True)}
    others = truth.copy()
    others[drone] = np.inf
    critical = []
    for number, value in record["critical"]:
        gaps = np.linalg.norm(others - place[number], axis=1)
        near = int(gaps.argmin())
        critical.append(Threat(place[number], value, near if gaps[near] < _SAME else None))
    plan = frame.points(np.array(record.get("plan", [])).reshape(-1, 3))
    return Belief(record, plan, tracks, critical)
